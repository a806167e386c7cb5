"""All live sessions of a process: places, turns, and the minute that is kept of each."""

import threading
from pathlib import Path

import pytest
import torch

from app.errors import RunError
from app.live import sessions as module
from app.live.session import LiveAsk, LiveSession
from app.live.sessions import LiveSessions
from tests.app.live.test_session import sound

ASK = LiveAsk("globaldiff/global", "ann")


class ByHand(LiveSessions):
    """Its worker is the test."""

    def _start_worker(self) -> None:
        pass


@pytest.fixture
def sessions(weights: Path) -> LiveSessions:
    return ByHand(weights)


def nothing(message: object) -> None:
    """Nobody listens."""


def test_everyone_gets_a_window_before_anyone_gets_a_second(sessions: LiveSessions) -> None:
    turns: list[str] = []

    def speaks(name: str, seconds: float) -> LiveSession:
        session = sessions.open(ASK, name, lambda message: turns.append(name))
        for block in sound(seconds):
            sessions.put(session, block)
        return session

    opened = [speaks("a", 2.9), speaks("b", 2.9), speaks("c", 1.2)]
    while any(session.has_work for session in opened):
        sessions._turn()
    assert turns[:3] == ["a", "b", "c"]
    assert set(turns[3:]) == {"a", "b"} and turns.count("a") == turns.count("b")


def test_places_are_bounded_in_all_and_for_each_address(weights: Path) -> None:
    sessions = ByHand(weights, max_sessions=4, max_sessions_each=2)
    first, _ = (sessions.open(ASK, "", nothing, "10.0.0.1") for _ in range(2))
    with pytest.raises(RunError, match="2 visitors speak live from your address already"):
        sessions.open(ASK, "", nothing, "10.0.0.1")
    for k in range(2):
        sessions.open(ASK, str(k), nothing, f"10.0.1.{k}")
    for cookie in ("fifth", ""):
        with pytest.raises(RunError, match="4 visitors speak live on this machine already"):
            sessions.open(ASK, cookie, nothing, "10.0.2.1")
    sessions.close(first)
    sessions.open(ASK, "mine", nothing, "10.0.0.1")
    sessions.open(ASK, "mine", nothing, "10.0.0.1")  # in another tab: the first ends
    assert sessions.num_open == 4
    assert (module.MAX_SESSIONS, module.MAX_SESSIONS_EACH) == (10, 6)  # as the README has it


def test_a_browser_has_one_session_and_no_other_browser_ends_it(sessions: LiveSessions) -> None:
    told: list[object] = []
    sessions.open(ASK, "mine", told.append)
    sessions.open(ASK, "other", nothing)
    for _ in range(2):
        sessions.open(ASK, "", nothing)
    assert not told and sessions.num_open == 4
    sessions.open(ASK, "mine", nothing)
    assert told == [module.TAKEN_OVER] and sessions.num_open == 4


def test_a_minute_is_kept_for_its_own_browser_and_for_a_while(
    sessions: LiveSessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = sessions.open(ASK, "mine", nothing)
    for block in sound(2.9):
        sessions.put(session, block)
    sessions._turn()
    sessions._turn()
    _, kept = sessions.kept(session.token, "mine")
    assert kept.minute.motion.num_frames > 60
    sessions.close(session)
    assert sessions.kept(session.token, "mine")[0] is session
    for token, cookie in ((session.token, "yours"), (session.token, ""), ("x", "mine"), ("ü", "")):
        with pytest.raises(RunError, match="no live minute"):
            sessions.kept(token, cookie)
    monkeypatch.setattr(module, "KEEP_S", -1.0)
    with pytest.raises(RunError, match="no live minute"):
        sessions.kept(session.token, "mine")


def test_a_fault_ends_its_own_session_only(
    sessions: LiveSessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[object] = []
    broken = sessions.open(ASK, "a", told.append)
    whole = sessions.open(ASK, "b", nothing)
    monkeypatch.setattr(broken, "work", lambda visitors: 1 / 0)
    for session in (broken, whole):
        for block in sound(1.5):
            sessions.put(session, block)
    for _ in range(3):
        sessions._turn()
    assert len(told) == 1 and "report it with this number" in str(told[0])
    assert whole.windows == 1 and sessions.num_open == 1


def test_the_worker_works_and_leaves_the_threads_of_others_alone(weights: Path) -> None:
    torch.set_num_threads(2)
    made = threading.Event()
    sessions = LiveSessions(weights)
    session = sessions.open(ASK, "", lambda message: made.set())
    for block in sound(1.5):
        sessions.put(session, block)
    assert made.wait(60)
    counts: list[int] = []
    thread = threading.Thread(target=lambda: counts.append(torch.get_num_threads()))
    thread.start()
    thread.join()
    assert counts == [2] and torch.get_num_threads() == 2
    sessions.close(session)
    assert sessions.num_open == 0
