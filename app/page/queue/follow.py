"""A run followed while it goes: its events in batches, and its errors as sentences."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from app import text
from app.page.queue.jobs import Job
from app.run.requests.request import Artefact, Event, OnEvent, Piece, Progress, ShouldCancel

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
                    if isinstance(event, Piece):  # somebody waits to see it move
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
