"""Parts of Gradio: our own HTML in them, and how listeners are heard."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gradio as gr


def mount(module: str, function: str) -> str:
    """JavaScript for `gr.HTML` that hands its element to a module of app/page/web."""
    return (
        f'import(new URL("web/{module}", document.baseURI))'
        f".then(({{ {function} }}) => {function}(element, props, watch));"
    )


def arrange_chips(
    field: str, about: Mapping[str, str], groups: Mapping[str, Sequence[str]]
) -> None:
    """Have the choices of a field, named by its id, stand in groups, each of which its title ticks
    as a whole, and say of each label what it is when a pointer rests on it."""
    gr.HTML(
        {"field": field, "about": dict(about), "groups": dict(groups)},
        html_template="",
        js_on_load=mount("chips.js", "mountChips"),
        apply_default_css=False,
        elem_classes="told-elsewhere",
    )


def reveal_on_click(button: gr.Button, element: gr.HTML) -> None:
    """Scroll to the part of the page that shows what a click begins.

    Called before the click is given its run: a browser does one after the other.
    """
    button.click(
        None,
        js=f'() => {{ import(new URL("web/reveal.js", document.baseURI))'
        f'.then(({{ reveal }}) => reveal("{element.elem_id}")); }}',
        api_visibility="private",
    )


def told_part(elem_id: str | None = None, module: str = "", function: str = "") -> gr.HTML:
    """HTML that is hidden until there is any, handed to a module where one is named."""
    how = {"js_on_load": mount(module, function), "apply_default_css": False} if module else {}
    return gr.HTML("", visible=False, elem_id=elem_id, **how)


def shown(html: str) -> Any:
    """An update of an HTML part that is hidden while it is empty."""
    return gr.update(value=html, visible=bool(html))


def player_part(prefix: str) -> gr.HTML:
    """A player in lock-step, whose value is a `Showing` as a dictionary; without rows it takes no
    room."""
    return gr.HTML(
        {},
        html_template='<div class="lockstep" hidden></div>',
        js_on_load=mount("player/player.js", "mountPlayer"),
        apply_default_css=False,
        elem_id=prefix + "player",
    )


PRIVATE: dict[str, Any] = {"api_visibility": "private", "show_progress": "hidden"}
"""By the page alone: no program calls it, and nothing spins while it works."""
AT_ONCE: dict[str, Any] = {"queue": False, **PRIVATE}
"""Before all that waits."""


def in_turn(status: gr.HTML) -> dict[str, Any]:
    """Of a run: one after the other, whoever asks; its place in the queue is told on the status,
    and another click of the same button is none."""
    return {
        "show_progress": "minimal",
        "show_progress_on": status,
        "trigger_mode": "once",
        "concurrency_id": "run",
        "concurrency_limit": "default",
    }
