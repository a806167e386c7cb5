from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from app.errors import RunError
from app.live import session as sessions
from app.live.session import LiveAsk, LiveSession, check_live
from app.run.models import get_system
from app.run.pieces import HEADER
from model.generation.live import LiveMotion
from model.generation.windows import GenerateOptions
from model.plan.plan import PHASES
from model.plan.style import Manner
from model.sampling.samplers import UnknownNameError
from model.speech.causal import CausalMel
from model.systems.registry import load_system
from tests.model.made import made_waveform
from tests.model.systems.planned.made import make_planned_weights

ASK = LiveAsk("globaldiff/global", "ann", seed=2)


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def sound(seconds: float, size: int = 640) -> list[bytes]:
    samples = (30_000 * made_waveform(round(16_000 * seconds))).astype("<i2")
    return [samples[k : k + size].tobytes() for k in range(0, len(samples), size)]


@pytest.fixture
def told() -> list[bytes | str]:
    return []


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def session(weights: Path, told: list[bytes | str], clock: Clock) -> LiveSession:
    return LiveSession(get_system(ASK.system, weights), ASK, "mine", told.append, clock)


def speak(session: LiveSession, clock: Clock, seconds: float, size: int = 640) -> None:
    for block in sound(seconds, size):
        clock.now += size / 16_000
        session.put(block)
        while session.has_work:
            session.work()


def test_frames_follow_the_speech_and_can_be_kept(
    session: LiveSession, told: list[bytes | str], clock: Clock
) -> None:
    speak(session, clock, 4.0)
    headers = [HEADER.unpack_from(message) for message in told if isinstance(message, bytes)]
    assert [first for first, *_ in headers] == list(np.cumsum([0] + [h[1] for h in headers])[:-1])
    made = sum(count for _, count, *_ in headers)
    assert 120 - 9 - 9 - 3 <= made <= 120 - 9
    kept = session.kept()
    assert kept.minute.motion.num_frames == made
    assert kept.facts["windows_of_session"] == len(headers) and kept.facts["window_cpu_ms"] > 0


def test_memory_does_not_grow(session: LiveSession, clock: Clock) -> None:
    def held() -> int:
        sound = sum(map(len, session.minute._sound)) + len(session._features._sound)
        return (
            sound + sum(p.num_frames for p in session.minute._pieces) + len(session._live._speech)
        )

    speak(session, clock, 63.0, size=16_000)
    before = held()
    speak(session, clock, 6.0, size=16_000)
    assert held() < 1.02 * before


def test_caps_of_speed_and_length_are_told(
    session: LiveSession, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RunError, match="faster than it can be spoken"):
        for block in sound(4.0):
            session.put(block)
    monkeypatch.setattr(sessions, "MAX_S", 5.0)
    clock.now += 10
    with pytest.raises(RunError, match="at most"):
        for block in sound(3.0):
            clock.now += 0.04
            session.put(block)


def test_a_place_that_is_not_used_is_lost(session: LiveSession, clock: Clock) -> None:
    with pytest.raises(RunError, match=r"Only 0\.0 s of sound came in the last 27 s"):
        for _ in range(9):
            clock.now += 9.0
            session.put(b"\0\0")


def test_sound_with_gaps_keeps_its_place(session: LiveSession, clock: Clock) -> None:
    block = sound(1.0, size=16_000)[0]
    for _ in range(60):  # a third of the time, as over a bad connection
        clock.now += 3.0
        session.put(block)
    with pytest.raises(RunError, match="needs all of it"):
        for _ in range(20):
            clock.now += 5.0
            session.put(block)


def test_a_microphone_that_was_forgotten_frees_its_place(
    session: LiveSession, clock: Clock
) -> None:
    def say(block: bytes, seconds: int) -> None:
        for _ in range(seconds):
            clock.now += 1.0
            session.put(block)

    silence, word = bytes(32_000), sound(1.0, size=16_000)[0]
    for _ in range(3):
        say(silence, 170)
        say(word, 1)
    with pytest.raises(RunError, match="Nothing could be heard for 3 minutes"):
        say(silence, 185)


def test_a_machine_that_cannot_keep_up_is_told(session: LiveSession, clock: Clock) -> None:
    for block in sound(9.5):
        clock.now += 0.04
        session.put(block)
    with pytest.raises(RunError, match="cannot keep up with 3 visitors at once"):
        session.work(visitors=3)


def test_a_slow_system_is_told_after_a_trial(
    session: LiveSession, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "MAX_WINDOW_MS", 1e-6)
    with pytest.raises(RunError, match=r"globaldiff/global takes .* ms for a frame.*gan/5"):
        speak(session, clock, 3.0)
    assert session.windows == sessions.TRIAL_WINDOWS + 1


def test_it_makes_what_the_model_makes_of_that_sound(
    session: LiveSession, clock: Clock, weights: Path
) -> None:
    speak(session, clock, 3.0)
    live = LiveMotion(get_system(ASK.system, weights), GenerateOptions("ann", seed=2))
    features, pieces = CausalMel(), []
    for block in sound(3.0):
        samples = np.frombuffer(block, "<i2").astype(np.float32) / 32_768
        live.hear(torch.from_numpy(features.hear(samples)))
        if live.is_due:
            pieces += live.step()
    poses = np.concatenate([piece.poses for piece in pieces])
    np.testing.assert_allclose(session.kept().minute.motion.poses, poses, atol=1e-5)


def test_after_its_end_nothing_is_taken_in(
    session: LiveSession, told: list[bytes | str], clock: Clock
) -> None:
    session.end("Over.")
    session.end("Again.")
    session.put(b"x")
    assert told == ["Over."] and not session.has_work


@pytest.mark.parametrize(
    "told",
    [
        None, 3, [], {}, {"system": "gan/5"}, {"system": "gan/5", "speaker": "ann"},
        {"system": ["gan/5"], "speaker": "ann", "seed": 0},
        {"system": "gan/5", "speaker": "ann", "seed": -1},
        {"system": "gan/5", "speaker": "ann", "seed": True},
        {"system": "gan/5", "speaker": "ann", "seed": 1e300},
    ],
)  # fmt: skip
def test_what_asks_for_nothing_is_refused(told: object) -> None:
    with pytest.raises(RunError):
        LiveAsk.of(told)


def test_an_unknown_speaker_is_told(weights: Path, told: list[bytes | str]) -> None:
    system = get_system(ASK.system, weights)
    with pytest.raises(UnknownNameError, match="no speaker 'eve'"):
        LiveSession(system, LiveAsk(ASK.system, "eve"), "", told.append)


def test_a_system_that_plans_tells_its_plan_and_takes_its_sliders(
    tmp_path: Path, clock: Clock
) -> None:
    told: list[bytes | str | dict] = []
    system = load_system("workbench/planned", make_planned_weights(tmp_path))
    check_live(system)
    ask = LiveAsk("workbench/planned", "ann", seed=2)
    session = LiveSession(system, ask, "", told.append, clock)
    speak(session, clock, 1.3, 6400)
    plans = [message["plan"] for message in told if isinstance(message, dict)]
    frames = [message for message in told if isinstance(message, bytes)]
    assert len(plans) == len(frames) >= 2
    starts = [HEADER.unpack_from(message)[0] for message in frames]
    assert [plan["from"] for plan in plans] == [round(start / 30, 3) for start in starts]
    for plan in plans:
        for hand in (plan["left"], plan["right"]):
            assert hand[0][0] <= plan["from"] < hand[0][1] and hand[-1][1] > plan["from"] + 2
            assert all(one[1] == pytest.approx(other[0]) for one, other in pairwise(hand))
            assert {phase for _, _, phase, _ in hand} <= set(PHASES)
        assert all(at >= plan["from"] for at in plan["nods"])
    session.lead({"manner": {"large": 2.0, "smile": 0}})
    speak(session, clock, 0.6, 6400)
    assert session._live._plans.manner == Manner(large=2.0, smile=0.0)
    for wrong in (None, {"manner": {"large": 99}}, {"manner": {"more": 1}}, {"manner": None}, []):
        with pytest.raises(RunError):
            session.lead(wrong)


def test_sliders_of_a_system_without_plans_are_refused(session: LiveSession) -> None:
    with pytest.raises(RunError, match="performs no plans, so its sliders do nothing"):
        session.lead({"manner": {}})
