"""A run in its turn among all runs, from the place that it is given to its end, and anew where it
was put back for others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any, Generic, Protocol, TypeVar

from app.errors import CancelledRun
from app.page.queue.follow import follow_run
from app.page.queue.jobs import Job, JobBook
from app.run.requests.request import Event, OnEvent, ShouldCancel

Updates = dict[Any, Any]
"""By part of the page what it shows from now on."""
Result = TypeVar("Result")


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
