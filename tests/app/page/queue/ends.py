"""What a child process does in the middle of its work, each by its own hand."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np


class Ending:
    """Files to be looked at, which do that to whoever begins to look."""

    def __init__(self, end: Callable[[], None]) -> None:
        self.end = end

    def __iter__(self) -> Iterator[Path]:
        self.end()
        return iter(())


def carry_on() -> None:
    """Nothing ends."""


def wait() -> None:
    """Until somebody ends it from outside."""
    while True:
        signal.pause()


def take_five_gigabytes() -> None:
    """Which are never touched."""
    np.empty(5 * 10**9, np.uint8)


def segfault() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def terminate() -> None:
    os.kill(os.getpid(), signal.SIGTERM)


def kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def leave_with_3() -> None:
    sys.stderr.write("the last words of it\x1b[2J\n")
    sys.exit(3)


def run_out_of_memory_in_c() -> None:
    """As C++ does where nobody catches it."""
    sys.stderr.write("terminate called after throwing an instance of 'std::bad_alloc'\n")
    sys.stderr.flush()
    os.abort()
