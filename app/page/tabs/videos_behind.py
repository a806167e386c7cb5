"""Videos of a run that has ended: drawn behind its stage, by a run of their own that comes last."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import CancelledRun, visitor_sentence
from app.page.parts import markup
from app.page.parts.listeners import PRIVATE
from app.page.queue.follow import last_share
from app.page.queue.in_turn import InTurn, Updates
from app.page.queue.jobs import Job, JobBook, Tab
from app.page.results.kept_runs import KeptRun, KeptRuns
from app.page.results.result_parts import ResultParts
from app.page.tabs.services import Services
from app.page.visitors.visitors import address_of, visitor_of
from app.run.output.result_folder import zip_files
from app.run.requests.request import Artefact, Event, OnEvent, ShouldCancel
from app.run.videos.behind import VideosRequest

Draw = Callable[[VideosRequest, OnEvent, ShouldCancel], tuple[Path, ...]]
"""As `app.run.videos.behind.draw_behind`."""


@dataclass(frozen=True)
class Wanted:
    """What is to be drawn of a run, and what was said when that had ended."""

    kept: KeptRun
    request: VideosRequest


class VideosBehind:
    """Draws what a tab's runs have left to be drawn, one visitor's newest run at a time."""

    def __init__(self, services: Services, parts: ResultParts, tab: Tab) -> None:
        """
        Args:
            tab: that of the videos.
        """
        self._services = services
        self._jobs = services.jobs
        self._parts = parts
        self._tab: Tab = tab
        self._wanted: dict[str, Wanted] = {}
        self._lock = threading.Lock()

    def want(self, visitor: str, wanted: Wanted) -> None:
        """Have these drawn as soon as the page asks."""
        with self._lock:
            self._wanted[visitor] = wanted

    def give_up(self, visitor: str) -> None:
        """Another run begins: nobody wants the videos of the one before any more."""
        with self._lock:
            self._wanted.pop(visitor, None)
        self._jobs.cancel(visitor, self._tab)

    def left(self, request: gr.Request) -> None:
        """The visitor has closed the page."""
        self.give_up(visitor_of(request))

    def follow(self, run: Any) -> None:
        """Draw after each run of a button's, whose event is ``run``."""
        run.then(
            self.run, outputs=self._outputs, **PRIVATE,
            trigger_mode="multiple", concurrency_limit=None,
        )  # fmt: skip

    @property
    def _outputs(self) -> list[Any]:
        parts = self._parts
        return [parts.status, parts.player, parts.bundle, parts.files]

    def run(self, request: gr.Request) -> Iterator[Updates]:
        """Updates of the tab while videos of the visitor's last run are drawn, if it wants any."""
        visitor = visitor_of(request)
        with self._lock:
            wanted = self._wanted.pop(visitor, None)
        if wanted is None:
            yield {
                self._parts.status: gr.skip()
            }  # of a listener that gives nothing Gradio empties all parts
            return

        try:
            yield from _Behind(self._jobs, self._parts, wanted).in_turn(
                lambda: self._jobs.open(visitor, self._tab, address_of(request)),
                lambda job: nullcontext(self._work(wanted, job)),
            )
        except CancelledRun:
            return  # another run has begun, and shows itself
        except Exception as error:  # whatever it is, the run that has ended stays and says so
            sentence = text.VIDEOS_FAILED.format(why=visitor_sentence(error))
            yield {self._parts.status: _line(wanted, sentence)}

    def _work(self, wanted: Wanted, job: Job) -> _Work:
        asked = wanted.request.within(job.folder)
        draw = self._services.processes.draw_behind
        return _Work(draw, asked, wanted, self._parts, self._services.kept)


class _Behind(InTurn[tuple[Path, ...]]):
    """What is said of videos in the line of the run that they are of."""

    def __init__(self, jobs: JobBook, parts: ResultParts, wanted: Wanted) -> None:
        super().__init__(jobs)
        self._parts = parts
        self._wanted = wanted

    def blank(self) -> Updates:
        return {self._parts.status: gr.skip()}

    def waits(self, ahead: int) -> Updates:
        line = _line(self._wanted, text.VIDEOS_WAIT) if ahead else gr.skip()
        return {self._parts.status: line}

    def stops(self, job: Job) -> Updates:
        return self.blank()


@dataclass(frozen=True)
class _Work:
    """The videos of one run."""

    draw: Draw
    asked: VideosRequest
    wanted: Wanted
    parts: ResultParts
    kept: KeptRuns

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> tuple[Path, ...]:
        return self.draw(self.asked, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        showing = self.wanted.kept.run.showing
        updates: Updates = {}
        files = [event for event in events if isinstance(event, Artefact)]
        if showing is not None and files:
            for file in files:
                showing.take(file)
            updates[self.parts.player] = showing.value(is_over=True)
        share = last_share(events)
        if share is not None:
            updates[self.parts.status] = _line(self.wanted, text.VIDEOS_COMING.format(share=share))
        return updates

    def finished(self, result: tuple[Path, ...]) -> Updates:
        run = self.wanted.kept.run
        files = (*run.files, *result)
        bundle = zip_files(files, run.bundle)
        self.kept.complete(self.wanted.kept.token, bundle, files)
        return {
            self.parts.status: _line(self.wanted, text.VIDEOS_DONE),
            self.parts.bundle: gr.update(value=str(bundle)),
            self.parts.files: [str(file) for file in files],
        }


def _line(wanted: Wanted, sentence: str) -> str:
    return markup.sentence_status(f"{wanted.kept.run.line} {sentence}")
