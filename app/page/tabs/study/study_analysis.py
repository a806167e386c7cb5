"""The part of the tab "User study" that turns answers into a report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import form_of
from app.page.parts.html_parts import reveal_on_click, shown
from app.page.parts.listeners import IN_TURN
from app.page.queue.in_turn import Updates
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner
from app.page.tabs.services import Services
from app.page.visitors.uploads import MAX_FILES
from app.run.requests.request import Event, OnEvent, ShouldCancel

TITLE = "Analyse the answers"
INTRODUCTION = (
    "Drop in what participants sent or saved, and the key from the researcher's zip. The same as "
    "<code>python -m app study analyse</code>, which needs no upload. All of it is deleted here "
    "within the hour."
)
NO_ANSWERS = "There are no answers yet: drop in at least one file that a participant saved."
NO_KEY = "The key is missing: drop in key.json from the researcher's zip."
TOO_MANY = "At most {limit} files are analysed here; {count} were given. Use the command line."
ANALYSED = "Analysed. The report stands below; its files are the ones to keep."

Analyse = Callable[[list[Path], Path, Path, OnEvent, ShouldCancel], tuple[Path, ...]]
"""Answers, key and folder to the files written there, the report first."""


@dataclass(frozen=True)
class AnalysisForm:
    """What the visitor has filled in, as Gradio hands it over."""

    answers: list[str] | None
    key: str | None


@dataclass(frozen=True)
class AnalysisParts:
    """Where the tab shows what comes of it."""

    status: gr.HTML
    message: gr.HTML
    report: gr.HTML
    files: gr.File

    @property
    def all(self) -> list[Any]:
        return [self.status, self.message, self.report, self.files]


def build_analysis(page: gr.Blocks, services: Services) -> None:
    """Lay out the part inside the current context and wire it."""
    gr.HTML(f'{markup.heading(TITLE)}<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            answers = gr.File(
                label="Answers (.json)",
                file_count="multiple",
                file_types=[".json"],
                type="filepath",
                height=170,
                elem_id="analysis-answers",
            )
            key = gr.File(
                label="The key: key.json",
                file_types=[".json"],
                type="filepath",
                height=120,
                elem_id="analysis-key",
            )
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Analyse", variant="primary", elem_id="analysis-start")
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            parts = AnalysisParts(
                gr.HTML(markup.idle_status(text.READY), elem_id="analysis-status"),
                gr.HTML("", visible=False),
                gr.HTML("", visible=False, elem_id="analysis-report"),
                gr.File(
                    label=text.FILES_LABEL,
                    file_count="multiple",
                    interactive=False,
                    visible=False,
                    elem_id="analysis-files",
                ),
            )
    runner = AnalysisRunner(services, parts)
    reveal_on_click(start, parts.status)
    start.click(runner.run, [answers, key], parts.all, api_visibility="private", **IN_TURN)
    page.unload(runner.cancel)


class AnalysisRunner(TabRunner[tuple[Path, ...]]):
    """Analyses answers for a researcher."""

    tab = "analysis"

    def __init__(self, services: Services, parts: AnalysisParts) -> None:
        super().__init__(services.jobs, parts.status)
        self._analyse: Analyse = services.processes.analyse_study
        self._parts = parts

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        form = form_of(AnalysisForm, values)
        if not form.answers:
            raise RunError(NO_ANSWERS)
        if not form.key:
            raise RunError(NO_KEY)
        if len(form.answers) > MAX_FILES:
            raise RunError(TOO_MANY.format(limit=MAX_FILES, count=len(form.answers)))
        answers = [Path(path) for path in form.answers]
        yield _Work(self._analyse, answers, Path(form.key), job.folder / "results", self._parts)

    def blank(self) -> Updates:
        return self.stopped(markup.sentence_status(text.STARTING), "")

    def stopped(self, status: str, message: str) -> Updates:
        parts = self._parts
        return {
            parts.status: status,
            parts.message: shown(message),
            parts.report: shown(""),
            parts.files: gr.update(visible=False),
        }


@dataclass(frozen=True)
class _Work:
    """One analysis."""

    analyse: Analyse
    answers: list[Path]
    key: Path
    out: Path
    parts: AnalysisParts

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> tuple[Path, ...]:
        return self.analyse(self.answers, self.key, self.out, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        return {}

    def finished(self, result: tuple[Path, ...]) -> Updates:
        report, *_ = result
        return {
            self.parts.status: markup.sentence_status(ANALYSED),
            self.parts.report: shown(framed(report.read_text("utf-8"))),
            self.parts.files: gr.update(value=[str(path) for path in result], visible=True),
        }


def framed(report: str) -> str:
    """A report in a frame of its own, where nothing of it can run: names in it may be anyone's."""
    return (
        f'<iframe class="report" sandbox="" title="Report of the study" '
        f'srcdoc="{escape(report, quote=True)}"></iframe>'
    )
