"""The runs of the tab "Motion" as updates of the page, and what a fresh page shows."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import gradio as gr

from app import text
from app.findings.verdict import short_names, verdict_of
from app.page.parts import markup
from app.page.parts.asked import form_of
from app.page.parts.html_parts import shown
from app.page.player.edited_runs import EditedRuns, own_speech
from app.page.player.player import NOTHING, Showing
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates
from app.page.results.kept_runs import PARAMETER, EndedRun, KeptRun, KeptRuns, sha256_of
from app.page.results.measures_table import measures_table
from app.page.results.result_parts import FiguresShown, ResultParts
from app.page.results.run_pair import RunPair
from app.page.results.settings import settings_of_run
from app.page.tabs.motion import Form, FormParts, kept_values, request_from_form, row_names
from app.page.tabs.services import Services
from app.page.tabs.videos_run import VideosBehind, Wanted
from app.page.visitors.visitors import cookie_of
from app.run.output.result_folder import zip_files
from app.run.pipeline import generate_all
from app.run.requests.request import (
    Artefact,
    Event,
    GenerateRequest,
    GenerateResult,
    Measured,
    OnEvent,
    Piece,
    Progress,
    ShouldCancel,
    Stage,
)
from app.run.videos.behind import VideosRequest
from app.run.videos.own_videos import VideoOptions
from app.run.words import given_words
from model.speech.transcript import Transcript

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics

STAGES_OF_STAGE: tuple[Stage, ...] = ("speech", "motion", "numbers", "figure")
"""Videos are drawn behind it."""

Generate = Callable[[GenerateRequest, OnEvent, ShouldCancel], GenerateResult]


@dataclass
class RunView:
    """What the page knows of a run so far."""

    started: float = field(default_factory=time.monotonic)
    fractions: dict[Stage, float] = field(default_factory=dict)
    details: dict[Stage, str] = field(default_factory=dict)
    artefacts: list[Artefact] = field(default_factory=list)
    has_motion: bool = False
    """Whether some of it has come."""

    def take(self, event: Event) -> None:
        if isinstance(event, Artefact):
            self.artefacts.append(event)
        elif isinstance(event, Piece):
            self.has_motion = True
        elif isinstance(event, Progress):
            self.fractions[event.stage] = event.fraction
            self.details[event.stage] = event.detail

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.started

    @property
    def line(self) -> str:
        if not self.fractions:
            return text.STARTING
        doing = [stage for stage, fraction in self.fractions.items() if fraction < 1]
        stage = (doing or list(self.fractions))[-1]  # between two stages, the one before
        return f"{text.STAGE_NAMES[stage]} ({self.seconds:.0f} s so far)"


class GenerateRunner(TabRunner[GenerateResult]):
    """Generates motion for a visitor's speech."""

    tab = "generate"

    def __init__(
        self,
        services: Services,
        form: FormParts,
        results: ResultParts,
        videos: VideosBehind,
        edited: EditedRuns | None = None,
    ) -> None:
        """
        Args:
            videos: draws a run's videos once it has ended.
            edited: where runs go whose gestures can be edited; None where none can.
        """
        super().__init__(services.jobs, results.status)
        self._services = services
        self._videos = videos
        self._edited = edited
        self._form = form
        self._results = results

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        asked = self.asked(job, cookie, values)
        self._videos.give_up(job.visitor)
        yield _Work(
            generate=partial(self._services.worker.do, generate_all),
            asked=asked,
            job=job,
            showing=self._showing(asked, job, cookie, given_words(asked.transcript)),
            figures=FiguresShown(self._services.addresses, cookie),
            parts=self._results,
            kept=self._services.kept,
            cookie=cookie,
            at_the_end=self._buttons(is_running=False),
            videos=self._videos,
            edited=self._edited,
            form=self._kept_values(job, values),
        )

    def _kept_values(self, job: Job, values: tuple[Any, ...]) -> dict[str, Any]:
        """Of the form, for whoever opens the run by its link."""
        return kept_values(form_of(Form, values), job.folder)

    def _showing(self, asked: GenerateRequest, job: Job, cookie: str, said: Transcript) -> Showing:
        addresses = self._services.addresses
        showing = Showing.of_run(asked, row_names(asked), job.folder, addresses, cookie, said)
        showing.is_drawn = asked.has_video
        return showing

    def asked(self, job: Job, cookie: str, values: tuple[Any, ...]) -> GenerateRequest:
        """The run that the form asks for; arguments and errors as of `begin`."""
        services = self._services
        form = form_of(Form, values)
        return request_from_form(form, job.folder, services.catalogue, services.config)

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
            parts.seen: shown(""),
            parts.figures: shown(""),
            parts.numbers: shown(""),
            parts.downloads_part: gr.update(visible=False),
        }

    def waits(self) -> Updates:
        """From the click until its turn has come."""
        line = markup.sentence_status(text.WAITING)
        return {self._results.status: line, self._form.cancel: gr.update(visible=True)}

    def idle(self) -> Updates:
        ready = markup.idle_status(text.READY)
        return {self._results.status: ready, **self._buttons(is_running=False)}

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
    videos: VideosBehind
    edited: EditedRuns | None
    form: dict[str, Any]
    view: RunView = field(default_factory=RunView)

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> GenerateResult:
        self.view.started = time.monotonic()  # now, after the waiting
        self.showing.begin()
        return self.generate(replace(self.asked, has_video=False), on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        parts, run = self.parts, self.view
        measured: Updates = {}
        for event in events:
            run.take(event)
            if isinstance(event, Artefact):
                self.showing.take(event)
                self.figures.take(event)
            elif isinstance(event, Piece):
                self.showing.take_piece(event)
            elif isinstance(event, Measured):
                measured[parts.verdict] = shown(_verdict(event.diagnostics))
                measured[parts.numbers] = shown(measures_table(event.diagnostics))
        line = markup.status(run.line, run.fractions, run.details, STAGES_OF_STAGE)
        updates: Updates = {parts.status: line, **measured}
        if run.artefacts or run.has_motion:
            updates[parts.player] = self.showing.value()
            updates[parts.figures] = shown(self.figures.html())
        return updates

    def finished(self, result: GenerateResult) -> Updates:
        ended = self._ended(result)
        lasting = replace(self.asked, speech=own_speech(self.asked, self.form))
        words = result.said.words
        if self.edited is not None:
            self.edited.keep(self.cookie, self.job.folder, lasting, self.showing, words)
        kept = self.kept.keep(self.job, self.cookie, ended)
        runs = {self.parts.runs: shown(self.kept.html(self.cookie, kept))}
        if self.asked.has_video:
            self.videos.want(self.job.visitor, Wanted(kept, self._videos_asked()))
        return {**ended.updates(self.parts, begins=True), **runs, **self.at_the_end}

    def _videos_asked(self) -> VideosRequest:
        asked = self.asked
        looks = (asked.display, asked.size, asked.framing, asked.close_ups, asked.has_posters)
        return VideosRequest(
            *(self.showing.drawn(), self.job.folder, self.showing.sound(), asked.joint, asked.body),
            VideoOptions(*looks),
        )

    def _ended(self, result: GenerateResult) -> EndedRun:
        self.showing.add_words(result.said)
        rows = f"{len(result.names)} {'motion' if len(result.names) == 1 else 'motions'}"
        line = text.DONE.format(seconds=self.view.seconds, rows=rows, frames=result.num_frames)
        if self.asked.take is not None and self.asked.take.why_less:
            line = f"{line} {self.asked.take.why_less}"
        return EndedRun(
            title=_title(self.asked),
            settings=settings_of_run(self.asked),
            speech_sha256=sha256_of(self.asked.speech),
            line=line,
            notes=result.notes,
            verdict=_verdict(result.diagnostics),
            diagnostics=result.diagnostics,
            showing=self.showing,
            figures=self.figures,
            bundle=zip_files(result.files, self.job.folder / "co-speech-motion.zip"),
            files=result.files,
            form=self.form,
        )


def _title(asked: GenerateRequest) -> str:
    systems = ", ".join(short_names(asked.systems).values())
    return f"{asked.speech.stem}: {systems}; seed {asked.seed}"


def _verdict(diagnostics: Diagnostics) -> str:
    verdict = verdict_of(diagnostics)
    return "" if verdict is None else markup.verdict(verdict.numbers, verdict.judgement)


class Opening:
    """The run whose link led to the page, in the tab that it came from, or two beside each other;
    else the example. And in each tab the visitor's runs."""

    def __init__(
        self,
        services: Services,
        tabs: gr.Tabs,
        places: Mapping[str, ResultParts],
        form: Mapping[str, Any],
    ) -> None:
        """
        Args:
            places: by the id of a tab where it shows results; the first is that of all runs whose
                own tab is not among them.
            form: fields of the first tab's form by name, to be filled in as the run was asked for.
        """
        self._kept = services.kept
        self._keep_s = services.config.keep_results_s
        self._tabs = tabs
        self._places = places
        self._first_look = services.first_look
        self._form = form

    @property
    def outputs(self) -> list[Any]:
        parts = [part for parts in self._places.values() for part in parts.all]
        return [self._tabs, *parts, *self._form.values()]

    def opened(self, request: gr.Request) -> Updates:
        cookie = cookie_of(request)
        listed = shown(self._kept.html(cookie))
        updates: Updates = {parts.runs: listed for parts in self._places.values()}
        tokens = request.query_params.getlist(PARAMETER)[:2]
        runs = [run for run in map(self._kept.find, tokens) if run is not None]
        if len(runs) == 2 and runs[0] != runs[1]:
            return {**updates, **self._pair_opened(RunPair.of(*runs), cookie)}
        if runs and len(tokens) == len(runs):
            return {**updates, **self._run_opened(runs[0], cookie)}
        parts = next(iter(self._places.values()))
        if self._first_look is not None:
            updates[parts.player], updates[parts.empty] = self._first_look.updates()
        if tokens:
            gone = text.RUN_GONE.format(minutes=round(self._keep_s / 60))
            updates[parts.message] = shown(markup.notes_message([gone]))
        return updates

    def _pair_opened(self, pair: RunPair, cookie: str) -> Updates:
        parts = next(iter(self._places.values()))
        return {
            **pair.updates(parts, cookie),
            parts.runs: shown(self._kept.html(cookie, pair.a, pair.b)),
            parts.empty: gr.update(visible=False),
        }

    def _run_opened(self, run: KeptRun, cookie: str) -> Updates:
        tab = run.job.tab if run.job.tab in self._places else next(iter(self._places))
        parts = self._places[tab]
        return {
            **run.run.for_visitor(cookie).updates(parts),
            parts.runs: shown(self._kept.html(cookie, run)),
            parts.empty: gr.update(visible=False),
            **{self._form[name]: gr.update(value=value) for name, value in run.run.form.items()},
            self._tabs: gr.Tabs(selected=tab),
        }
