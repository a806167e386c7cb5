"""A run in its turn among all, followed while it goes: events in batches, errors told."""

from __future__ import annotations

import os
import queue
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, Generic, Protocol, TypeVar

from app import text
from app.errors import CancelledRun
from app.page.queue.jobs import Job, JobBook
from app.run.requests.request import Artefact, Event, Grown, OnEvent, Progress, ShouldCancel

Result = TypeVar("Result")
_REFRESH_S = 0.25
_SOON_S = 0.05


def follow_run(
    run: Callable[[OnEvent, ShouldCancel], Result], job: Job
) -> Generator[list[Event] | Result, None, None]:
    """Do a run in a thread of its own; give its events in small batches, then its result, which is
    no list.

    Each artefact is linked into the job's folder, so that it stays readable while the run goes
    on, whatever becomes of the run.

    Raises:
        Exception: whatever the run raises, once its thread has ended.
    """
    shown = job.folder / "shown"
    shown.mkdir(mode=0o700, exist_ok=True)
    events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
    outcome: dict[str, Any] = {}

    def keep(event: Event) -> None:
        if isinstance(event, Artefact):
            link = shown / event.path.name
            link.unlink(missing_ok=True)
            os.link(event.path, link)
            event = replace(event, path=link)
        events.put(event)

    def work() -> None:
        try:
            outcome["result"] = run(keep, job.is_cancelled)
        except BaseException as error:
            outcome["error"] = error
        finally:
            events.put(None)

    thread = threading.Thread(target=work, name="run", daemon=True)
    thread.start()
    try:
        has_ended = False
        while not has_ended:
            batch: list[Event] = []
            deadline = time.monotonic() + _REFRESH_S
            while not has_ended and (left := deadline - time.monotonic()) > 0:
                try:
                    event = events.get(timeout=left)
                except queue.Empty:
                    break
                if event is None:
                    has_ended = True
                else:
                    batch.append(event)
                    if isinstance(event, Grown):  # somebody waits to see it move
                        deadline = min(deadline, time.monotonic() + _SOON_S)
            yield batch
    except GeneratorExit:
        job.cancel()  # the visitor has gone
        raise
    thread.join()
    if "error" in outcome:
        raise outcome["error"]
    yield outcome["result"]


def last_share(events: Sequence[Event]) -> float | None:
    """How far a run of one stage is, as its last news of that says; None without any."""
    shares = [event.fraction for event in events if isinstance(event, Progress)]
    return shares[-1] if shares else None


def waiting_line(ahead: int) -> str:
    """How many are before this visitor."""
    return text.WAITING_ONE if ahead == 1 else text.WAITING.format(ahead=ahead)


Updates = dict[Any, Any]
"""By part of the page what it shows from now on."""


class Work(Protocol[Result]):
    """One run that was asked for, and what the tab shows of it."""

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> Result:
        """Do it; called in a thread of its own."""
        ...

    def progress(self, events: list[Event]) -> Updates:
        """After each batch of news, which may be empty; no updates leave the tab as it is."""
        ...

    def finished(self, result: Result) -> Updates:
        """At the end of a run that went well."""
        ...


class InTurn(ABC, Generic[Result]):
    """What is alike in all that the page has done in its turn."""

    def __init__(self, jobs: JobBook) -> None:
        self._jobs = jobs

    def in_turn(
        self,
        open_job: Callable[[], Job],
        begin: Callable[[Job], AbstractContextManager[Work[Result]]],
    ) -> Iterator[Updates]:
        """Updates of the tab until the work has ended.

        Args:
            begin: gives the work of an attempt, each of which has a job of its own.

        Raises:
            CancelledRun: where the visitor has cancelled it.
            Exception: whatever ``open_job``, ``begin`` or the work raises.
        """
        job: Job | None = None
        try:
            job = open_job()
            while True:
                try:
                    yield from self._attempt(job, begin)
                    return
                except CancelledRun:
                    anew = self._jobs.again(job)
                    if anew is None:
                        raise
                    job = anew
        finally:
            if job is not None:
                self._jobs.close(job)

    def _attempt(
        self, job: Job, begin: Callable[[Job], AbstractContextManager[Work[Result]]]
    ) -> Iterator[Updates]:
        """The run from its turn to its end.

        Raises:
            CancelledRun: where the visitor has cancelled it, or it was put back for others.
        """
        with begin(job) as work:
            yield self.blank()
            with self._jobs.slot(job) as turn:
                for ahead in turn:
                    yield self.waits(ahead)
                for news in follow_run(work.run, job):
                    if not isinstance(news, list):
                        yield work.finished(news)
                    elif job.is_put_back or job.is_cancelled():
                        yield self.stops(job)
                    elif updates := work.progress(news):
                        yield updates

    @abstractmethod
    def blank(self) -> Updates:
        """As a run begins."""

    @abstractmethod
    def waits(self, ahead: int) -> Updates:
        """While so many are before it."""

    @abstractmethod
    def stops(self, job: Job) -> Updates:
        """While it stops, for others or as it was cancelled."""
