"""Where a tab shows what comes of a run, from top to bottom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.html_parts import mount, player_part, results_parts


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
    bundle: gr.DownloadButton
    files: gr.File

    @property
    def all(self) -> list[Any]:
        return [getattr(self, name) for name in self.__dataclass_fields__]


def build_results(prefix: str = "", ready: str = text.READY, empty: str = "") -> ResultParts:
    """What a run shows; what has nothing to show yet is hidden.

    Args:
        prefix: of the parts' ids on the page, with its hyphen.
        ready: the status before the first run.
        empty: what stands in the place of results, as HTML.
    """
    message = gr.HTML("", visible=False, elem_id=prefix + "message")
    status = gr.HTML(markup.idle_status(ready), elem_id=prefix + "status")
    empty_part = gr.HTML(empty, visible=bool(empty), elem_id=prefix + "empty")
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
        "", visible=False, js_on_load=mount("runs.js", "mountRuns"), apply_default_css=False,
        elem_id=prefix + "runs",
    )  # fmt: skip
    rest = results_parts(prefix)
    return ResultParts(message, status, runs, empty_part, verdict, player, *in_between, *rest)
