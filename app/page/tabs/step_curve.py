"""The part of the tab "Systems" that measures quality against time on this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import form_of
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import mount, reveal_on_click, shown
from app.page.results.figures_shown import FiguresShown
from app.page.serving.follow import last_share
from app.page.serving.jobs import Job, JobBook
from app.page.serving.media import MediaDesk
from app.page.serving.runner import TabRunner, Updates
from app.run.request import Event, OnEvent, ShouldCancel
from app.run.telling import share_teller
from model.systems.globaldiff.config import BEST

if TYPE_CHECKING:
    from app.run.step_curve import StepCurve, StepCurveRequest

TITLE = "What steps buy, measured here"
INTRODUCTION = (
    "The same speech with 1, 2, 4, 8 and 25 steps: how the fingertip jerks, how far the motion is "
    "from that of 25 steps, and what a frame costs on the machine that serves this page. The same "
    "as <code>python -m app steps</code>."
)
AT_FIRST = ("globaldiff/full", BEST, "asynfusion/lcm-async", "gan/5")
NO_SYSTEM = "Tick at least one system to measure."
NO_SPEECH = "Upload speech to measure with; this installation has no examples."
MEASURING = "Measuring: {share:.0%}"
MEASURED = "Measured {count} motions."

Measure = Callable[["StepCurveRequest", Callable[[float], None]], "StepCurve"]


@dataclass(frozen=True)
class StepCurveParts:
    """Where the plot and what is said of it are shown."""

    status: gr.HTML
    message: gr.HTML
    figure: gr.HTML


def build_step_curve(
    page: gr.Blocks,
    catalogue: Catalogue,
    config: AppConfig,
    jobs: JobBook,
    desk: MediaDesk,
    measure: Measure,
) -> None:
    """Lay out the part inside the current context and wire it.

    Args:
        measure: does the measuring, as `app.run.step_curve.measure_step_curve`.
    """
    gr.HTML(f'{markup.heading(TITLE)}<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            systems = gr.CheckboxGroup(
                choices=list(catalogue.systems),
                value=[name for name in AT_FIRST if name in catalogue.systems],
                label="Systems",
                elem_id="steps-systems",
            )
            speech = gr.File(
                label="Speech (optional: an example otherwise; ten seconds are used)",
                file_types=["audio"],
                type="filepath",
                height=110,
            )
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Measure", variant="primary", elem_id="steps-start")
                cancel = gr.Button(text.CANCEL, elem_id="steps-cancel", min_width=110)
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            parts = StepCurveParts(
                gr.HTML(markup.idle_status(text.READY), elem_id="steps-status"),
                gr.HTML("", visible=False),
                gr.HTML(
                    "", visible=False, js_on_load=mount("figures.js", "mountFigures"),
                    apply_default_css=False, elem_id="steps-figures",
                ),
            )  # fmt: skip
    example = catalogue.examples[0].path if catalogue.examples else None
    runner = StepCurveRunner(measure, example, config, jobs, desk, parts)
    reveal_on_click(start, parts.status)
    start.click(
        runner.run,
        inputs=[systems, speech],
        outputs=[parts.status, parts.message, parts.figure],
        api_name="steps",
        show_progress="hidden",
        trigger_mode="once",
        concurrency_limit=None,  # JobBook lets them in one by one
    )
    cancel.click(runner.cancel, queue=False, api_visibility="private", show_progress="hidden")
    page.unload(runner.cancel)


@dataclass(frozen=True)
class StepCurveForm:
    """What the visitor has filled in, as Gradio hands it over."""

    systems: list[str]
    speech: str | None


class StepCurveRunner(TabRunner["StepCurve"]):
    """Measures ticked systems with few and with many steps."""

    tab = "steps"

    def __init__(
        self,
        measure: Measure,
        example: Path | None,
        config: AppConfig,
        jobs: JobBook,
        desk: MediaDesk,
        parts: StepCurveParts,
    ) -> None:
        super().__init__(jobs, parts.status)
        self._measure = measure
        self._example = example
        self._config = config
        self._desk = desk
        self._parts = parts

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        from app.run.step_curve import StepCurveRequest

        form = form_of(StepCurveForm, values)
        systems, path = form.systems, Path(form.speech) if form.speech else self._example
        if not systems:
            raise RunError(NO_SYSTEM)
        if path is None:
            raise RunError(NO_SPEECH)
        asked = StepCurveRequest(
            speech=path,
            out=job.folder / "results",
            systems=tuple(systems),
            weights=self._config.weights,
            max_speech_s=self._config.max_speech_s,
        )
        yield _Work(self._measure, asked, FiguresShown(self._desk, cookie), self._parts)

    def blank(self) -> Updates:
        return self.stopped(markup.sentence_status(text.STARTING), "")

    def stopped(self, status: str, message: str) -> Updates:
        return {
            self._parts.status: status,
            self._parts.message: shown(message),
            self._parts.figure: shown(""),
        }


@dataclass(frozen=True)
class _Work:
    """One run of the measuring."""

    measure: Measure
    asked: StepCurveRequest
    figures: FiguresShown
    parts: StepCurveParts

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> StepCurve:
        on_progress = share_teller("numbers", on_event, should_cancel)
        return self.measure(self.asked, on_progress)

    def progress(self, events: list[Event]) -> Updates:
        share = last_share(events)
        if share is None:
            return {}
        return {self.parts.status: markup.sentence_status(MEASURING.format(share=share))}

    def finished(self, result: StepCurve) -> Updates:
        self.figures.take_files(result.files)
        line = MEASURED.format(count=len(result.points))
        return {
            self.parts.status: markup.sentence_status(line),
            self.parts.figure: shown(self.figures.html()),
        }
