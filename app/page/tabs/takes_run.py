"""Gestures edited on the time line, and the motion performed again: a take beside the others."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import gradio as gr

from app import text
from app.errors import CancelledRun, RunError, page_sentence, visitor_sentence
from app.page.parts.html_parts import PRIVATE, in_turn
from app.page.player.player import Showing
from app.page.queue.runner import Updates, follow
from app.page.results.result_parts import ResultParts
from app.page.tabs.services import Services
from app.page.visitors.visitors import cookie_of, visitor_of
from app.run.output.run_folder import drop_unfinished
from app.run.requests.request import Event, Grown, OnEvent, ShouldCancel
from app.run.takes.edits import MAX_PLAN_CHARACTERS, Edit, Locked, edits_of, locked_of
from app.run.takes.take import Take, TakeRequest, make_take

MAX_ASKED = MAX_PLAN_CHARACTERS + 100_000
"""Characters."""
MAX_NAME = 200
MakeTake = Callable[[TakeRequest, OnEvent, ShouldCancel], Take]
"""As `app.run.takes.take.make_take`."""


@dataclass(frozen=True)
class Asked:
    """What a browser asks its editor for."""

    run: str
    start: str
    """The row whose plan is changed."""
    edits: tuple[Edit, ...]
    """None only gets the row ready to be edited."""
    locked: tuple[Locked, ...]

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Asked:
        """
        Args:
            told: as `read_asked` gives it.

        Raises:
            RunError: if its edits are none.
        """
        edits, locked = edits_of(told.get("edits")), locked_of(told.get("locked"))
        return cls(told["run"], told["start"], edits, locked)


def read_asked(told: object) -> Mapping[str, Any]:
    """What a browser sent, as far as it says of which run it is.

    Args:
        told: JSON, as app/page/web/player/editing.js writes it.

    Raises:
        RunError: if it is anything else.
    """
    if not isinstance(told, str) or len(told) > MAX_ASKED:
        raise RunError(text.EDITS_DAMAGED)
    try:
        known = json.loads(told)
    except (ValueError, RecursionError) as error:
        raise RunError(text.EDITS_DAMAGED) from error
    names = [known.get(name) for name in ("run", "start")] if isinstance(known, dict) else [None]
    if not all(isinstance(name, str) and len(name) <= MAX_NAME for name in names):
        raise RunError(text.EDITS_DAMAGED)
    return known


class TakesRunner:
    """Makes the takes of one tab's runs."""

    def __init__(self, services: Services, parts: ResultParts) -> None:
        self._make: MakeTake = partial(services.worker.do, make_take)
        self._kept = services.kept
        self._jobs = services.jobs
        self._parts = parts

    def wire(self) -> None:
        """Have the editor's button start it."""
        parts = self._parts
        parts.take_start.click(
            self.run,
            inputs=[parts.take_asked],
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
            known = read_asked(told)
            run = self._kept.edited(known["run"], cookie)
            if run is None or run.asked is None:
                raise RunError(text.EDITS_GONE)
            showing = run.showing
            asked = Asked.of(known)
            with self._jobs.opened(visitor, "takes") as job:
                changes = asked.start, asked.edits, asked.locked
                wanted = TakeRequest(run.asked, showing.folder, *changes)
                work = _Work(self._make, wanted, self._parts, showing)
                yield work.said(text.TAKE_STARTING, state="working")
                try:
                    yield from follow(work, job, {self._parts.player: gr.skip()})
                finally:
                    drop_unfinished(showing.folder)
        except CancelledRun:
            if showing is not None:
                showing.say(text.CANCELLED)
                yield {self._parts.player: showing.value() | {"begins": False}}
        except Exception as error:
            sentence = visitor_sentence(error)
            if showing is None:
                raise gr.Error(sentence, print_exception=False) from error
            showing.say(sentence, is_refused=True)
            yield {self._parts.player: showing.value() | {"begins": False}}


@dataclass
class _Work:
    """One take."""

    make: MakeTake
    request: TakeRequest
    parts: ResultParts
    showing: Showing

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> Take:
        return self.make(self.request, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        if not any(isinstance(event, Grown) for event in events):
            return {}
        number = max(row.take.number for row in self.showing.record.rows if row.take)
        return self.said(text.TAKE_COMING.format(number=number), state="working")

    def finished(self, result: Take) -> Updates:
        if result.offers:
            self.showing.say(page_sentence(result.notes[0]), is_refused=True, offers=result.offers)
            return {self.parts.player: self.showing.value() | {"begins": False}}
        done = text.TAKE_DONE.format(number=result.number) if result.number else text.EDITOR_READY
        return self.said(" ".join((done, *result.notes)))

    def said(self, sentence: str, state: str = "") -> Updates:
        self.showing.say(sentence, state=state)
        return {self.parts.player: self.showing.value() | {"begins": False}}
