"""Ways in which a child process ends in the middle of its work, each by its own hand."""

import os
import signal
import sys
from collections.abc import Callable


class Ending:
    """A request that ends whoever looks at it."""

    def __init__(self, end: Callable[[], None]) -> None:
        self.end = end

    @property
    def body(self) -> None:
        self.end()

    videos = transcript = body


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
