"""The ladder of systems explained in one screen: what each adds, its equation, what to look for.

Equations are those of GlobalDiff; their numbers are the paper's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import gradio as gr

from model.systems.globaldiff.config import BEST
from model.systems.registry import family_of

TITLE = "Five systems, each adding one thing to the one before"
INTRODUCTION = (
    "All predict the clean motion from a noised one, the speech, the speaker and a short seed "
    "(flow matching, eq. 7), with positions supervised beside rotations. In this project everything"
    " but the rung's own step is equal: data and their order, network, windows of training, and "
    "the noise of a comparison; each was trained from nothing, on raw rotations as in the paper's "
    "code. That a step helps is the paper's claim; on your clip, the measures decide."
)
NOT_HERE = "no weights here"
OWN_TITLE = "And one of our own, made to move well"
OWN_MEANING = (
    "Before any network, a linear-Gaussian model of the motion (how far, how smoothly and how long "
    "each part of the body moves) says what x₁ can be, given the noised motion and the frames "
    "before. The network adds to that what speech tells, in units of what is still open. So it "
    "moves as far and as smoothly as its data; the ladder shows what happens without."
)


_DELIMITERS = {"left": "$$", "right": "$$", "display": True}


@dataclass(frozen=True)
class Rung:
    """One row of the paper's Table 2."""

    system: str
    adds: str
    meaning: str
    equation: str
    """In TeX, without the signs of HTML."""
    source: str
    look_for: str


_LOCAL = r"R_k^{\text{global}} = R_1^{\text{local}} R_2^{\text{local}} \cdots R_k^{\text{local}}"
_GLOBAL = r"q_k = q_{\text{root}} + \sum_{(i \to j) \in \pi(k)} R_i^{\text{global}} (t_j - t_i)"
_JOINT = (
    r"\mathcal{L}_j = \frac{1}{KN} \sum_{k,n}"
    r" \|R_k^{\text{global}} v_k^n - R_k^{\text{gt}} v_k^n\|^2"
)
_SKELETON = (
    r"\mathcal{L}_s = \frac{1}{|\mathcal{B}|} \sum_{b,b' \in \mathcal{B}}"
    r" (b^{\text{T}} b' - \tilde{b}^{\text{T}} \tilde{b}')^2"
)
_MOTION = r"\mathcal{L}_m = \|g(\hat{X}) - g(X)\|^2"

RUNGS = (
    Rung(
        "globaldiff/local", "Local rotations",
        "Each joint is predicted relative to its parent. A joint's direction in the world is a "
        "product along the chain, so an error at the shoulder turns everything below it.",
        _LOCAL, "eq. 3",
        "Trembling that grows from shoulder to fingertip; a body that tilts as a whole.",
    ),
    Rung(
        "globaldiff/global", "Global rotations",
        "Each joint is predicted in the world. A position is a sum over the chain's bones; an "
        "error at one joint moves what is below it but turns nothing else.",
        _GLOBAL, "eq. 5",
        "A quieter fingertip. The price: nothing ties neighbours together, so single joints may "
        "twist against their parents.",
    ),
    Rung(
        "globaldiff/joint", "+ joint constraint",
        "Six anchor points around each joint are turned along with it and compared. A position "
        "says nothing of a last joint's own turn; the anchors do.",
        _JOINT, "eqs. 8 to 10",
        "Thumbs and little fingers: without it they may be flipped or twisted.",
    ),
    Rung(
        "globaldiff/skeleton", "+ skeleton constraint",
        "The angle between every two bones is compared, however far apart they are on the body.",
        _SKELETON, "eqs. 11 to 13",
        "Posture: leaning, uneven limbs and unsteady feet should become rarer.",
    ),
    Rung(
        "globaldiff/full", "+ motion constraint",
        "A trained encoder g turns whole stretches of motion into codes at several time scales; "
        "codes of prediction and recording are compared.",
        _MOTION, "eqs. 14 and 15",
        "Timing: rhythm and dynamics over seconds, which no single frame shows.",
    ),
)  # fmt: skip


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
    cards = "".join(_card(number, rung, systems) for number, rung in enumerate(RUNGS, start=1))
    return (
        f'<section class="ladder"><h2>{escape(TITLE)}</h2><p>{escape(INTRODUCTION)}</p>'
        f"<ol>{cards}</ol>{_own(systems)}{_others(systems)}</section>"
    )


def _own(systems: Sequence[str]) -> str:
    missing = "" if BEST in systems else f"<em>{NOT_HERE}</em>"
    return (
        f'<div class="own"><h3>{escape(OWN_TITLE)}</h3><code>{escape(BEST)}</code>{missing}'
        f"<p>{escape(OWN_MEANING)}</p></div>"
    )


def _others(systems: Sequence[str]) -> str:
    """Systems of other families, family by family, each with what its family says of it."""
    told = (BEST, *(rung.system for rung in RUNGS))
    others = [name for name in systems if name not in told]
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


def _card(number: int, rung: Rung, systems: Sequence[str]) -> str:
    is_here = rung.system in systems
    missing = "" if is_here else f"<em>{NOT_HERE}</em>"
    return (
        f'<li{"" if is_here else " class=absent"}><h3><i aria-hidden="true">{number}</i>'
        f"{escape(rung.adds)}</h3>"
        f"<code>{escape(rung.system)}</code>{missing}<p>{escape(rung.meaning)}</p>"
        f'<div class="equation">$${rung.equation}$$<small>{escape(rung.source)}</small></div>'
        f"<p><b>Look for</b> {escape(rung.look_for)}</p></li>"
    )
