"""Gestures edited on the time line, and the motion performed again: a take beside the others."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import gradio as gr

from app import text
from app.errors import CancelledRun, RunError, visitor_sentence
from app.page.parts.html_parts import PRIVATE, in_turn
from app.page.player.edited_runs import MAX_TAKES, EditedRun, EditedRuns, KeptTake
from app.page.queue.jobs import Job
from app.page.queue.runner import Updates, follow
from app.page.results.result_parts import ResultParts
from app.page.tabs.services import Services
from app.page.visitors.visitors import cookie_of, visitor_of
from app.run.requests.request import Event, Grown, OnEvent, ShouldCancel
from app.run.takes.edits import MAX_PLAN_CHARACTERS, Edit, Locked, edits_of, locked_of
from app.run.takes.take import Take, TakeRequest, make_take, row_of

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

    def __init__(self, services: Services, runs: EditedRuns, parts: ResultParts) -> None:
        self._make: MakeTake = partial(services.worker.do, make_take)
        self._runs = runs
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
        run: EditedRun | None = None
        try:
            known = read_asked(told)
            run = edited = self._runs.find(known["run"], cookie)
            if edited is None:
                raise RunError(text.EDITS_GONE)
            asked = Asked.of(known)
            with self._jobs.opened(visitor, "takes") as job:
                with self._begin(job, edited, asked) as work:
                    edited.say(text.TAKE_STARTING, state="working")
                    yield _shown(self._parts, edited)
                    yield from follow(work, job, {self._parts.player: gr.skip()})
        except CancelledRun:
            if run is not None:
                run.say(text.CANCELLED)
                yield _shown(self._parts, run)
        except Exception as error:
            sentence = visitor_sentence(error)
            if run is None:
                raise gr.Error(sentence, print_exception=False) from error
            run.say(sentence, is_refused=True)
            yield _shown(self._parts, run)

    @contextmanager
    def _begin(self, job: Job, run: EditedRun, asked: Asked) -> Iterator[_Work]:
        known = run.known.get(asked.start)
        own = run.showing.file("performed", asked.start)
        plan = own if known is None else known.take.files.plan
        if plan is None:
            raise RunError(text.EDITS_GONE)
        if asked.edits and run.num_takes >= MAX_TAKES:
            raise RunError(text.TOO_MANY_TAKES.format(limit=MAX_TAKES))
        of = asked.start if known is None else known.of
        system, sample = row_of(of, run.request.systems, run.request.samples)
        number = run.next_number() if asked.edits else 0
        name = f"{of}.take{number}" if number else of
        request = TakeRequest(
            run=run.request,
            system=system,
            sample=sample,
            name=name,
            out=job.folder / "results",
            plan=plan,
            before=None if known is None else known.take.files,
            beside=run.showing.motions()[of],
            edits=asked.edits,
            locked=asked.locked,
            words=run.words,
        )
        work = _Work(self._make, request, self._parts, run, asked.start, of, job, number)
        try:
            yield work
        finally:
            if number and name not in run.known:
                run.showing.takes.pop(name, None)


@dataclass
class _Work:
    """One take."""

    make: MakeTake
    request: TakeRequest
    parts: ResultParts
    edited: EditedRun
    start: str
    of: str
    job: Job
    number: int
    """0 where the row is only made ready."""

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> Take:
        request = self.request
        if request.before is None:
            first = replace(
                request, name=self.of, out=self.job.folder / "first", edits=(), locked=()
            )
            made = self.make(first, lambda event: None, should_cancel)
            self.edited.keep(self.of, KeptTake(made, self.of))
            if not self.number:
                return made
            request = replace(request, before=made.files)
        return self.make(request, on_event, should_cancel) if self.number else self._known()

    def _known(self) -> Take:
        return self.edited.known[self.start].take

    def progress(self, events: list[Event]) -> Updates:
        if not self.number or not any(isinstance(event, Grown) for event in events):
            return {}
        name, out = self.request.name, self.request.out
        if name not in self.edited.showing.takes:
            self.edited.showing.add_take(out, name, self.number, self.of)
        self.edited.say(text.TAKE_COMING.format(number=self.number), state="working")
        return _shown(self.parts, self.edited)

    def finished(self, result: Take) -> Updates:
        if self.number:
            self.edited.keep(self.request.name, KeptTake(result, self.of, self.start))
            done = text.TAKE_DONE.format(number=self.number)
            self.edited.say(" ".join((done, *result.notes)))
        else:
            self.edited.say(text.EDITOR_READY)
        return _shown(self.parts, self.edited)


def _shown(parts: ResultParts, run: EditedRun) -> Updates:
    return {parts.player: run.showing.value() | {"begins": False}}
