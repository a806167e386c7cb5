"""Fuzzing by the clock: one seed after another until a test's share of the time is over."""

import os
import signal
import time
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, Phase, seed, settings

from app.errors import visitor_sentence

SECONDS = float(os.environ.get("FUZZ_SECONDS", "0"))
"""Of all fuzzing together; `make fuzz` gives an hour. Without it each test takes one seed."""
FIRST_SEED = int(os.environ.get("FUZZ_SEED", "0"))
EXAMPLES = 40 if SECONDS else 10
"""With one seed."""
SLOWEST_S = 20
"""Of this process's own time for one file or form, however damaged: on a busy machine the clock on
the wall says nothing."""
FOR_EVER_S = 300 if SECONDS else 60
"""By the clock on the wall: what has not ended by then hangs."""
TESTS = 25
PROGRAM_FAULTS = ("inside the program", "Traceback")

quickly = settings(
    max_examples=EXAMPLES,
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


def is_done_or_refused(work: Callable[[], object], hidden: str = "\x1b") -> None:
    """Whether it ends well or in one sentence that a person may be shown, without what is hidden;
    before it has taken `SLOWEST_S` of the processor, or for ever."""

    def too_slow(number: int, frame: object) -> None:
        pytest.fail(f"it took longer than {SLOWEST_S} s")

    signals = signal.SIGPROF, signal.SIGALRM
    before = [signal.signal(number, too_slow) for number in signals]
    timers = signal.ITIMER_PROF, signal.ITIMER_REAL
    left = [
        signal.setitimer(timer, seconds)
        for timer, seconds in zip(timers, (SLOWEST_S, FOR_EVER_S), strict=True)
    ]
    try:
        work()
    except Exception as error:
        sentence = visitor_sentence(error)
        assert not any(fault in sentence for fault in PROGRAM_FAULTS), repr(error)
        assert sentence.isprintable() and len(sentence) < 2000, repr(sentence)
        assert hidden not in sentence, sentence
    finally:
        for timer, rest, number, handler in zip(timers, left, signals, before, strict=True):
            signal.setitimer(timer, *rest)
            signal.signal(number, handler)
