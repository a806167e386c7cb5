import threading
import time
from pathlib import Path

import pytest
import torch

from app.errors import RunError
from app.live import desk as desks
from app.live.desk import LiveDesk
from app.live.session import LiveAsk, LiveSession
from tests.app.live.test_session import sound

ASK = LiveAsk("globaldiff/global", "ann")


class ByHand(LiveDesk):
    """Its worker is the test."""

    def _start_worker(self) -> None:
        pass


@pytest.fixture
def desk(weights: Path) -> LiveDesk:
    return ByHand(weights)


def nothing(message: bytes | str) -> None:
    """Nobody listens."""


def test_everyone_gets_a_window_before_anyone_gets_a_second(desk: LiveDesk) -> None:
    turns: list[str] = []

    def opened(name: str) -> LiveSession:
        return desk.open(ASK, name, lambda message: turns.append(name))

    sessions = [opened(name) for name in "abc"]
    for session in sessions:
        for block in sound(2.9):
            desk.put(session, block)
    late = opened("d")
    for block in sound(1.2):
        desk.put(late, block)
    while any(session.has_work for session in (*sessions, late)):
        desk._turn()
    assert turns[:4] == ["a", "b", "c", "d"]
    assert set(turns[4:]) <= set("abc") and len(turns) > 4


def test_the_eleventh_is_told_until_one_has_gone(desk: LiveDesk) -> None:
    sessions = [desk.open(ASK, str(k), nothing) for k in range(10)]
    with pytest.raises(RunError, match="10 visitors speak live on this machine already"):
        desk.open(ASK, "eleventh", nothing)
    with pytest.raises(RunError, match="10 visitors"):
        desk.open(ASK, "", nothing)
    desk.close(sessions[3])
    desk.open(ASK, "eleventh", nothing)
    assert desk.num_open == 10


def test_one_address_leaves_places_for_others(desk: LiveDesk) -> None:
    sessions = [desk.open(ASK, "", nothing, "10.0.0.1") for _ in range(6)]
    with pytest.raises(RunError, match="6 visitors speak live from your address already"):
        desk.open(ASK, "", nothing, "10.0.0.1")
    for k in range(3):
        desk.open(ASK, str(k), nothing, f"10.0.1.{k}")
    desk.close(sessions[0])
    desk.open(ASK, "mine", nothing, "10.0.0.1")
    desk.open(ASK, "mine", nothing, "10.0.0.1")  # in another tab: the first ends
    with pytest.raises(RunError, match="from your address"):
        desk.open(ASK, "another", nothing, "10.0.0.1")
    assert desk.num_open == 9


def test_a_browser_has_one_session_and_no_other_browser_ends_it(desk: LiveDesk) -> None:
    told: list[bytes | str] = []
    desk.open(ASK, "mine", told.append)
    desk.open(ASK, "other", nothing)
    for _ in range(2):
        desk.open(ASK, "", nothing)
    assert not told and desk.num_open == 4
    desk.open(ASK, "mine", nothing)
    assert told == [desks.TAKEN_OVER] and desk.num_open == 4


def test_a_minute_is_kept_for_its_own_browser_and_for_a_while(
    desk: LiveDesk, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = desk.open(ASK, "mine", nothing)
    for block in sound(2.9):
        desk.put(session, block)
    desk._turn()
    desk._turn()
    _, kept = desk.kept(session.token, "mine")
    assert kept.minute.motion.num_frames > 60
    desk.close(session)
    assert desk.kept(session.token, "mine")[0] is session
    for token, cookie in ((session.token, "yours"), (session.token, ""), ("x", "mine"), ("ü", "")):
        with pytest.raises(RunError, match="no live minute"):
            desk.kept(token, cookie)
    monkeypatch.setattr(desks, "KEEP_S", -1.0)
    with pytest.raises(RunError, match="no live minute"):
        desk.kept(session.token, "mine")


def test_a_fault_ends_its_own_session_only(desk: LiveDesk, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[bytes | str] = []
    broken = desk.open(ASK, "a", told.append)
    whole = desk.open(ASK, "b", nothing)
    monkeypatch.setattr(broken, "work", lambda visitors: 1 / 0)
    for session in (broken, whole):
        for block in sound(1.5):
            desk.put(session, block)
    for _ in range(3):
        desk._turn()
    assert len(told) == 1 and "report it with this number" in str(told[0])
    assert whole.windows == 1 and desk.num_open == 1


def test_the_worker_works_and_leaves_the_threads_of_others_alone(weights: Path) -> None:
    torch.set_num_threads(2)
    made = threading.Event()
    desk = LiveDesk(weights)
    session = desk.open(ASK, "", lambda message: made.set())
    for block in sound(2.0):
        desk.put(session, block)
    assert made.wait(30)
    counts: list[int] = []
    thread = threading.Thread(target=lambda: counts.append(torch.get_num_threads()))
    thread.start()
    thread.join()
    assert counts == [2] and torch.get_num_threads() == 2
    desk.close(session)
    time.sleep(0.05)
    assert desk.num_open == 0
