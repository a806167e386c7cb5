"""The part that opens the tab "Systems": the paper's argument on two bodies, without a network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.page.parts import markup
from app.page.parts.html_parts import reveal_on_click, shown
from app.page.serving.follow import last_share
from app.page.serving.jobs import Job, JobBook
from app.page.serving.media import MediaDesk
from app.page.serving.runner import TabRunner, Updates
from app.run.mechanism import NOISE_RAD, MechanismRequest
from app.run.planted import CLEAN
from app.run.request import Event, OnEvent, ShouldCancel
from app.run.telling import share_teller

TITLE = "The argument in ten seconds: equal noise on local and on global rotations"
INTRODUCTION = (
    "One motion, two bodies. Every joint is turned at random by the same amount, once against its "
    "parent and once in the world. No network takes part. Look at the fingertips, then move the "
    "slider. The same as <code>python -m app mechanism</code>."
)
NOISE_LABEL = "Noise on every joint, radians about each axis"
MOTION_LABEL = "Motion of your own (optional)"
SHOW = "Show both bodies"
DRAWING = "Drawing: {share:.0%}"
DRAWN = "Noise of {noise:g} rad: left on local rotations, right on global ones."
SIZE_PX = 512

Shown = tuple[Path, tuple[str, ...]]
"""A video, and what it shows in sentences."""
Show = Callable[[MechanismRequest, Callable[[float], None]], Shown]


@dataclass(frozen=True)
class MechanismParts:
    """Where video and sentences are shown."""

    status: gr.HTML
    message: gr.HTML
    video: gr.HTML


def build_mechanism(
    page: gr.Blocks, config: AppConfig, jobs: JobBook, desk: MediaDesk, show: Show
) -> None:
    """Lay out the part inside the current context and wire it.

    Args:
        show: does the drawing, as `app.run.mechanism.show_mechanism`.
    """
    gr.HTML(f'{markup.heading(TITLE)}<p class="hint">{INTRODUCTION}</p>')
    least, most = NOISE_RAD
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            noise = gr.Slider(
                *(least, most), value=MechanismRequest.noise_rad, step=0.005, label=NOISE_LABEL,
                buttons=[], elem_id="mechanism-noise",
            )  # fmt: skip
            motion = gr.File(
                label=MOTION_LABEL,
                file_types=[".npz", ".npy", ".bvh"],
                type="filepath",
                height=110,
            )
            with gr.Row(elem_classes="actions"):
                start = gr.Button(SHOW, variant="primary", elem_id="mechanism-start")
                cancel = gr.Button(text.CANCEL, elem_id="mechanism-cancel", min_width=110)
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            parts = MechanismParts(
                gr.HTML(markup.idle_status(text.READY), elem_id="mechanism-status"),
                gr.HTML("", visible=False),
                gr.HTML("", visible=False, elem_id="mechanism-video"),
            )
    runner = MechanismRunner(show, config, jobs, desk, parts)
    reveal_on_click(start, parts.status)
    start.click(
        runner.run,
        inputs=[noise, motion],
        outputs=[parts.status, parts.message, parts.video],
        api_name="mechanism",
        show_progress="hidden",
        trigger_mode="once",
        concurrency_limit=None,  # JobBook lets them in one by one
    )
    cancel.click(runner.cancel, queue=False, api_visibility="private", show_progress="hidden")
    page.unload(runner.cancel)


class MechanismRunner(TabRunner[Shown]):
    """Draws both bodies for a visitor."""

    tab = "mechanism"

    def __init__(
        self, show: Show, config: AppConfig, jobs: JobBook, desk: MediaDesk, parts: MechanismParts
    ) -> None:
        super().__init__(jobs, parts.status)
        self._show = show
        self._config = config
        self._desk = desk
        self._parts = parts

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        noise, motion = values
        asked = MechanismRequest(
            motion=Path(motion) if motion else CLEAN,
            out=job.folder / "mechanism.mp4",
            noise_rad=float(noise),
            body=self._config.body,
            size=SIZE_PX,
        )
        yield _Work(self._show, asked, self._desk, cookie, self._parts)

    def blank(self) -> Updates:
        return self.stopped(markup.sentence_status(text.STARTING), "")

    def stopped(self, status: str, message: str) -> Updates:
        return {
            self._parts.status: status,
            self._parts.message: shown(message),
            self._parts.video: shown(""),
        }


@dataclass(frozen=True)
class _Work:
    """One drawing."""

    show: Show
    asked: MechanismRequest
    desk: MediaDesk
    cookie: str
    parts: MechanismParts

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> Shown:
        on_progress = share_teller("video", on_event, should_cancel)
        return self.show(self.asked, on_progress)

    def progress(self, events: list[Event]) -> Updates:
        share = last_share(events)
        if share is None:
            return {}
        return {self.parts.status: markup.sentence_status(DRAWING.format(share=share))}

    def finished(self, result: Shown) -> Updates:
        path, sentences = result
        told = "".join(f"<p>{escape(sentence)}</p>" for sentence in sentences)
        line = DRAWN.format(noise=self.asked.noise_rad)
        return {
            self.parts.status: markup.sentence_status(line),
            self.parts.video: shown(
                f'<video class="mechanism" src="{self.desk.offer(path, self.cookie)}" controls'
                f' autoplay loop muted playsinline aria-label="{escape(line)}"></video>'
                f'<div class="says">{told}</div>'
            ),
        }
