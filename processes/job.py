"""One of many independent pieces of work.

A job leaves its result under a final name when it is whole, and that is the record that it is done:
whatever is killed, the same call goes on with what is not there yet. Nothing travels back but news.
"""

from collections.abc import Callable
from dataclasses import dataclass

from threadpoolctl import threadpool_limits


class Cancelled(Exception):
    """Work was stopped from outside; nothing is left of it."""


class JobsError(RuntimeError):
    """The jobs cannot go on; the message is one sentence for a person."""


@dataclass(frozen=True)
class Job:
    """One piece of work. Both functions go to other processes, so they are importable, or
    `functools.partial` of what is."""

    name: str
    is_done: Callable[[], bool]
    """Whether its result is there, whole and of this very job. Asked where the work is done too."""
    work: Callable[[], object]
    """Leaves the result, whole or not at all."""

    def do(self) -> None:
        """The work, unless another worker has done it meanwhile.

        By one thread of numpy's: threads of many workers would wait for each other on the same
        cores, and the last digits would depend on how many there are.
        """
        if not self.is_done():
            with threadpool_limits(1, user_api="blas"):
                self.work()
