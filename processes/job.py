"""Independent jobs for worker processes, and their errors.

A job writes its result under a final name when it is complete, which also records that it is done:
after any interruption, the same call continues with the rest. Only status messages are returned.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits


class Cancelled(Exception):
    """Work was stopped from outside; it leaves nothing behind."""


class JobsError(RuntimeError):
    """The jobs cannot continue; the message is one sentence for the user."""


@dataclass(frozen=True)
class Job:
    """One job, with functions that other processes can import (or `functools.partial` of such)."""

    name: str
    is_done: Callable[[], bool]
    """Function that checks whether the complete result of this job exists; workers call it too."""
    work: Callable[..., object]
    """Function that writes the result atomically."""
    takes_callbacks: bool = False
    """Whether ``work`` takes the two callbacks of `run`."""

    def run(
        self,
        on_message: Callable[[Any], object] = lambda message: None,
        should_cancel: Callable[[], bool] = lambda: False,
    ) -> None:
        """Do the work, unless another worker has done it.

        Numpy uses one thread: threads of many workers would wait for each other on the same cores,
        and the last digits would depend on their number.
        """
        if not self.is_done():
            with threadpool_limits(1, user_api="blas"):
                self.work(*((on_message, should_cancel) if self.takes_callbacks else ()))
