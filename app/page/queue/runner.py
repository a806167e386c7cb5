"""From the turn of a run, which Gradio's queue decides, to its end, as updates of the page: what
all tabs do alike, in a folder that no other visitor is told of."""

from __future__ import annotations

import queue
import secrets
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import gradio as gr

from app import text
from app.errors import CancelledRun, visitor_sentence
from app.page.parts import markup
from app.page.parts.asked import Fields, named_fields
from app.page.parts.html_parts import AT_ONCE, in_turn
from app.page.queue.worker import Task, Worker
from app.page.visitors.files import touch, uploads_of
from app.page.visitors.visitors import cookie_of, visitor_of
from app.run.ask import Event, Grown, OnEvent, Progress, ShouldCancel


@dataclass(eq=False)
class Job:
    """One visitor's run."""

    visitor: str
    tab: str
    """The part of the page that starts it, and whose button stops it."""
    folder: Path
    cookie: str = ""
    """Of the visitor's browser; empty for one that keeps none."""
    beside: list[Path] = field(default_factory=list)
    """What is kept beside its folder: what the visitor has given it to work with."""
    _stopped: threading.Event = field(default_factory=threading.Event)

    def cancel(self) -> None:
        self._stopped.set()

    def is_cancelled(self) -> bool:
        """Whether its visitor, or the end of the page, has stopped it."""
        return self._stopped.is_set()


class Jobs:
    """All runs of this process that have begun and not ended, in folders below ``root``, beside
    which uploads lie in ``gradio``."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._jobs: list[Job] = []
        self._lock = threading.Lock()

    @contextmanager
    def opened(
        self, visitor: str, tab: str, cookie: str = "", values: Sequence[Any] = ()
    ) -> Iterator[Job]:
        """A job in a folder that only this process's user can enter; it stays for the downloads.
        Uploads among the values of a form are kept until it ends, and then for as long as new ones.
        """
        uploads = uploads_of(values, self._root.with_name("gradio"))
        job = Job(visitor, tab, self._root / secrets.token_hex(16), cookie, uploads)
        job.folder.mkdir(parents=True, mode=0o700)
        touch(job.beside)
        with self._lock:
            self._jobs.append(job)
        try:
            yield job
        finally:
            job.cancel()
            with self._lock:
                self._jobs.remove(job)
            touch(job.beside)

    def cancel(self, visitor: str = "", tab: str = "") -> None:
        """Stop the runs that the visitor started in that tab; without any, every run."""
        with self._lock:
            for job in self._jobs:
                if not visitor or (job.visitor, job.tab) == (visitor, tab):
                    job.cancel()

    def in_use(self) -> list[Path]:
        """Folders and uploads of runs that have not ended."""
        with self._lock:
            return [path for job in self._jobs for path in (job.folder, *job.beside)]


Asked = TypeVar("Asked")
Found = TypeVar("Found")
_REFRESH_S = 0.25
_SOON_S = 0.05
Updates = dict[Any, Any]
"""By part of the page what it shows from now on."""
Told = Callable[[list[Event]], Updates]
"""What each batch of news shows, which may be empty; no updates leave the tab as it is."""


def follow(
    do: Callable[[OnEvent, ShouldCancel], Found], job: Job, told: Told, as_it_is: Updates
) -> Generator[Updates, None, Found]:
    """Do a run in a thread of its own; updates several times a second until it has ended, then its
    result, or whatever it raises. Whoever closes this, as Gradio does when the visitor has
    cancelled or gone, stops the run with its job."""
    events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
    outcome: dict[str, Any] = {}

    def run() -> None:
        try:
            outcome["result"] = do(events.put, job.is_cancelled)
        except BaseException as error:
            outcome["error"] = error
        finally:
            events.put(None)

    thread = threading.Thread(target=run, name="run", daemon=True)
    thread.start()
    has_ended = False
    while not has_ended:
        batch, has_ended = _batch(events)
        yield told(batch) or as_it_is
    thread.join()
    if "error" in outcome:
        raise outcome["error"]
    return outcome["result"]


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


class TabRunner(ABC):
    """Turns a click whose turn has come into a run, and the run into updates of the tab."""

    tab: ClassVar[str]
    is_told: ClassVar[bool] = True
    """Whether the tab itself says why a run has failed."""

    def __init__(self, jobs: Jobs, worker: Worker, status: gr.HTML) -> None:
        self._jobs = jobs
        self._worker = worker
        self._status = status
        self._unfinished: set[str] = set()
        """Visitors whose tab shows a run that has begun."""

    def begins_on(
        self, event: Callable[..., Any], fields: Fields | Sequence[Any], **how: Any
    ) -> Any:
        """Run in its turn after an event, such as ``button.click``, of a form, as programs fill it
        in too, or of parts; returns Gradio's own of that."""
        run: Any = self.run
        if isinstance(fields, Mapping):
            run, fields = named_fields(run, fields), [*fields.values()]
        if "api_name" not in how:
            how["api_visibility"] = "private"
        return event(run, fields, **{**in_turn(self._status), **how})

    def ends_on(self, button: gr.Button, runs: Any, outputs: Sequence[Any]) -> None:
        button.click(self.cancel, outputs=outputs, cancels=runs, **AT_ONCE)

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        """Updates of the tab while a run goes on, for one visitor. Raises `gr.Error` with the
        sentence that the tab shows too, when the run fails."""
        cookie, visitor = cookie_of(request), visitor_of(request)
        try:
            with (
                self._jobs.opened(visitor, self.tab, cookie, values) as job,
                closing(self.steps(job, values)) as steps,
            ):
                blank = next(steps)
                self._unfinished.add(visitor)
                yield blank
                for update in steps:
                    if job.is_cancelled():
                        raise CancelledRun  # what was on its way is told nobody
                    yield update
            self._unfinished.discard(visitor)
        except CancelledRun:
            self._unfinished.discard(visitor)
            yield self.stopped(markup.sentence_status(text.CANCELLED), "")
        except Exception as error:
            self._unfinished.discard(visitor)
            sentence = visitor_sentence(error)
            yield self.stopped(markup.sentence_status(text.STOPPED), markup.error_message(sentence))
            # Else for programs alone: the page tells it once.
            visible = not self.is_told
            raise gr.Error(sentence, visible=visible, print_exception=False) from error

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
    def steps(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        """The tab as a run begins, and then as it goes on until its end. Raises `RunError` before
        any update when the form asks for what cannot be."""

    @abstractmethod
    def stopped(self, status: str, message: str) -> Updates:
        """After a run that was cancelled or has failed: a line of status, and why it failed, as
        HTML."""

    def done(
        self, job: Job, task: Task[Asked, Found], asked: Asked, told: Told | str = ""
    ) -> Generator[Updates, None, Found]:
        """A task of the worker's, and what the tab shows meanwhile, or a sentence of ``share``."""

        def line(events: list[Event]) -> Updates:
            share = last_share(events) if told else None
            if share is None:
                return {}
            return {self._status: markup.sentence_status(str(told).format(share=share))}

        do = partial(self._worker.do, task, asked)
        shown = line if isinstance(told, str) else told
        return follow(do, job, shown, {self._status: gr.skip()})
