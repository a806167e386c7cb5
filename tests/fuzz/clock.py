"""Fuzzing by the clock: one seed after another until a test's share of the time is over."""

import os
import resource
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, seed, settings

from app.errors import visitor_message

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
MOST_BYTES = 2 * 2**30
"""Of memory for one file or form."""
TESTS = 28
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
    """Check that it ends well or in one sentence that a person may be shown, without what is
    hidden, before it has taken `SLOWEST_S` of the processor, `MOST_BYTES` or for ever."""
    with _limited_memory(), _limited_time():
        try:
            work()
            return
        except MemoryError:
            sentence = ""
        except Exception as error:
            sentence = visitor_message(error)
            assert not any(fault in sentence for fault in PROGRAM_FAULTS), repr(error)
    assert sentence, f"it took more than {MOST_BYTES / 2**30:g} GiB"
    assert sentence.isprintable() and len(sentence) < 2000, repr(sentence)
    assert hidden not in sentence, sentence


@contextmanager
def _limited_memory() -> Iterator[None]:
    """Make a `MemoryError` of what would take the machine's memory, and end this process unheard
    or another that is innocent."""
    status = Path("/proc/self/status").read_text()
    used = 1024 * int(status.split("VmData:")[1].split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (used + MOST_BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def _limited_time() -> Iterator[None]:
    """Fail what takes too long; timers and handlers are afterwards as before, those of
    pytest-timeout among them, also when the time is over in the middle of setting them back."""
    signals = {signal.SIGPROF: signal.ITIMER_PROF, signal.SIGALRM: signal.ITIMER_REAL}
    before = [
        (number, signal.getsignal(number), timer, signal.getitimer(timer))
        for number, timer in signals.items()
    ]

    def set_back() -> None:
        for number, handler, timer, rest in before:
            signal.setitimer(timer, *rest)
            signal.signal(number, handler)

    def too_slow(number: int, frame: object) -> None:
        set_back()
        pytest.fail(f"it took longer than {SLOWEST_S} s")

    try:
        for number, timer in signals.items():
            signal.signal(number, too_slow)
            signal.setitimer(timer, SLOWEST_S if timer == signal.ITIMER_PROF else FOR_EVER_S)
        yield
    finally:
        set_back()
