"""Systems explained in one screen, as their families tell: ladders with what each rung adds, its
equation and what to look for, then a sentence on each of the others."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import gradio as gr

from model.generation.family import Beside, ExplainedSystem, Ladder
from model.systems.registry import families, family_of

NOT_HERE = "no weights here"
_DELIMITERS = {"left": "$$", "right": "$$", "display": True}


def build_systems_tab(systems: Sequence[str]) -> None:
    """Lay out the tab inside the current context.

    Args:
        systems: of which there are weights.
    """
    # Markdown, because Gradio sets formulas in it; the text is our own, so nothing is taken out.
    gr.Markdown(
        ladder(systems), sanitize_html=False, latex_delimiters=[_DELIMITERS], elem_id="ladder"
    )


def ladder(systems: Sequence[str]) -> str:
    """The rungs as cards from left to right, with what cannot be run here marked as such."""
    ladders = [family.ladder for family in families() if family.ladder is not None]
    told = "".join(_ladder(each, systems) for each in ladders)
    explained = [name for each in ladders for name in each.systems]
    others = _others([name for name in systems if name not in explained])
    return f'<section class="ladder">{told}{others}</section>'


def _ladder(told: Ladder, systems: Sequence[str]) -> str:
    cards = "".join(_card(number, rung, systems) for number, rung in enumerate(told.rungs, start=1))
    beside = "".join(_beside(each, systems) for each in told.beside)
    return (
        f"<h2>{escape(told.title)}</h2><p>{escape(told.introduction)}</p><ol>{cards}</ol>{beside}"
    )


def _beside(told: Beside, systems: Sequence[str]) -> str:
    missing = "" if told.system in systems else f"<em>{NOT_HERE}</em>"
    return (
        f'<div class="own"><h3>{escape(told.title)}</h3><code>{escape(told.system)}</code>{missing}'
        f"<p>{escape(told.meaning)}</p></div>"
    )


def _others(others: Sequence[str]) -> str:
    """Family by family, each with what its family says of it."""
    cards = []
    for title in dict.fromkeys(family_of(name).title for name in others):
        rows = "".join(
            f"<dt><code>{escape(name)}</code></dt>"
            f"<dd>{escape(family_of(name).about.get(name, ''))}</dd>"
            for name in others
            if family_of(name).title == title
        )
        cards.append(f'<div class="own"><h3>{escape(title)}</h3><dl>{rows}</dl></div>')
    return "".join(cards)


def _card(number: int, rung: ExplainedSystem, systems: Sequence[str]) -> str:
    is_here = rung.system in systems
    missing = "" if is_here else f"<em>{NOT_HERE}</em>"
    return (
        f'<li{"" if is_here else " class=absent"}><h3><i aria-hidden="true">{number}</i>'
        f"{escape(rung.adds)}</h3>"
        f"<code>{escape(rung.system)}</code>{missing}<p>{escape(rung.meaning)}</p>"
        f'<div class="equation">$${rung.equation}$$<small>{escape(rung.source)}</small></div>'
        f"<p><b>Look for</b> {escape(rung.look_for)}</p></li>"
    )
