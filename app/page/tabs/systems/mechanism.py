"""The part that opens the tab "Systems": the paper's argument on two bodies, without a network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.html_parts import AT_ONCE, in_turn, mount, player_part, reveal_on_click, shown
from app.page.player.player import NOTHING, Showing
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates, last_share
from app.page.results.result_parts import figures_html
from app.page.tabs.motion_run import showing_of
from app.page.tabs.services import Services
from app.run.examples import CLEAN
from app.run.experiments.mechanism import (
    DRAWN,
    NOISE_RAD,
    VIDEO,
    MechanismAsk,
    show_mechanism,
)
from app.run.output.run_folder import file_of
from app.run.requests.request import Event, Grown, OnEvent, ShouldCancel

TITLE = "The argument in ten seconds: equal noise on local and on global rotations"
INTRODUCTION = (
    "One motion, two bodies. Every joint is turned at random by the same amount, once against its "
    "parent and once in the world. No network takes part. Look at the fingertips, then move the "
    "slider."
)
NOISE_LABEL = "Noise on every joint, radians about each axis"
MOTION_LABEL = "Motion of your own (optional)"
SHOW = "Show both bodies"
DRAWING = "Drawing: {share:.0%}"
_WITH_GL = (
    "(noise, motion) => [noise, motion, !document.createElement('canvas').getContext('webgl2')]"
)
"""Values of the form, and whether this browser needs a video: one that draws no bodies does."""
_ON_OPENING = (
    '() => { import(new URL("web/once.js", document.baseURI))'
    '.then(({ pressOnce }) => pressOnce("mechanism-first")); }'
)


@dataclass(frozen=True)
class MechanismParts:
    """Where bodies and sentences are shown."""

    status: gr.HTML
    message: gr.HTML
    player: gr.HTML
    says: gr.HTML
    """What the bodies show, and a video where the browser draws none."""


def build_mechanism(tab: gr.Tab, services: Services) -> None:
    """Lay out the part inside the current context and wire it.

    Args:
        tab: that it opens; both bodies move as soon as that is looked at.
    """
    gr.HTML(f'{markup.heading(TITLE)}<p class="hint">{INTRODUCTION}</p>')
    least, most = NOISE_RAD
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            noise = gr.Slider(
                *(least, most), value=MechanismAsk.noise_rad, step=0.005, label=NOISE_LABEL,
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
                player_part("mechanism-"),
                gr.HTML(
                    "",
                    visible=False,
                    js_on_load=mount("figures.js", "mountFigures"),
                    apply_default_css=False,
                    elem_id="mechanism-says",
                ),
            )
    needs_video = gr.Checkbox(False, visible=False)
    first = gr.Button(elem_id="mechanism-first", elem_classes="told-elsewhere")
    runner = MechanismRunner(services, parts)
    reveal_on_click(start, parts.status)
    asks: dict[str, Any] = {
        "inputs": [noise, motion, needs_video],
        "outputs": [parts.status, parts.message, parts.player, parts.says],
        "js": _WITH_GL,
        **in_turn(parts.status),
    }
    runs: list[Any] = [
        start.click(runner.run, **asks, api_name="mechanism"),
        first.click(runner.run, **asks, api_visibility="private"),
    ]
    tab.select(None, js=_ON_OPENING, api_visibility="private")
    cancel.click(runner.cancel, outputs=asks["outputs"], cancels=runs, **AT_ONCE)


class MechanismRunner(TabRunner[None]):
    """Moves both bodies for a visitor."""

    tab = "mechanism"

    def __init__(self, services: Services, parts: MechanismParts) -> None:
        super().__init__(services.jobs, parts.status)
        self._services = services
        self._parts = parts

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        noise, motion, needs_video = values
        showing = showing_of(job, self._services.addresses, cookie, is_drawn=False)
        asked = MechanismAsk(
            motions=(Path(motion) if motion else CLEAN,),
            out=showing.folder,
            body=self._services.config.body,
            has_video=needs_video is True,
            noise_rad=float(noise),
            is_kept=True,
        )
        asked.check()
        yield _Work(partial(self._services.worker.do, show_mechanism), asked, self._parts, showing)

    def blank(self) -> Updates:
        return self.stopped(markup.sentence_status(text.STARTING), "")

    def stopped(self, status: str, message: str) -> Updates:
        return {
            self._parts.status: status,
            self._parts.message: shown(message),
            self._parts.player: NOTHING,
            self._parts.says: shown(""),
        }


@dataclass(frozen=True)
class _Work:
    """One run."""

    show: Callable[[MechanismAsk, OnEvent, ShouldCancel], None]
    asked: MechanismAsk
    parts: MechanismParts
    showing: Showing

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> None:
        self.show(self.asked, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        updates: Updates = {}
        line = DRAWN.format(noise=self.asked.noise_rad)
        if any(isinstance(event, Grown) for event in events) and self.showing.record.is_moving:
            updates[self.parts.player] = self._played()
            updates[self.parts.status] = markup.sentence_status(line)
        share = last_share(events)
        if share is not None and self.asked.has_video:
            line = DRAWING.format(share=share)
            updates[self.parts.status] = markup.sentence_status(line)
        return updates

    def _played(self) -> dict[str, Any]:
        return self.showing.value() | {"plays": True}

    def finished(self, result: None) -> Updates:
        record, address = self.showing.record, self.showing.address
        told = "".join(f"<p>{escape(sentence)}</p>" for sentence in record.notes)
        files = [path for name in record.files if (path := file_of(self.showing.folder, name))]
        video = "".join(
            f'<video class="mechanism" src="{address(path)}" controls autoplay loop muted'
            f' playsinline aria-label="{escape(record.sentence)}"></video>'
            for path in files
            if path.name == VIDEO
        )
        figures = figures_html(files, address)
        return {
            self.parts.status: markup.sentence_status(record.sentence),
            self.parts.player: self._played(),
            self.parts.says: shown(f'{video}<div class="says">{told}</div>{figures}'),
        }
