"""Fuzzing by the clock: one seed after another until a test's share of the time is over."""

import os
import signal
import time
from collections.abc import Callable

from hypothesis import HealthCheck, Phase, seed, settings

SECONDS = float(os.environ.get("FUZZ_SECONDS", "30"))
"""Of all fuzzing together; `make fuzz` gives an hour."""
FIRST_SEED = int(os.environ.get("FUZZ_SEED", "0"))
SLOWEST_S = 20
"""Of this process's own time for one file or form, however damaged: on a busy machine the clock on
the wall says nothing."""
FOR_EVER_S = 300
"""By the clock on the wall: what has not ended by then hangs."""
TESTS = 16

quickly = settings(
    max_examples=40,
    deadline=None,
    database=None,
    phases=[Phase.generate, Phase.shrink],
    report_multiple_bugs=False,
    suppress_health_check=list(HealthCheck),
)


def run_by_the_clock(check: Callable[[], None]) -> None:
    """Run a hypothesis test with seeds `FIRST_SEED`, + 1, ... for its part of `SECONDS`."""
    until = time.monotonic() + SECONDS / TESTS
    number = FIRST_SEED
    check = quickly(check)
    while number == FIRST_SEED or time.monotonic() < until:
        try:
            seed(number)(check)()
        except BaseException as error:
            error.add_note(f"FUZZ_SEED={number} shows it again")
            raise
        number += 1


def within_time(work: Callable[[], object]) -> None:
    """Do it, or fail once it has taken `SLOWEST_S` of the processor, or for ever."""

    def too_slow(number: int, frame: object) -> None:
        raise AssertionError(f"it took longer than {SLOWEST_S} s")

    signals = signal.SIGPROF, signal.SIGALRM
    before = [signal.signal(number, too_slow) for number in signals]
    signal.setitimer(signal.ITIMER_PROF, SLOWEST_S)
    signal.setitimer(signal.ITIMER_REAL, FOR_EVER_S)
    try:
        work()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler)
