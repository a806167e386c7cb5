"""From a click on a tab's button to the end of its run: what all tabs do alike."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any, ClassVar

import gradio as gr

from app import text
from app.errors import CancelledRun, visitor_sentence
from app.page.parts import markup
from app.page.queue.in_turn import InTurn, Result, Updates, Work, waiting_line
from app.page.queue.jobs import Job, JobBook, Tab
from app.page.visitors.visitors import address_of, cookie_of, visitor_of


class TabRunner(InTurn[Result]):
    """Turns a click into a run, in its turn among all runs, and the run into updates of the tab."""

    tab: ClassVar[Tab]

    def __init__(self, jobs: JobBook, status: gr.HTML) -> None:
        super().__init__(jobs)
        self._status = status

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        """Updates of the tab while a run goes on, for one visitor.

        Args:
            values: of the form's fields.

        Raises:
            gr.Error: with the sentence that the tab shows too, when the run fails.
        """
        cookie = cookie_of(request)
        try:
            yield from self.in_turn(
                lambda: self._jobs.open(visitor_of(request), self.tab, address_of(request), values),
                lambda job: self.begin(job, cookie, values),
            )
        except CancelledRun:
            yield self.stopped(markup.sentence_status(text.CANCELLED), "")
        except Exception as error:
            sentence = visitor_sentence(error)
            yield self.stopped(markup.sentence_status(text.STOPPED), markup.error_message(sentence))
            # For programs: the page has told it where it belongs, and tells it once.
            raise gr.Error(sentence, visible=False, print_exception=False) from error

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
    def stopped(self, status: str, message: str) -> Updates:
        """After a run that was cancelled or has failed.

        Args:
            status: one line, as HTML.
            message: why it failed, as HTML; empty where it was cancelled.
        """

    def waits(self, ahead: int) -> Updates:
        return self.says(waiting_line(ahead))

    def stops(self, job: Job) -> Updates:
        return self.says(text.PUT_BACK if job.is_put_back else text.STOPPING)

    def says(self, line: str) -> Updates:
        """A sentence on how it goes."""
        return {self._status: markup.sentence_status(line)}
