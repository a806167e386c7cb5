"""The runs of the tab "Motion" as updates of the page, and what a fresh page shows."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import CancelledRun, visitor_sentence
from app.page.parts import markup
from app.page.parts.asked import Fields, values_of
from app.page.parts.html_parts import shown
from app.page.player.player import NOTHING, Showing, browser_addresses
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates
from app.page.results.kept_runs import PARAMETER, KeptRun, told_so_far
from app.page.results.result_parts import ResultParts
from app.page.results.run_pair import RunPair
from app.page.routes.media import MediaAddresses
from app.page.tabs.motion import FormParts, ask_from_form, kept_values
from app.page.tabs.services import Services
from app.page.tabs.videos_run import VideosBehind, Wanted
from app.page.visitors.visitors import cookie_of, is_same
from app.run.many.opened import do_in_folder
from app.run.output.run_folder import end_run
from app.run.requests.request import (
    Ask,
    Event,
    Grown,
    OnEvent,
    Progress,
    ShouldCancel,
    Stage,
)

STAGES_OF_STAGE: tuple[Stage, ...] = ("speech", "motion", "numbers", "figure")
"""Videos are drawn behind it."""


@dataclass
class StageLine:
    """How far a run is, stage by stage, as a line with its bars."""

    stages: Sequence[Stage] = STAGES_OF_STAGE
    started: float = field(default_factory=time.monotonic)
    fractions: dict[Stage, float] = field(default_factory=dict)
    details: dict[Stage, str] = field(default_factory=dict)

    def html(self, events: Sequence[Event]) -> str:
        """After these events."""
        for event in events:
            if isinstance(event, Progress):
                self.fractions[event.stage] = event.fraction
                self.details[event.stage] = event.detail
        return markup.status(self.line, self.fractions, self.details, self.stages)

    @property
    def line(self) -> str:
        if not self.fractions:
            return text.STARTING_SYSTEMS
        doing = [stage for stage, fraction in self.fractions.items() if fraction < 1]
        stage = (doing or list(self.fractions))[-1]  # between two stages, the one before
        seconds = time.monotonic() - self.started
        return f"{text.STAGE_NAMES[stage]} ({seconds:.0f} s so far)"


class GenerateRunner(TabRunner[None]):
    """Generates motion for a visitor's speech."""

    tab = "generate"

    def __init__(
        self,
        services: Services,
        form: FormParts,
        results: ResultParts,
        videos: VideosBehind,
    ) -> None:
        """
        Args:
            videos: draws a run's videos once it has ended.
        """
        super().__init__(services.jobs, results.status)
        self._services = services
        self._videos = videos
        self._form = form
        self._results = results

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[RunWork]:
        ask = self.asked(job, cookie, values)
        self._videos.give_up(job.visitor)
        form = self._kept_values(job, values)
        speech = form.get("speech")  # which stays as long as the run, under its own name
        lasting = replace(ask, speech=Path(speech)) if speech else None
        showing = showing_of(job, self._services.addresses, cookie, is_drawn=ask.has_video)
        yield RunWork(
            *(ask, self._services, self._videos, self._results, job, cookie, showing),
            *(form, lasting, self._buttons(is_running=False)),
        )

    def _kept_values(self, job: Job, values: tuple[Any, ...]) -> dict[str, Any]:
        """Of the form, for whoever opens the run by its link."""
        return kept_values(self._form.fields, values, job.folder)

    def asked(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Ask:
        """The run that the form asks for; arguments and errors as of `begin`."""
        services = self._services
        told = values_of(self._form.fields, values)
        return ask_from_form(told, job.folder, services.catalogue, services.config)

    def blank(self) -> Updates:
        parts = self._results
        return {
            parts.message: shown(""),
            parts.status: markup.status(text.STARTING_SYSTEMS, {}, {}),
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


def showing_of(job: Job, addresses: MediaAddresses, cookie: str, *, is_drawn: bool) -> Showing:
    """What a job's run is going to show to its browser."""
    address = browser_addresses(addresses, cookie)
    return Showing(job.folder / "results", address, job.folder.name, is_drawn)


@dataclass
class RunWork:
    """One run, of generated motion or of given, and what the page has been shown of it."""

    ask: Ask
    """Its videos are drawn behind the stage, once it has ended."""
    services: Services
    videos: VideosBehind
    parts: ResultParts
    job: Job
    cookie: str
    showing: Showing
    form: Mapping[str, Any] = field(default_factory=dict)
    lasting: Ask | None = None
    """As `KeptRun` has it."""
    at_the_end: Updates = field(default_factory=dict)
    _shown: Updates = field(default_factory=dict)

    def __post_init__(self) -> None:
        is_made = not self.ask.motions
        self._line = StageLine([each for each in STAGES_OF_STAGE if is_made or each != "motion"])

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> None:
        """A run that fails keeps what it has, if that is any motion.

        Raises:
            Exception: of a run that has left nothing.
        """
        self._line.started = time.monotonic()  # now, after the waiting
        ask = replace(self.ask, has_video=False, is_kept=True)
        try:
            self.services.worker.do(do_in_folder, ask, on_event, should_cancel)
        except CancelledRun:
            raise
        except Exception as error:
            if not end_run(self.showing.folder, visitor_sentence(error)):
                raise

    def progress(self, events: list[Event]) -> Updates:
        updates: Updates = {self.parts.status: self._line.html(events)}
        if any(isinstance(event, Grown) for event in events) and self.showing.record.is_moving:
            updates |= told_so_far(self.showing, self.parts)
        new = {part: each for part, each in updates.items() if self._shown.get(part) != each}
        self._shown |= new
        return new

    def finished(self, result: None) -> Updates:
        kept = self.services.kept.keep(self.job, self.cookie, self.showing, self.form, self.lasting)
        ask = self.ask
        if ask.has_video and kept.record.state == "done":
            self.videos.want(self.job.visitor, Wanted(kept, ask))
        runs = {self.parts.runs: shown(self.services.kept.html(self.cookie, kept))}
        return {**kept.updates(self.parts, begins=True), **runs, **self.at_the_end}


class Opening:
    """The run whose link led to the page, in the tab that it came from, or two beside each other;
    else the example. And in each tab the visitor's runs."""

    def __init__(
        self,
        services: Services,
        tabs: gr.Tabs,
        places: Mapping[str, ResultParts],
        form: Fields,
    ) -> None:
        """
        Args:
            places: by the id of a tab where it shows results; the first is that of all runs whose
                own tab is not among them.
            form: the first tab's, to be filled in as the run was asked for.
        """
        self._kept = services.kept
        self._keep_s = services.config.keep_results_s
        self._tabs = tabs
        self._places = places
        self._first_look = services.first_look
        self._addresses = services.addresses
        self._opened = services.opened
        self._form = form

    @property
    def outputs(self) -> list[Any]:
        parts = [part for parts in self._places.values() for part in parts.all]
        return [self._tabs, *parts, *(field.part for field in self._form.values())]

    def opened(self, request: gr.Request) -> Updates:
        cookie = cookie_of(request)
        listed = shown(self._kept.html(cookie))
        updates: Updates = {parts.runs: listed for parts in self._places.values()}
        tokens = request.query_params.getlist(PARAMETER)[:2] or self._opened
        runs = [run for run in map(self._kept.find, tokens) if run is not None]
        if len(runs) == 2 and runs[0] != runs[1]:
            return {**updates, **self._pair_opened(RunPair.of(*runs), cookie)}
        if runs and len(tokens) == len(runs):
            return {**updates, **self._run_opened(runs[0], cookie)}
        parts = next(iter(self._places.values()))
        updates[parts.empty] = shown(parts.empty.value)
        if self._first_look is not None:
            updates[parts.player], updates[parts.empty] = self._first_look
        if tokens:
            gone = text.RUN_GONE.format(minutes=round(self._keep_s / 60))
            updates[parts.message] = shown(markup.notes_message([gone]))
        return updates

    def _pair_opened(self, pair: RunPair, cookie: str) -> Updates:
        parts = next(iter(self._places.values()))
        return {
            **pair.updates(parts, browser_addresses(self._addresses, cookie)),
            parts.runs: shown(self._kept.html(cookie, pair.a, pair.b)),
        }

    def _run_opened(self, run: KeptRun, cookie: str) -> Updates:
        tab = run.job.tab if run.job.tab in self._places else next(iter(self._places))
        parts, showing = self._places[tab], run.showing
        if run.job.visitor and not is_same(run.cookie, cookie):  # of nobody, it is everybody's
            showing = showing.for_browser(browser_addresses(self._addresses, cookie))
        return {
            **run.updates(parts, showing),
            parts.runs: shown(self._kept.html(cookie, run)),
            **{self._form[name].part: gr.update(value=sent) for name, sent in run.form.items()},
            self._tabs: gr.Tabs(selected=tab),
        }
