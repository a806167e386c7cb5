"""Gestures edited on the time line, and the motion performed again: a take beside the others."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Annotated, Any

import gradio as gr
from pydantic import BaseModel, Field, ValidationError

from app import text
from app.errors import CancelledRun, RunError, page_sentence, visitor_sentence
from app.page.parts.html_parts import PRIVATE, in_turn
from app.page.player.player import Showing
from app.page.queue.jobs import Job
from app.page.queue.runner import Updates, follow
from app.page.results.result_parts import ResultParts
from app.page.tabs.services import Services
from app.page.visitors.visitors import cookie_of, visitor_of
from app.run.ask import Event, Grown
from app.run.output.run_folder import drop_unfinished
from app.run.takes.edits import MAX_PLAN_CHARACTERS, edits_of, locked_of
from app.run.takes.take import TakeAsk, make_take

MAX_ASKED = MAX_PLAN_CHARACTERS + 100_000
"""Characters."""
MAX_NAME = 200


class Asked(BaseModel):
    """What a browser asks its editor for, as app/page/web/player/editing.js writes it."""

    run: Annotated[str, Field(max_length=MAX_NAME)]
    start: Annotated[str, Field(max_length=MAX_NAME)]
    """The row whose plan is changed."""
    edits: Any = None
    """See `edits_of`. None only gets the row ready to be edited."""
    locked: Any = None

    @classmethod
    def of(cls, told: object) -> Asked:
        """
        Raises:
            RunError: if it does not say of which run it is.
        """
        try:
            json = told if isinstance(told, str) and len(told) <= MAX_ASKED else ""
            return cls.model_validate_json(json)
        except ValidationError as error:
            raise RunError(text.EDITS_DAMAGED) from error


class TakesRunner:
    """Makes the takes of one tab's runs."""

    def __init__(self, services: Services, parts: ResultParts) -> None:
        self._weights = services.config.weights
        self._worker = services.worker
        self._kept = services.kept
        self._jobs = services.jobs
        self._parts = parts

    def wire(self) -> None:
        """Have the editor's button start it."""
        parts = self._parts
        parts.take_start.click(
            self.run,
            inputs=[gr.Textbox(visible=False)],  # which the script fills in
            outputs=[parts.player],
            js="() => [document.querySelector('#player .lockstep').edits()]",
            **{**in_turn(parts.status), **PRIVATE, "trigger_mode": "multiple"},
        )

    def run(self, request: gr.Request, told: object) -> Iterator[Updates]:
        """Updates of the player while a take is made.

        Raises:
            gr.Error: with a sentence, where there is no run that could say it.
        """
        cookie, visitor = cookie_of(request), visitor_of(request)
        showing: Showing | None = None
        try:
            asked = Asked.of(told)
            run = self._kept.edited(asked.run, cookie)
            if run is None:
                raise RunError(text.EDITS_GONE)
            showing = run.showing
            wanted = TakeAsk(
                out=showing.folder,
                weights=self._weights,
                start=asked.start,
                edits=edits_of(asked.edits),
                locked=locked_of(asked.locked),
            )
            with self._jobs.opened(visitor, "takes") as job:
                yield self._said(showing, text.TAKE_STARTING, state="working")
                yield from self._made(job, wanted, showing)
        except CancelledRun:
            if showing is not None:
                yield self._said(showing, text.CANCELLED)
        except Exception as error:
            sentence = visitor_sentence(error)
            if showing is None:
                raise gr.Error(sentence, print_exception=False) from error
            yield self._said(showing, sentence, is_refused=True)

    def _made(self, job: Job, wanted: TakeAsk, showing: Showing) -> Iterator[Updates]:
        def told(events: list[Event]) -> Updates:
            if not any(isinstance(event, Grown) for event in events):
                return {}
            number = max(row.take.number for row in showing.record.rows if row.take)
            return self._said(showing, text.TAKE_COMING.format(number=number), state="working")

        do = partial(self._worker.do, make_take, wanted)
        try:
            take = yield from follow(do, job, told, {self._parts.player: gr.skip()})
        finally:
            drop_unfinished(showing.folder)
        if take.offers:
            said = page_sentence(take.notes[0])
            yield self._said(showing, said, is_refused=True, offers=take.offers)
            return
        done = text.TAKE_DONE.format(number=take.number) if take.number else text.EDITOR_READY
        yield self._said(showing, " ".join((done, *take.notes)))

    def _said(self, showing: Showing, sentence: str, **how: Any) -> Updates:
        showing.say(sentence, **how)
        return {self._parts.player: showing.value() | {"begins": False}}
