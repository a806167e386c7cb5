"""The runs of the tab "Motion": their events and results as updates of the page."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.findings.verdict import verdict_of
from app.page.parts import markup
from app.page.parts.asked import form_of
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import shown
from app.page.results.figures_shown import FiguresShown
from app.page.results.first_look_shown import FirstLookDesk
from app.page.results.kept_runs import PARAMETER, KeptRuns
from app.page.results.measures_table import measures_table
from app.page.results.player import NOTHING, Showing
from app.page.serving.jobs import Job, JobBook
from app.page.serving.media import MediaDesk
from app.page.serving.runner import TabRunner, Updates
from app.page.serving.visitors import cookie_of
from app.page.tabs.generate import FormParts, ResultParts
from app.page.tabs.generate_form import Form, request_from_form, row_names
from app.run.request import (
    Artefact,
    Event,
    GenerateRequest,
    GenerateResult,
    OnEvent,
    ShouldCancel,
    Stage,
)
from app.run.result_folder import zip_files
from model.speech.transcript import read_words

Generate = Callable[[GenerateRequest, OnEvent, ShouldCancel], GenerateResult]


@dataclass
class RunView:
    """What the page knows of a run so far."""

    started: float = field(default_factory=time.monotonic)
    fractions: dict[Stage, float] = field(default_factory=dict)
    details: dict[Stage, str] = field(default_factory=dict)
    artefacts: list[Artefact] = field(default_factory=list)

    def take(self, event: Event) -> None:
        if isinstance(event, Artefact):
            self.artefacts.append(event)
        else:
            self.fractions[event.stage] = event.fraction
            self.details[event.stage] = event.detail

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.started

    @property
    def line(self) -> str:
        doing = [stage for stage, fraction in self.fractions.items() if fraction < 1]
        if not doing:
            return text.STARTING
        return f"{text.STAGE_NAMES[doing[-1]]} ({self.seconds:.0f} s so far)"


class GenerateRunner(TabRunner[GenerateResult]):
    """Generates motion for a visitor's speech."""

    tab = "generate"

    def __init__(
        self,
        generate: Generate,
        catalogue: Catalogue,
        config: AppConfig,
        jobs: JobBook,
        desk: MediaDesk,
        form: FormParts,
        results: ResultParts,
        kept: KeptRuns,
    ) -> None:
        super().__init__(jobs, results.status)
        self._kept = kept
        self._generate = generate
        self._catalogue = catalogue
        self._config = config
        self._desk = desk
        self._form = form
        self._results = results

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        asked = self.asked(job, cookie, values)
        words = read_words(asked.transcript) if asked.transcript else ()
        yield _Work(
            generate=self._generate,
            asked=asked,
            job=job,
            showing=Showing.of_run(
                *(asked, row_names(asked), job.folder, self._desk, cookie, words)
            ),
            figures=FiguresShown(self._desk, cookie),
            parts=self._results,
            kept=self._kept,
            cookie=cookie,
            at_the_end=self._buttons(is_running=False),
        )

    def opened(self, request: gr.Request, first_look: FirstLookDesk | None) -> Updates:
        """What a page shows that has just been opened: the run whose link led there, else the
        example; and the visitor's runs."""
        parts, cookie = self._results, cookie_of(request)
        token = dict(request.query_params).get(PARAMETER, "")
        run = self._kept.find(token)
        if run is not None:
            return {
                **run.open_for(cookie, parts),
                parts.runs: shown(self._kept.html(cookie, run)),
                parts.empty: gr.update(visible=False),
            }
        updates: Updates = {parts.runs: shown(self._kept.html(cookie))}
        if first_look is not None:
            updates[parts.player], updates[parts.empty] = first_look.updates()
        if token:
            gone = text.RUN_GONE.format(minutes=round(self._config.keep_results_s / 60))
            updates[parts.message] = shown(markup.notes_message([gone]))
        return updates

    def asked(self, job: Job, cookie: str, values: tuple[Any, ...]) -> GenerateRequest:
        """The run that the form asks for; arguments and errors as of `begin`."""
        return request_from_form(form_of(Form, values), job.folder, self._catalogue, self._config)

    def blank(self) -> Updates:
        parts = self._results
        return {
            parts.message: shown(""),
            parts.status: markup.status(text.STARTING, {}, {}),
            parts.empty: gr.update(visible=False),
            parts.runs: shown(""),
            **self._without_results(),
            parts.files: None,
            **self._buttons(is_running=True),
        }

    def stopped(self, status: str, message: str) -> Updates:
        parts = self._results
        return {
            parts.message: shown(message),
            parts.status: status,
            parts.empty: shown(parts.empty.value),  # an example that played went with its player
            **self._without_results(),
            **self._buttons(is_running=False),
        }

    def _without_results(self) -> Updates:
        parts = self._results
        return {
            parts.verdict: shown(""),
            parts.player: NOTHING,
            parts.figures: shown(""),
            parts.numbers: shown(""),
            parts.downloads_part: gr.update(visible=False),
        }

    def _buttons(self, is_running: bool) -> Updates:
        return {
            self._form.generate: gr.update(interactive=not is_running),
            self._form.cancel: gr.update(visible=is_running),
        }


@dataclass
class _Work:
    """One run, and what the page has been shown of it."""

    generate: Generate
    asked: GenerateRequest
    job: Job
    showing: Showing
    figures: FiguresShown
    parts: ResultParts
    kept: KeptRuns
    cookie: str
    at_the_end: Updates
    view: RunView = field(default_factory=RunView)

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> GenerateResult:
        self.view.started = time.monotonic()  # now, after the waiting
        return self.generate(self.asked, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        for event in events:
            self.view.take(event)
            if isinstance(event, Artefact):
                self.showing.take(event)
                self.figures.take(event)
        parts, run = self.parts, self.view
        updates: Updates = {parts.status: markup.status(run.line, run.fractions, run.details)}
        if run.artefacts:
            updates[parts.player] = self.showing.value()
            updates[parts.figures] = shown(self.figures.html())
        return updates

    def finished(self, result: GenerateResult) -> Updates:
        over = self._over(result)
        kept = self.kept.keep(self.job.folder, self.cookie, _title(self.asked), over.for_visitor)
        runs = {self.parts.runs: shown(self.kept.html(self.cookie, kept))}
        return {**over.updates(self.parts), **runs, **self.at_the_end}

    def _over(self, result: GenerateResult) -> _Over:
        rows = f"{len(result.names)} {'motion' if len(result.names) == 1 else 'motions'}"
        line = text.DONE.format(seconds=self.view.seconds, rows=rows, frames=result.num_frames)
        self.figures.html(result.diagnostics)
        return _Over(
            status=markup.status(line, dict.fromkeys(self.view.fractions, 1.0), {}),
            notes=markup.notes_message(result.notes),
            verdict=_verdict(result),
            numbers=measures_table(result.diagnostics),
            showing=self.showing,
            figures=self.figures,
            bundle=zip_files(result.files, self.job.folder / "co-speech-motion.zip"),
            files=result.files,
        )


@dataclass(frozen=True)
class _Over:
    """A run that has ended, as any browser can be shown it."""

    status: str
    notes: str
    verdict: str
    numbers: str
    showing: Showing
    figures: FiguresShown
    bundle: Path
    files: tuple[Path, ...]

    def updates(self, parts: ResultParts) -> Updates:
        return {
            parts.status: self.status,
            parts.message: shown(self.notes),
            parts.verdict: shown(self.verdict),
            parts.player: self.showing.value(is_over=True),
            parts.figures: shown(self.figures.html()),
            parts.numbers: shown(self.numbers),
            parts.downloads_part: gr.update(visible=True),
            parts.bundle: gr.update(value=str(self.bundle)),
            parts.files: [str(file) for file in self.files],
        }

    def for_visitor(self, cookie: str, parts: ResultParts) -> Updates:
        """For another browser, whose files have addresses of their own."""
        showing, figures = self.showing.for_visitor(cookie), self.figures.for_visitor(cookie)
        return replace(self, showing=showing, figures=figures).updates(parts)


def _title(asked: GenerateRequest) -> str:
    return f"{asked.speech.stem}: {', '.join(asked.systems)}"


def _verdict(result: GenerateResult) -> str:
    verdict = verdict_of(result.diagnostics)
    return "" if verdict is None else markup.verdict(verdict.numbers, verdict.judgement)
