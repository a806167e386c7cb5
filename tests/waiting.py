"""Waiting for what comes about beside a test."""

import time
from collections.abc import Callable


def wait_for(condition: Callable[[], object]) -> None:
    """A minute at most."""
    until = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < until, "it has not come about within a minute"
        time.sleep(0.05)
