"""From the turn of a run to its end, as updates of the page: what all tabs do alike."""

from __future__ import annotations

import queue
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import gradio as gr

from app import text
from app.errors import CancelledRun, visitor_sentence
from app.page.parts import markup
from app.page.queue.jobs import Job, Jobs, Tab
from app.page.visitors.visitors import cookie_of, visitor_of
from app.run.requests.request import Event, Grown, OnEvent, Progress, ShouldCancel

Result = TypeVar("Result")
_REFRESH_S = 0.25
_SOON_S = 0.05
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


def follow(work: Work[Any], job: Job, as_it_is: Updates) -> Iterator[Updates]:
    """Do a run in a thread of its own; updates several times a second until it has ended.

    Whoever closes this, as Gradio does when the visitor has cancelled or gone, stops the run with
    its job.

    Args:
        as_it_is: leaves all as it is; of an update without any part Gradio empties them.

    Raises:
        Exception: whatever the run raises, once its thread has ended.
    """
    events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
    outcome: dict[str, Any] = {}

    def do() -> None:
        try:
            outcome["result"] = work.run(events.put, job.is_cancelled)
        except BaseException as error:
            outcome["error"] = error
        finally:
            events.put(None)

    thread = threading.Thread(target=do, name="run", daemon=True)
    thread.start()
    has_ended = False
    while not has_ended:
        batch, has_ended = _batch(events)
        yield work.progress(batch) or as_it_is
    thread.join()
    if "error" in outcome:
        raise outcome["error"]
    yield work.finished(outcome["result"])


def _batch(events: queue.SimpleQueue[Event | None]) -> tuple[list[Event], bool]:
    """The news of a quarter of a second, and whether they were the last."""
    batch: list[Event] = []
    deadline = time.monotonic() + _REFRESH_S
    while (left := deadline - time.monotonic()) > 0:
        try:
            event = events.get(timeout=left)
        except queue.Empty:
            break
        if event is None:
            return batch, True
        batch.append(event)
        if isinstance(event, Grown):  # somebody waits to see it move
            deadline = min(deadline, time.monotonic() + _SOON_S)
    return batch, False


def last_share(events: Sequence[Event]) -> float | None:
    """How far a run of one stage is, as its last news of that says; None without any."""
    shares = [event.fraction for event in events if isinstance(event, Progress)]
    return shares[-1] if shares else None


class TabRunner(ABC, Generic[Result]):
    """Turns a click whose turn has come into a run, and the run into updates of the tab."""

    tab: ClassVar[Tab]

    def __init__(self, jobs: Jobs, status: gr.HTML) -> None:
        self._jobs = jobs
        self._status = status
        self._unfinished: set[str] = set()
        """Visitors whose tab shows a run that has begun."""

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        """Updates of the tab while a run goes on, for one visitor.

        Args:
            values: of the form's fields.

        Raises:
            gr.Error: with the sentence that the tab shows too, when the run fails.
        """
        cookie, visitor = cookie_of(request), visitor_of(request)
        try:
            with self._jobs.opened(visitor, self.tab, values) as job:
                with self.begin(job, cookie, values) as work:
                    self._unfinished.add(visitor)
                    yield self.blank()
                    yield from follow(work, job, {self._status: gr.skip()})
            self._unfinished.discard(visitor)
        except CancelledRun:
            self._unfinished.discard(visitor)
            yield self.stopped(markup.sentence_status(text.CANCELLED), "")
        except Exception as error:
            self._unfinished.discard(visitor)
            sentence = visitor_sentence(error)
            yield self.stopped(markup.sentence_status(text.STOPPED), markup.error_message(sentence))
            # For programs: the page has told it where it belongs, and tells it once.
            raise gr.Error(sentence, visible=False, print_exception=False) from error

    def cancel(self, request: gr.Request) -> Updates:
        """The visitor has pressed the button; Gradio takes a run that waits out of its queue, and
        asks for no more of one that has begun."""
        visitor = visitor_of(request)
        self._jobs.cancel(visitor, self.tab)
        if visitor not in self._unfinished:
            return self.idle()
        self._unfinished.discard(visitor)
        return self.stopped(markup.sentence_status(text.CANCELLED), "")

    def idle(self) -> Updates:
        """As a tab stays whose run has not begun."""
        return {self._status: gr.skip()}

    @abstractmethod
    def begin(
        self, job: Job, cookie: str, values: tuple[Any, ...]
    ) -> AbstractContextManager[Work[Result]]:
        """Check the form.

        Args:
            cookie: of the visitor's browser; empty for one that keeps none.

        Raises:
            RunError: when the form asks for what cannot be.
        """

    @abstractmethod
    def blank(self) -> Updates:
        """As a run begins."""

    @abstractmethod
    def stopped(self, status: str, message: str) -> Updates:
        """After a run that was cancelled or has failed.

        Args:
            status: one line, as HTML.
            message: why it failed, as HTML; empty where it was cancelled.
        """
