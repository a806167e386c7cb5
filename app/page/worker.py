"""Worker processes for tasks, with limits on memory, run time and time without progress.

A task is a function of a request and callbacks, imported by name in the worker. The worker loads
the models once and is reused until it ignores a cancellation, exceeds a limit or has grown.
"""

from __future__ import annotations

import os
import pickle
import resource
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from app import errors
from app.errors import Cancelled, DiskFullError, RunError, WorkerError
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from processes.child import Child, ChildExited, parent_channel, start_receiving

RequestT = TypeVar("RequestT")
ResultT = TypeVar("ResultT")
Task = Callable[[RequestT, RunCallbacks], ResultT]

GRACE_S = 10.0
"""Time (s) that a process has to react to a cancellation. It does not check while a figure is
drawn, which takes seconds; a new process takes 20 s of a core to load the models."""
GROWN_BYTES = 10**9
"""Memory growth (bytes) during a task after which the process is replaced."""
_POLL_S = 0.05

TOO_LONG = (
    "This run exceeded the limit of {minutes:.0f} minutes. Use shorter speech, fewer systems or "
    "fewer samples."
)
SILENT = (
    "This run made no progress for {seconds:.0f} s and was stopped. Start it again; if this "
    "happens again, use shorter speech or fewer systems."
)
ENDED = "The process of this run"
FOR_MEMORY = (
    "runs are limited to {gigabytes:.1f} GB of memory here; use shorter speech or fewer systems"
)
AGAIN = "start the run again; a new process will be used"


@dataclass(frozen=True)
class TaskLimits:
    """Limits of one task; exceeding any of them ends the process."""

    additional_memory_bytes: int = 4 * 10**9
    """Memory (bytes) in addition to that of the process before the task."""
    run_s: float = 2 * 3600.0
    no_progress_s: float = 240.0
    """Longest time without progress (s)."""


class Worker:
    """Process that does one task at a time; its methods are thread-safe."""

    def __init__(
        self,
        limits: TaskLimits = TaskLimits(),
        warm: tuple[Path, Path | None] | None = None,
        niceness: int = 0,
        is_reused: bool = True,
    ) -> None:
        """Configure the process, which is started at its first use.

        Weights and body of ``warm`` are loaded before the first task, else when a task needs them;
        a ``niceness`` of 19 uses only idle time.
        """
        self._limits = limits
        self._warm = warm
        self._niceness = niceness
        self._is_reused = is_reused
        self._is_closed = False
        self._turn = threading.Lock()
        self._child: Child | None = None
        self._is_fit = False
        """True if the process can take another task."""

    def start(self) -> None:
        """Start the process and load the models, so that the first run does not wait for them."""
        with self._turn:
            self._ready()

    def do(
        self,
        task: Task[RequestT, ResultT],
        request: RequestT,
        callbacks: RunCallbacks = NO_CALLBACKS,
    ) -> ResultT:
        """Do a task as soon as the previous one is done.

        Raises Cancelled if the task stopped within `GRACE_S` of its cancellation, or was ended;
        RunError with the sentence of the error or exceeded limit; WorkerError for a program fault.
        """
        while not callbacks.should_cancel():
            if self._turn.acquire(timeout=_POLL_S):
                break
        else:
            raise Cancelled
        try:
            return self._done_by(self._ready(), (task, request), callbacks)
        finally:
            try:
                if self._is_closed or not self._is_reused:
                    self._drop()
                elif self._child is not None:
                    self._ready()  # now, so that the models are loaded for the next visitor
            finally:
                self._turn.release()

    def close(self) -> None:
        """End the process, even during a task."""
        self._is_closed = True
        self._drop()

    def _ready(self) -> Child:
        """Return the process, replaced if it has ended or is unfit."""
        child = self._child
        if child is None or not (self._is_fit and child.is_alive()):
            self._drop()
            needed = (str(path) for path in self._warm or () if path is not None)
            child = self._child = Child("app.page.worker", *needed, is_log_handed_on=True)
            if self._niceness:
                os.setpriority(os.PRIO_PROCESS, child.pid, self._niceness)  # and its children
            self._is_fit = True
        return child

    def _drop(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            child.kill()

    def _done_by(
        self, child: Child, work: tuple[Task[Any, ResultT], Any], callbacks: RunCallbacks
    ) -> ResultT:
        limits, self._is_fit = self._limits, False
        child.clear_log()
        started = news_at = time.monotonic()
        news: object = None
        stop_by: float | None = None
        try:
            child.send((pickle.dumps(work), limits.additional_memory_bytes))
            while True:
                now = time.monotonic()
                if stop_by is None and callbacks.should_cancel():
                    stop_by = now + GRACE_S
                    child.send(None)
                if stop_by is not None and now > stop_by:
                    raise Cancelled
                if now - started > limits.run_s:
                    raise RunError(TOO_LONG.format(minutes=limits.run_s / 60))
                if now - news_at > limits.no_progress_s:
                    raise RunError(SILENT.format(seconds=limits.no_progress_s))
                if not child.has_message(_POLL_S):
                    continue
                match child.receive():
                    case (result, grown):
                        self._is_fit = grown < GROWN_BYTES
                        if isinstance(result, Exception):
                            raise result
                        return result
                    case event:
                        if event != news:
                            news, news_at = event, now
                        callbacks.on_event(event)
        except ChildExited as error:
            if stop_by is not None:
                raise Cancelled from error
            allowed = FOR_MEMORY.format(gigabytes=limits.additional_memory_bytes / 1e9)
            raise RunError(child.exit_report().user_message(ENDED, allowed, AGAIN)) from error


_NO_MEMORY = ("allocate memory", "not enough memory", "bad_alloc")
"""Parts of torch's RuntimeError messages for missing memory."""


def main() -> None:
    """Run the worker process: do tasks, and load the models in small steps in between."""
    channel, needed = parent_channel()
    works = start_receiving(channel)
    lock = threading.Lock()

    def tell(message: object) -> None:
        with lock:
            channel.send(message)

    reading = _warming_up(*map(Path, needed)) if needed else iter(())
    while True:
        while works.empty() and next(reading, True) is None:
            pass
        (work, memory_bytes), stop = works.get()
        before = _limit_memory(memory_bytes)
        try:
            task, request = pickle.loads(work)
            result = task(request, RunCallbacks(tell, stop.is_set))
        except Exception as error:
            result = _error_to_send(error)
        grown = _data_bytes() - before
        _limit_memory(None)
        tell((result, grown))


def _error_to_send(error: Exception) -> Exception:
    """Convert an exception to a cancellation, a sentence or a fault for the page."""
    if isinstance(error, Cancelled):
        return error.with_traceback(None)  # which would keep the task's objects alive
    if any(words in str(error) for words in _NO_MEMORY):
        error = MemoryError()
    sentence = errors.message_for_user(error)
    if sentence is None:
        return WorkerError(traceback.format_exc())
    return (DiskFullError if errors.is_disk_full(error) else RunError)(sentence)


def _warming_up(weights: Path, body: Path | None = None) -> Iterator[None]:
    """Load the models in small steps; errors are reported by the first run."""
    import app.run.pipeline  # noqa: F401
    from app.run import models

    yield
    try:
        yield from models.warm_up_in_steps(weights, body)
    except Exception:
        traceback.print_exc()


def _limit_memory(more_bytes: int | None) -> int:
    """Limit the additional memory of this process and its children; return the memory in use.

    The hard limit that the process was started with is never exceeded.
    """
    taken = _data_bytes()
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = hard
    if more_bytes is not None:
        limit = taken + more_bytes
        limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    return taken


def _data_bytes() -> int:
    """Return the memory that counts towards RLIMIT_DATA; 0 if the system does not report it."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData")), 0)


if __name__ == "__main__":
    main()
