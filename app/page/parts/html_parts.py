"""Parts of Gradio that hold our own HTML: how a script gets hold of one, how an empty one hides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup


def mount(module: str, function: str) -> str:
    """JavaScript for `gr.HTML` that hands its element to a module of app/page/web."""
    return (
        f'import(new URL("web/{module}", document.baseURI))'
        f".then(({{ {function} }}) => {function}(element, props, watch));"
    )


def tell_chips(field: str, about: Mapping[str, str]) -> None:
    """Have the choices of a field say what they are when a pointer rests on them.

    Args:
        field: its id on the page.
        about: a sentence for each label.
    """
    gr.HTML(
        {"field": field, "about": dict(about)},
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


def results_parts(
    prefix: str,
) -> tuple[gr.HTML, gr.HTML, gr.Column, gr.DownloadButton, gr.File]:
    """Figures, numbers and downloads of a run, hidden until there are any.

    Args:
        prefix: of their ids on the page, with its hyphen.
    """
    figures, numbers = (
        gr.HTML(
            "",
            visible=False,
            js_on_load=mount(module, function),
            apply_default_css=False,
            elem_id=prefix + name,
        )
        for name, module, function in (
            ("figures", "figures.js", "mountFigures"),
            ("numbers", "measures.js", "mountMeasures"),
        )
    )
    with gr.Column(visible=False) as downloads:
        gr.HTML(markup.heading(text.DOWNLOADS_HEADING))
        bundle = gr.DownloadButton(text.ZIP_LABEL, variant="primary", elem_id=prefix + "bundle")
        with gr.Accordion(text.FILES_LABEL, open=False, elem_id=prefix + "files-fold"):
            files = gr.File(
                show_label=False,
                file_count="multiple",
                interactive=False,
                elem_id=prefix + "files",
            )
    return figures, numbers, downloads, bundle, files


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
