"""What is too slow or too large fails its own test, and leaves nothing behind for the next."""

import resource
import signal
from collections.abc import Callable

import pytest

from tests.fuzz import clock


def limits() -> list[object]:
    """Handlers, whether timers run, and the limit of memory."""
    return [
        *(signal.getsignal(number) for number in (signal.SIGPROF, signal.SIGALRM)),
        *(bool(signal.getitimer(timer)[0]) for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL)),
        resource.getrlimit(resource.RLIMIT_DATA),
    ]


def loop() -> None:
    while True:
        pass


@pytest.mark.parametrize(
    ("seconds", "work", "words"),
    [
        ("SLOWEST_S", loop, "longer than"),
        ("FOR_EVER_S", signal.pause, "longer than"),
        (None, lambda: bytearray(4 * 2**30), "more than 2 GiB"),
    ],
)
def test_too_slow_and_too_large(
    monkeypatch: pytest.MonkeyPatch, seconds: str | None, work: Callable[[], object], words: str
) -> None:
    if seconds:
        monkeypatch.setattr(clock, seconds, 0.01)
    before = limits()
    with pytest.raises((pytest.fail.Exception, AssertionError), match=words):
        clock.is_done_or_refused(work)
    assert limits() == before


@pytest.mark.parametrize("call", range(4))
def test_time_that_is_over_while_timers_are_set_back(
    monkeypatch: pytest.MonkeyPatch, call: int
) -> None:
    """The alarm sounds right before each of the four calls that end the limits."""
    before, calls, is_done = limits(), iter(range(8)), []

    def sounding(change: Callable[..., object]) -> Callable[..., object]:
        def changed(*args: object) -> object:
            if is_done and next(calls) == call:
                signal.raise_signal(signal.SIGPROF if call < 2 else signal.SIGALRM)
            return change(*args)

        return changed

    for name in ("setitimer", "signal"):
        monkeypatch.setattr(signal, name, sounding(getattr(signal, name)))
    with pytest.raises(pytest.fail.Exception, match="longer than"):
        clock.is_done_or_refused(lambda: is_done.append(True))
    monkeypatch.undo()
    assert limits() == before
