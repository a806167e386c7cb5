"""How many of torch's threads make a motion."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Torch works in one thread inside the block, and with as many as before after it.

    Windows are small: a second thread saves a fifth on an idle machine, and where anything else
    works both wait for each other and take three times as long. Numbers stay the same.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
