"""Where a tab shows what comes of a run, from top to bottom, and its figures, large on click."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.html_parts import mount, player_part, results_parts
from app.page.parts.markup import explained


@dataclass(frozen=True)
class ResultParts:
    """The parts of one tab."""

    message: gr.HTML
    status: gr.HTML
    runs: gr.HTML
    """The link to the run that is shown, and the visitor's others."""
    empty: gr.HTML
    verdict: gr.HTML
    player: gr.HTML
    """Its value is a `Showing` as a dictionary; without rows it takes no room."""
    seen: gr.HTML
    """How far a video of what the stage shows is, and the way to it."""
    seen_asked: gr.Textbox
    seen_start: gr.Button
    """Pressed by the stage."""
    seen_cancel: gr.Button
    take_asked: gr.Textbox
    take_start: gr.Button
    """Pressed by the editor of gestures."""
    figures: gr.HTML
    numbers: gr.HTML
    downloads_part: gr.Column
    bundle: gr.Button
    files: gr.File

    @property
    def all(self) -> list[Any]:
        return [getattr(self, name) for name in self.__dataclass_fields__]


def build_results(prefix: str = "", ready: str = text.READY, empty: str = "") -> ResultParts:
    """What a run shows; what has nothing to show yet is hidden.

    Args:
        prefix: of the parts' ids on the page, with its hyphen.
        ready: the status before the first run.
        empty: what stands in the place of results, as HTML; seen once it is known that there are
            none.
    """
    message = gr.HTML("", visible=False, elem_id=prefix + "message")
    status = gr.HTML(markup.idle_status(ready), elem_id=prefix + "status")
    empty_part = gr.HTML(empty, visible=False, elem_id=prefix + "empty")
    player = player_part(prefix)
    with gr.Row(elem_classes="seen-video"):
        seen = gr.HTML("", visible=False, elem_id=prefix + "seen")
        seen_cancel = gr.Button(
            text.CANCEL,
            visible=False,
            size="sm",
            scale=0,
            min_width=90,
            elem_id=prefix + "seen-cancel",
        )
    seen_asked = gr.Textbox(visible=False)
    seen_start = gr.Button(elem_classes="seen-start told-elsewhere")
    take_asked = gr.Textbox(visible=False)
    take_start = gr.Button(elem_classes="take-start told-elsewhere")
    in_between = (seen, seen_asked, seen_start, seen_cancel, take_asked, take_start)
    verdict = gr.HTML("", visible=False, elem_id=prefix + "verdict")
    runs = gr.HTML(
        "",
        visible=False,
        js_on_load=mount("runs.js", "mountRuns"),
        apply_default_css=False,
        elem_id=prefix + "runs",
    )
    rest = results_parts(prefix)
    return ResultParts(message, status, runs, empty_part, verdict, player, *in_between, *rest)


_DOWNLOADS = ("png", "svg", "pdf")
NO_WORDS: Mapping[str, str] = {}


def figures_html(
    files: Iterable[Path], address: Callable[[Path], str], sentences: Mapping[str, str] = NO_WORDS
) -> str:
    """The figures among some files, each with what the numbers say of it.

    Args:
        address: gives a file its place for one browser.
        sentences: as of `app.findings.sentences.sentences_of`.
    """
    figures: dict[str, dict[str, Path]] = {}
    for path in files:
        figures.setdefault(path.stem, {})[path.suffix.lstrip(".")] = path
    return "".join(
        _figure(
            stem,
            {each: address(paths[each]) for each in _DOWNLOADS if each in paths},
            sentences,
            paths["txt"].read_text("utf-8") if "txt" in paths else "",
        )
        for stem, paths in figures.items()
        if "png" in paths
    )


def _figure(stem: str, urls: Mapping[str, str], sentences: Mapping[str, str], caption: str) -> str:
    about = text.FIGURES.get(stem, text.FigureText(stem, "", ()))
    links = "".join(
        f'<a href="{escape(urls[ending])}" download="{escape(stem)}.{ending}">{ending.upper()}</a>'
        for ending in urls
    )
    said = "".join(
        f"<p>{explained(sentences[key])}</p>" for key in about.says if sentences.get(key)
    )
    beside = (
        f"<details><summary>{text.CAPTION}</summary><p>{escape(caption)}</p></details>"
        if caption
        else ""
    )
    return (
        f"{markup.heading(about.title, about.help)}"
        f'<figure class="plot"><button type="button" class="zoom" '
        f'aria-label="{text.ENLARGE_FIGURE.format(title=escape(about.title))}">'
        f'<img src="{escape(urls["png"])}" alt="{escape(about.title)}"></button>'
        f'<figcaption>{said}{beside}<p class="links">{links}</p></figcaption></figure>'
    )
