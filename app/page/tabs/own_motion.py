"""The tab of the page that measures and compares motion files of a visitor's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.page.parts import markup
from app.page.parts.catalogue import point_choices
from app.page.parts.html_parts import results_parts
from app.page.parts.named_fields import named_fields
from app.page.serving.jobs import JobBook
from app.page.serving.media import MediaDesk
from app.page.tabs.own_motion_run import (
    Diagnose,
    OwnMotionForm,
    OwnMotionParts,
    OwnMotionRunner,
    display_names,
)
from app.run.followed_point import TIP
from app.run.request import MAX_COMPARED

TAB = "Your motion"
WINDOWS_HELP = (
    "If you know how long the windows are, jumps are looked for where they join. Left empty, every "
    "period from 2 to 240 frames is tried."
)
SHOWN_LABEL = "Shown in the figures"
SHOWN_HELP = "At most six with the reference; all are measured."
INTRODUCTION = (
    "Measures motion files of your own as it measures the systems, raw and filtered: "
    ".npz as BEAT2, AMASS and SMPL-X have them, .npy, .bvh; 12 to 240 frames a second. The same as "
    "<code>python -m app diagnose</code>."
)


def build_own_motion_tab(
    page: gr.Blocks,
    config: AppConfig,
    jobs: JobBook,
    desk: MediaDesk,
    diagnose: Diagnose | None = None,
) -> None:
    """Lay out the tab inside the current context and wire it.

    Args:
        diagnose: does the measuring; by default `app.run.diagnose.diagnose_files`.
    """
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            fields, start, cancel = _build_form()
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            parts = build_results()
    runner = OwnMotionRunner(diagnose or _diagnose, config, jobs, desk, parts)
    start.click(
        named_fields(runner.run, OwnMotionForm, optional=("reference", "speech")),
        inputs=fields,
        outputs=parts.all,
        api_name="own_motion",
        show_progress="hidden",
        trigger_mode="once",
        concurrency_limit=None,  # JobBook lets them in one by one
    )
    cancel.click(runner.cancel, queue=False, api_visibility="private", show_progress="hidden")
    page.unload(runner.cancel)


def _diagnose(request: Any, on_progress: Any) -> Any:
    from app.run.diagnose import diagnose_files  # brings torch: only once it is needed

    return diagnose_files(request, on_progress)


def _build_form() -> tuple[list[Any], gr.Button, gr.Button]:
    """Fields in the order of `OwnMotionForm`, and the buttons."""
    motions = gr.File(
        label="Motions to compare (.npz, .npy or .bvh)",
        file_count="multiple",
        file_types=[".npz", ".npy", ".bvh"],
        type="filepath",
        height=150,
        elem_id="own-motions",
    )
    shown = gr.Dropdown(
        choices=[],
        multiselect=True,
        max_choices=MAX_COMPARED,
        visible=False,
        label=SHOWN_LABEL,
        info=SHOWN_HELP,
        elem_id="own-shown",
    )
    motions.change(
        _choices, motions, shown, queue=False, api_visibility="private", show_progress="hidden"
    )
    reference = gr.File(
        label=text.REFERENCE_LABEL,
        file_types=[".npz", ".npy", ".bvh"],
        type="filepath",
        height=150,
    )
    speech = gr.File(
        label="Speech of all of them (optional, for BeatAlign)",
        file_types=["audio"],
        type="filepath",
        height=150,
    )
    with gr.Row(elem_classes="pair"):
        point = gr.Dropdown(choices=point_choices(), value=TIP, label=text.POINT_LABEL)
        start_frame = gr.Number(value=0, precision=0, minimum=0, label=text.START_LABEL)
    with gr.Accordion("Made of windows?", open=False):
        gr.HTML(f'<p class="hint">{WINDOWS_HELP}</p>')
        with gr.Row(elem_classes="pair"):
            window = gr.Number(value=None, precision=0, minimum=0, label="Frames of a window")
            overlap = gr.Number(value=None, precision=0, minimum=0, label="Shared by two")
    with gr.Row(elem_classes="actions"):
        start = gr.Button("Measure and compare", variant="primary", elem_id="own-start")
        cancel = gr.Button(text.CANCEL, elem_id="own-cancel", min_width=110)
    fields = [motions, reference, speech, point, start_frame, window, overlap, shown]
    return fields, start, cancel


def _choices(paths: list[str] | None) -> Any:
    """The motions that can be chosen; nothing is asked where all fit."""
    names = display_names([Path(path).stem for path in paths or ()])
    first = list(names[:MAX_COMPARED])
    return gr.update(choices=list(names), value=first, visible=len(names) >= MAX_COMPARED)


def build_results() -> OwnMotionParts:
    """What is measured, drawn and said; all but the status is hidden until there is something."""
    status = gr.HTML(markup.sentence_status(text.READY), elem_id="own-status")
    message = gr.HTML("", visible=False, elem_id="own-message")
    return OwnMotionParts(status, message, *results_parts("own-"))
