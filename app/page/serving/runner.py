"""From a click on a tab's button to the end of its run: what all tabs do alike."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import gradio as gr

from app import text
from app.errors import CancelledRun, visitor_sentence
from app.page.parts import markup
from app.page.serving.follow import follow_run, waiting_line
from app.page.serving.jobs import Job, JobBook, Tab
from app.page.serving.visitors import address_of, cookie_of, visitor_of
from app.run.request import Event, OnEvent, ShouldCancel

Updates = dict[Any, Any]
"""By part of the page what it shows from now on."""
Result = TypeVar("Result")


class Work(Protocol[Result]):
    """One run that a form has asked for, and what the tab shows of it."""

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> Result:
        """Do it; called in a thread of its own."""
        ...

    def progress(self, events: list[Event]) -> Updates:
        """After each batch of news, which may be empty; no updates leave the tab as it is."""
        ...

    def finished(self, result: Result) -> Updates:
        """At the end of a run that went well."""
        ...


class TabRunner(ABC, Generic[Result]):
    """Turns a click into a run, in its turn among all runs, and the run into updates of the tab."""

    tab: ClassVar[Tab]

    def __init__(self, jobs: JobBook, status: gr.HTML) -> None:
        self._jobs = jobs
        self._status = status

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        """Updates of the tab while a run goes on, for one visitor.

        Args:
            values: of the form's fields.

        Raises:
            gr.Error: with the sentence that the tab shows too, when the run fails.
        """
        job: Job | None = None
        try:
            job = self._jobs.open(visitor_of(request), self.tab, address_of(request), values)
            while True:
                try:
                    yield from self._attempt(job, cookie_of(request), values)
                    return
                except CancelledRun:
                    anew = self._jobs.again(job)
                    if anew is None:
                        raise
                    job = anew
        except CancelledRun:
            yield self.stopped(markup.sentence_status(text.CANCELLED), "")
        except Exception as error:
            sentence = visitor_sentence(error)
            yield self.stopped(markup.sentence_status(text.STOPPED), markup.error_message(sentence))
            # For programs: the page has told it where it belongs, and tells it once.
            raise gr.Error(sentence, visible=False, print_exception=False) from error
        finally:
            if job is not None:
                self._jobs.close(job)

    def _attempt(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[Updates]:
        """The run from its turn to its end.

        Raises:
            CancelledRun: where the visitor has cancelled it, or it was put back for others.
        """
        with self.begin(job, cookie, values) as work:
            yield self.blank()
            with self._jobs.slot(job) as turn:
                for ahead in turn:
                    yield self._says(waiting_line(ahead))
                for news in follow_run(work.run, job):
                    if not isinstance(news, list):
                        yield work.finished(news)
                    elif job.is_put_back:
                        yield self._says(text.PUT_BACK)
                    elif job.is_cancelled():
                        yield self._says(text.STOPPING)
                    elif updates := work.progress(news):
                        yield updates

    def cancel(self, request: gr.Request) -> None:
        """The visitor has pressed the button, or closed the page."""
        self._jobs.cancel(visitor_of(request), self.tab)

    @abstractmethod
    def begin(
        self, job: Job, cookie: str, values: tuple[Any, ...]
    ) -> AbstractContextManager[Work[Result]]:
        """Check the form; the run itself waits for its turn.

        Args:
            cookie: of the visitor's browser; empty for one that keeps none.

        Raises:
            RunError: when the form asks for what cannot be.
        """

    @abstractmethod
    def blank(self) -> Updates:
        """As a run begins: nothing of an earlier one."""

    @abstractmethod
    def stopped(self, status: str, message: str) -> Updates:
        """After a run that was cancelled or has failed.

        Args:
            status: one line, as HTML.
            message: why it failed, as HTML; empty where it was cancelled.
        """

    def _says(self, line: str) -> Updates:
        return {self._status: markup.sentence_status(line)}
