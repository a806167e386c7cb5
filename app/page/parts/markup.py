"""HTML of the page, made by pure functions from values, and tooltips for technical terms."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import gradio as gr

from app import text
from app.run.callbacks import RUN_STAGES, RunStage

WORDS = {
    "jerk": "Rate of change of acceleration, in m/s³. Lower means smoother.",
    "depth": "Number of bones between the pelvis and a joint; the fingertips are deepest.",
    "frequency": "Oscillations per second (Hz).",
    "trajectory": "The path of a point through space over time.",
    "seam": "The boundary between two generated windows of motion.",
    "seams": "The boundary between two generated windows of motion.",
    "closed form": "Computed from a formula instead of measured.",
    "chance level": "Expected value if motion and speech are unrelated.",
    "power": "Energy of the movement at each frequency.",
    "noise": "Random numbers from which motion is generated, or which are added to a motion.",
    "local rotations": "Rotation of each joint relative to its parent joint.",
    "global rotations": "Rotation of each joint in world coordinates.",
    "samples": "Motions generated for the same speech from different noise.",
}
_WORDS = re.compile(
    r"\b(" + "|".join(sorted(map(re.escape, WORDS), key=len, reverse=True)) + r")\b", re.IGNORECASE
)


MAX_SHOWN_NOTES = 3
"""Maximum number of notes of a run that the page shows; its file has all."""


def add_tooltips(sentence: str) -> str:
    """Format a sentence as HTML, with an explanation (`help.js`) of each term at its first use."""
    used: set[str] = set()

    def mark(match: re.Match[str]) -> str:
        word = match[1].lower()
        if WORDS[word] in used:
            return match[1]
        used.add(WORDS[word])
        return f'<abbr title="{escape(WORDS[word])}" tabindex="0">{match[1]}</abbr>'

    return _WORDS.sub(mark, escape(sentence))


def header(trained_on: str) -> str:
    """Format the page's header: title, purpose and training data, empty for untrained weights."""
    banner = text.DEMO_WEIGHTS.format(data=escape(trained_on)) if trained_on else text.UNTRAINED
    return (
        f'<header class="masthead"><h1>{escape(text.TITLE)}</h1>'
        f"<p>{escape(text.TAGLINE)}</p></header>"
        f'<div class="banner" role="note">{_ICON_INFO}<span>{banner}</span></div>'
    )


def about_paper() -> str:
    """Format the foot of the page: the paper that it is about, with links."""
    links = " ".join(
        f'<a href="{url}" target="_blank" rel="noopener">{words}</a>'
        for words, url in text.PAPER_LINKS.items()
    )
    return f'<footer class="paper"><p>{text.PAPER}</p><p>{links}</p></footer>'


def step_heading(number: int, title: str) -> str:
    return f'<h2 class="step"><span aria-hidden="true">{number}</span>{escape(title)}</h2>'


def heading(title: str, explanation: str = "") -> str:
    below = f"<p>{add_tooltips(explanation)}</p>" if explanation else ""
    return f'<div class="part"><h2>{escape(title)}</h2>{below}</div>'


def header_cells(labels: Mapping[str, str]) -> str:
    """Format the header cells of a table, with full names as tooltips."""
    return "".join(
        f'<th scope="col" title="{escape(name)}">{escape(label)}</th>'
        for name, label in labels.items()
    )


def table_row(title: str, cells: Iterable[str]) -> str:
    cells_html = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
    return f'<tr><th scope="row">{escape(title)}</th>{cells_html}</tr>'


def table(name: str, corner: str, head: str, body: str, foot: str = "") -> str:
    """Format a table that scrolls if it is too wide; head, body and foot are HTML."""
    return (
        f'<div class="scroll" role="region" aria-label="{escape(name)}" tabindex="0"><table>'
        f'<thead><tr><th scope="col">{escape(corner)}</th>{head}</tr></thead>'
        f"<tbody>{body}</tbody>{foot}</table></div>"
    )


def run_status(
    line: str,
    fractions: Mapping[RunStage, float],
    details: Mapping[RunStage, str],
    stages=RUN_STAGES,
) -> str:
    """Format a status line and the progress of a run's stages."""
    rows = []
    for stage in stages:
        fraction = fractions.get(stage)
        state = "todo" if fraction is None else "done" if fraction >= 1 else "doing"
        percent = round(100 * min(1.0, fraction or 0.0))
        percent_text = f"{percent} %" if state == "doing" else ""
        detail = details.get(stage, "") if state == "doing" else ""
        rows.append(
            f'<li class="{state}"><i aria-hidden="true"></i>'
            f"<span>{escape(text.STAGE_NAMES[stage])}<small>{escape(detail)}</small></span>"
            f"<em>{percent_text}</em>"
            f'<b style="width:{percent}%"></b></li>'
        )
    return (
        f'<div class="status" role="status" aria-live="polite"><p>{escape(line)}</p>'
        f"<ol>{''.join(rows)}</ol></div>"
    )


def sentence_status(line: str) -> str:
    return f'<div class="status" role="status" aria-live="polite"><p>{escape(line)}</p></div>'


def idle_status(line: str) -> str:
    """Format the status line before the first run; CSS hides it while the example plays."""
    return f'<div class="status idle"><p>{escape(line)}</p></div>'


def error_message(sentence: str) -> str:
    return (
        f'<div class="message error" role="alert">{_ICON_ERROR}<div>'
        f"<b>{escape(text.FAILED_TITLE)}</b><p>{escape(sentence)}</p></div></div>"
    )


def upload_error(sentence: str) -> str:
    return f'<p class="refusal" role="alert">{escape(sentence)}</p>' if sentence else ""


def verdict(jerk_sentence: str, comparison: str, bars: str = "") -> str:
    """Format the verdict of a run; empty without a sentence on the jerk.

    ``bars``, as HTML, replace that sentence, next to the first sentence of the comparison; the
    table of metrics has the others.
    """
    if not jerk_sentence:
        return ""
    claim, others = split_first_sentence(comparison)
    if not bars or not claim:
        claim, others = jerk_sentence, comparison
    others_html = f"<p>{add_tooltips(others)}</p>" if others and not bars else ""
    return f'<div class="verdict"><div><b>{add_tooltips(claim)}</b>{others_html}</div>{bars}</div>'


def split_first_sentence(judgement: str) -> tuple[str, str]:
    """Split a judgement into its first sentence and the others."""
    claim, stop, others = judgement.partition(". ")
    return claim + stop.rstrip(), others


def bar_chart(
    title: str, values: Mapping[str, tuple[str, str, Sequence[float]]], is_over_clips: bool = False
) -> str:
    """Format small bars, or dots with intervals over clips.

    ``values`` has by label the value as text, a colour, and the value with its interval's ends as
    shares of the scale.
    """
    items = "".join(
        f'<li style="--series:{color};--share:{share:.3f};--low:{low:.3f};--high:{high:.3f}">'
        f"<span>{escape(label)}</span><i></i><b>{escape(value)}</b></li>"
        for label, (value, color, (share, low, high)) in values.items()
    )
    kind = "bars dots" if is_over_clips else "bars"
    return (
        f'<figure class="{kind}"><figcaption>{escape(title)}</figcaption><ul>{items}</ul></figure>'
    )


def collapsed_notes(notes: Sequence[str]) -> str:
    """Format the first notes of a successful run, folded; empty without any."""
    if not notes:
        return ""
    items = "".join(f"<p>{escape(note)}</p>" for note in notes[:MAX_SHOWN_NOTES])
    if len(notes) > MAX_SHOWN_NOTES:
        items += f"<p>{text.MORE_NOTES.format(count=len(notes))}</p>"
    count = min(len(notes), MAX_SHOWN_NOTES)
    return (
        '<div class="message note folded" role="note"><details>'
        f"<summary>{escape(text.NOTES_TITLE)} ({count})</summary>{items}</details></div>"
    )


def note(sentence: str) -> str:
    return (
        f'<div class="message note" role="note">{_ICON_INFO}<div>'
        f"<b>{escape(text.NOTES_TITLE)}</b><p>{escape(sentence)}</p></div></div>"
    )


_ICON_INFO = (
    '<svg viewBox="0 0 20 20" aria-hidden="true"><circle cx="10" cy="10" r="8"/>'
    '<path d="M10 9v5M10 6v.5"/></svg>'
)
_ICON_ERROR = (
    '<svg viewBox="0 0 20 20" aria-hidden="true"><path d="M10 2.5 18 17H2z"/>'
    '<path d="M10 8v4M10 14.2v.5"/></svg>'
)


def mount_script(module: str, function: str) -> str:
    """Return JavaScript for `gr.HTML` that passes its element to a module of app/page/web."""
    return (
        f'import(new URL("web/{module}", document.baseURI))'
        f".then(({{ {function} }}) => {function}(element, props, watch));"
    )


def group_choices(
    field: str, about: Mapping[str, str], groups: Mapping[str, Sequence[str]]
) -> None:
    """Arrange a field's choices in groups, which a click on their title ticks, with tooltips."""
    gr.HTML(
        {"field": field, "about": dict(about), "groups": dict(groups)},
        html_template="",
        js_on_load=mount_script("chips.js", "mountChips"),
        apply_default_css=False,
        elem_classes="told-elsewhere",
    )


def scroll_to_on_click(button: gr.Button, element: gr.HTML) -> None:
    """Scroll to the status of a run on a click; call this before attaching the run to it."""
    button.click(
        None,
        js='() => { const pressed = document.querySelector("button:focus-visible");'
        'import(new URL("web/begun.js", document.baseURI))'
        f'.then(({{ reveal }}) => reveal("{element.elem_id}", pressed)); }}',
        api_visibility="private",
    )


def html_hidden_if_empty(
    elem_id: str | None = None, module: str = "", function: str = "", part: str = ""
) -> gr.HTML:
    """Make an HTML component that is hidden while empty, optionally mounted by a module.

    ``part`` is the part of the results that it belongs to; see app/page/web/player/parts.js.
    """
    how = (
        {"js_on_load": mount_script(module, function), "apply_default_css": False} if module else {}
    )
    classes = f"of-{part}" if part else None
    return gr.HTML("", visible=False, elem_id=elem_id, elem_classes=classes, **how)


def update_html(html: str) -> Any:
    """Return the update of an HTML component that is hidden while it is empty."""
    return gr.update(value=html, visible=bool(html))


def player_component(prefix: str) -> gr.HTML:
    """Make a player component with the value of a `RunView`; it is hidden without rows."""
    return gr.HTML(
        {},
        html_template='<div class="lockstep" hidden></div>',
        js_on_load=mount_script("player/player.js", "mountPlayer"),
        apply_default_css=False,
        elem_id=prefix + "player",
    )


PRIVATE_EVENT: dict[str, Any] = {"api_visibility": "private", "show_progress": "hidden"}
"""Event options of functions that only the page calls, without a progress indicator."""
UNQUEUED_EVENT: dict[str, Any] = {"queue": False, **PRIVATE_EVENT}
"""Event options of functions that run outside of the queue."""
Updates = dict[Any, Any]
"""New values by component."""
