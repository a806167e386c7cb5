"""The child of `app.page.queue.worker`: tasks come in, news and one outcome go out."""

from __future__ import annotations

import os
import pickle
import queue
import resource
import threading
import traceback
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from app.errors import CancelledRun, sentence_of
from app.run.ask import Event
from processes.child import parent_channel

_NO_MEMORY = ("allocate memory", "not enough memory", "bad_alloc")
"""What torch says in a RuntimeError."""


def main() -> None:
    """Take work as it comes, and read what all of it needs while there is none."""
    channel, needed = parent_channel()
    works: queue.SimpleQueue[tuple[Any, threading.Event]] = queue.SimpleQueue()
    lock = threading.Lock()

    def tell(kind: str, value: object) -> None:
        with lock:
            channel.send((kind, value))

    def on_event(event: Event) -> None:
        tell("event", event)

    threading.Thread(target=_listen, args=(channel, works), daemon=True).start()
    reading = _warming_up(*map(Path, needed)) if needed else iter(())
    while True:
        while works.empty() and next(reading, True) is None:
            pass
        (work, memory_bytes), stop = works.get()
        before = _limit_memory(memory_bytes)
        try:
            task, request = pickle.loads(work)
            result = task(request, on_event, stop.is_set)
            told = ("done", (result, _data_bytes() - before))
        except CancelledRun:
            told = ("cancelled", None)
        except Exception as error:
            if any(words in str(error) for words in _NO_MEMORY):
                error = MemoryError()
            sentence = sentence_of(error)
            told = ("fault", traceback.format_exc()) if sentence is None else ("sentence", sentence)
        _limit_memory(None)
        tell(*told)


def _warming_up(weights: Path, body: Path | None = None) -> Iterator[None]:
    """In small parts; a failure shows at the first run."""
    import app.run.pipeline  # noqa: F401
    from app.run import models

    yield
    try:
        yield from models.warming_up(weights, body)
    except Exception:
        traceback.print_exc()


def _listen(channel: Connection, works: queue.SimpleQueue[tuple[Any, threading.Event]]) -> None:
    """Works come, each with what stops it, and None, which stops the last that has come. Without a
    parent nobody asks for any."""
    stop = threading.Event()
    try:
        while True:
            told = channel.recv()
            if told is None:
                stop.set()
            else:
                stop = threading.Event()
                works.put((told, stop))
    except (EOFError, OSError):
        os._exit(0)


def _limit_memory(more_bytes: int | None) -> int:
    """Let this process, and what it starts, take so much more; returns what it has taken."""
    taken = _data_bytes()
    limit = resource.RLIM_INFINITY if more_bytes is None else taken + more_bytes
    resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.RLIM_INFINITY))
    return taken


def _data_bytes() -> int:
    """What the system counts towards that limit; 0 where it does not tell."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData")), 0)


if __name__ == "__main__":
    main()
