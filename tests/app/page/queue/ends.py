"""Ways in which a child process ends in the middle of its work, each by its own hand."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path


class Ending:
    """Files to be looked at, which end whoever begins to look."""

    def __init__(self, end: Callable[[], None]) -> None:
        self.end = end

    def __iter__(self) -> Iterator[Path]:
        self.end()
        return iter(())


def carry_on() -> None:
    """Nothing ends."""


def wait() -> None:
    """Until somebody ends it from outside."""
    time.sleep(600)


def segfault() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def abort() -> None:
    os.abort()


def terminate() -> None:
    os.kill(os.getpid(), signal.SIGTERM)


def kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def leave_with_3() -> None:
    sys.stderr.write("the last words of it\x1b[2J\n")
    sys.exit(3)


def run_out_of_memory() -> None:
    raise MemoryError


def run_out_of_memory_in_c() -> None:
    """As C++ does where nobody catches it."""
    sys.stderr.write("terminate called after throwing an instance of 'std::bad_alloc'\n")
    sys.stderr.flush()
    os.abort()
