"""One of many independent pieces of work.

A job leaves its result under a final name when it is whole, and that is the record that it is done:
whatever is killed, the same call goes on with what is not there yet. Nothing travels back but news.
"""

from collections.abc import Callable
from dataclasses import dataclass


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
        """The work, unless another worker has done it meanwhile."""
        if not self.is_done():
            self.work()


def use_one_thread() -> None:
    """For torch: workers stand side by side, and numbers do not depend on how many cores there
    are."""
    import torch

    torch.set_num_threads(1)
