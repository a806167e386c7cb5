"""What child processes say on standard error: handed on, and the last of it kept for the case that
one ends without a word."""

import faulthandler
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Iterable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import IO

from processes.ended import Ended, last_lines, memory_kills

_KEPT_LINES = 200
_JOIN_S = 5.0


class ChildLog:
    """Keeps the last of what children say."""

    def __init__(self, stream: IO[bytes], is_handed_on: bool = True) -> None:
        """
        Args:
            stream: the reading end of a pipe; closed when its writers are gone.
            is_handed_on: whether all of it goes to standard error, too.
        """
        self._stream = stream
        self._is_handed_on = is_handed_on
        self._kept: deque[str] = deque(maxlen=_KEPT_LINES)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def forget(self) -> None:
        """Of what was said so far; another piece of work begins."""
        self._kept.clear()

    def lines(self, patience_s: float = 1.0) -> tuple[str, ...]:
        """The last lines of a child that has ended; others may hold the pipe open."""
        self._reader.join(patience_s)
        return last_lines("\n".join(list(self._kept)))

    def _read(self) -> None:
        with self._stream:
            for line in iter(self._stream.readline, b""):
                text = line.decode(errors="replace").rstrip("\r\n")
                self._kept.append(text)
                if self._is_handed_on:
                    _say(text)


def _say(text: str) -> None:
    try:
        sys.stderr.write(f"{text}\n")
    except (OSError, ValueError):  # nobody reads it any more
        pass


class WorkerLog:
    """Of a pool's processes, which are started by `multiprocessing`: give `end` to the initializer,
    which hands it to `log_to`. Use it in ``with``, around the pool."""

    def __init__(self) -> None:
        reader, self.end = Pipe(duplex=False)
        self._log = ChildLog(os.fdopen(os.dup(reader.fileno()), "rb"))
        reader.close()
        self._killed_before = memory_kills()

    def __enter__(self) -> "WorkerLog":
        return self

    def ended(self, workers: Iterable[BaseProcess]) -> Ended:
        """How the first of a broken pool's processes ended; the pool has ended the others."""
        for worker in workers:
            worker.join(_JOIN_S)
        self.end.close()
        statuses = [worker.exitcode for worker in workers if worker.exitcode]
        own = [status for status in statuses if status != -signal.SIGTERM]
        status = next(iter([*own, *statuses]), None)
        return Ended(status, self._log.lines(), memory_kills() > self._killed_before)

    def __exit__(self, *exception: object) -> None:
        self.end.close()


def log_to(end: Connection) -> None:
    """In a worker: what it says from now on goes there, and a crash says where it was."""
    os.dup2(end.fileno(), 2)
    end.close()
    faulthandler.enable(2)
