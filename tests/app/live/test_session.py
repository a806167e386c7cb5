"""One visitor's live session: what is taken in, made, told and kept."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from app.errors import RunError
from app.live import session as sessions
from app.live.session import (
    MAX_SOUND_BYTES,
    LiveAsk,
    LiveSession,
    check_live,
    read_sound,
    why_less,
)
from app.live.told_plan import told_plan
from app.run.models import get_system
from app.run.pieces import HEADER, NUM_FACES, frames_message
from model.generation.live import LiveMotion
from model.generation.windows import GenerateOptions
from model.plan.plan import PHASES
from model.plan.style import Manner
from model.sampling.samplers import UnknownNameError
from model.speech.causal import CausalMel
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform

ASK = LiveAsk("globaldiff/global", "ann", seed=2)
SECOND = bytes(32_000)
"""Of silence."""


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def sound(seconds: float, size: int = 4000) -> list[bytes]:
    samples = (30_000 * made_waveform(round(16_000 * seconds))).astype("<i2")
    return [samples[k : k + size].tobytes() for k in range(0, len(samples), size)]


@pytest.fixture
def told() -> list[Any]:
    return []


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def session(weights: Path, told: list[Any], clock: Clock) -> LiveSession:
    return LiveSession(get_system(ASK.system, weights), ASK, "mine", told.append, clock)


@pytest.fixture
def planning(planned_weights: Path, told: list[Any], clock: Clock) -> LiveSession:
    system = get_system("workbench/planned", planned_weights)
    check_live(system)
    ask = LiveAsk("workbench/planned", "ann", seed=2)
    return LiveSession(system, ask, "", told.append, clock)


def speak(session: LiveSession, clock: Clock, seconds: float, size: int = 4000) -> None:
    for block in sound(seconds, size):
        clock.now += len(block) / 32_000
        session.put(block)
        while session.has_work:
            session.work()


def put(session: LiveSession, clock: Clock, seconds: float, block: bytes, every_s: float) -> None:
    """The same block again and again, which nobody works off."""
    for _ in range(round(seconds / every_s)):
        clock.now += every_s
        session.put(block)


def test_frames_follow_the_speech_as_the_model_makes_them_and_can_be_kept(
    session: LiveSession, told: list[Any], clock: Clock, weights: Path
) -> None:
    speak(session, clock, 3.0)
    headers = [HEADER.unpack_from(message) for message in told]
    assert [first for first, *_ in headers] == list(np.cumsum([0] + [h[1] for h in headers])[:-1])
    made = sum(count for _, count, *_ in headers)
    assert 90 - 9 - 9 - 3 <= made <= 90 - 9
    kept = session.kept()
    assert kept.minute.motion.num_frames == made and kept.minute.first_frame == 0
    assert kept.facts["windows_of_session"] == len(headers) and kept.facts["window_cpu_ms"] > 0
    assert kept.why_less == "" and kept.minute.plan is None

    live = LiveMotion(get_system(ASK.system, weights), GenerateOptions("ann", seed=2))
    features, pieces = CausalMel(), []
    for block in sound(3.0):
        samples = np.frombuffer(block, "<i2").astype(np.float32) / 32_768
        live.hear(torch.from_numpy(features.hear(samples)))
        if live.is_due:
            pieces += live.step()
    poses = np.concatenate([piece.poses for piece in pieces])
    np.testing.assert_allclose(kept.minute.motion.poses, poses, atol=1e-5)


def test_memory_does_not_grow(
    session: LiveSession, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.minute.KEPT_FRAMES", 60)

    def held() -> int:
        sound = sum(map(len, session.minute._sound)) + len(session._features._sound)
        frames = sum(piece.num_frames for piece in session.minute._pieces)
        return sound + frames + len(session._live._speech)

    speak(session, clock, 5.0, size=8000)
    before = held()
    speak(session, clock, 2.5, size=8000)
    assert held() < 1.02 * before


def test_caps_of_speed_and_length_are_told(
    session: LiveSession, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(session, clock, 3.0, SECOND, 1.0)
    session.put(SECOND)
    with pytest.raises(RunError, match="faster than it can be spoken"):
        for _ in range(3):
            session.put(SECOND)
    monkeypatch.setattr(sessions, "MAX_S", 8.0)
    clock.now += 4
    with pytest.raises(RunError, match="at most"):
        put(session, clock, 3.0, SECOND, 1.0)


@pytest.mark.parametrize(
    ("spoken", "steps", "sentence"),
    [
        # Seconds, a block each so many.
        ("word", [(180, 3.0)], ""),  # a third of the time, as over a bad connection
        ("word", [(180, 3.0), (100, 5.0)], "needs all of it"),
        ("sample", [(81, 9.0)], r"Only 0\.0 s of sound came in the last 27 s"),
        ("silence", [(180, 1.0)], ""),
        ("silence", [(182, 1.0)], "Nothing could be heard for 3 minutes"),
    ],
)
def test_a_place_that_is_not_used_is_lost(
    session: LiveSession,
    clock: Clock,
    spoken: str,
    steps: list[tuple[float, float]],
    sentence: str,
) -> None:
    word = sound(1.0, size=16_000)[0]
    block = {"word": word, "sample": b"\0\0", "silence": SECOND}[spoken]
    if spoken == "silence":
        put(session, clock, 100.0, SECOND, 1.0)
        put(session, clock, 1.0, word, 1.0)  # somebody is there
    if not sentence:
        for seconds, every_s in steps:
            put(session, clock, seconds, block, every_s)
        return
    with pytest.raises(RunError, match=sentence):
        for seconds, every_s in steps:
            put(session, clock, seconds, block, every_s)


def test_a_machine_that_cannot_keep_up_and_a_slow_system_are_told(
    weights: Path, session: LiveSession, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    for block in sound(9.5):
        clock.now += 0.25
        session.put(block)
    with pytest.raises(RunError, match="cannot keep up with 3 visitors at once"):
        session.work(visitors=3)
    monkeypatch.setattr(sessions, "MAX_WINDOW_MS", 1e-6)
    slow = LiveSession(get_system(ASK.system, weights), ASK, "", lambda _: None, clock)
    with pytest.raises(RunError, match=r"globaldiff/global takes .* ms for a frame.*gan/5"):
        speak(slow, clock, 3.0)
    assert slow.windows == sessions.TRIAL_WINDOWS + 1


def test_what_is_missing_of_what_was_spoken_is_said(session: LiveSession, clock: Clock) -> None:
    speak(session, clock, 3.0)
    minute = session.kept().minute
    made_s = minute.motion.num_frames / 30
    assert why_less(minute, made_s + 1.9) == ""
    told = why_less(minute, made_s + 2.5)
    assert told.startswith(f"{made_s:.1f} s are kept: the last 2.5 s spoken had no motion yet")
    later = replace(minute, first_frame=45)
    assert why_less(later, made_s).startswith(f"Only the last {made_s:.0f} s are held; the 1.5 s")


def test_after_its_end_nothing_is_taken_in(session: LiveSession, told: list[Any]) -> None:
    session.end("Over.")
    session.end("Again.")
    session.put(b"x")
    assert told == ["Over."] and not session.has_work


@pytest.mark.parametrize(
    "told",
    [
        None, 3, [], {}, {"system": "gan/5"}, {"system": "gan/5", "speaker": "ann"},
        {"system": ["gan/5"], "speaker": "ann", "seed": 0},
        *({"system": "gan/5", "speaker": "ann", "seed": seed} for seed in (-1, True, 1e300, 2**31)),
    ],
)  # fmt: skip
def test_what_asks_for_nothing_is_refused(told: object) -> None:
    with pytest.raises(RunError):
        LiveAsk.of(told)


def test_an_unknown_speaker_is_told(weights: Path) -> None:
    assert LiveAsk.of({"system": "a", "speaker": "b", "seed": 2**31 - 1}).seed == 2**31 - 1
    with pytest.raises(UnknownNameError, match="no speaker 'eve'"):
        system = get_system(ASK.system, weights)
        LiveSession(system, LiveAsk(ASK.system, "eve"), "", lambda _: None)


def test_sound_is_read_as_it_was_written_and_other_bytes_are_refused() -> None:
    samples = np.array([0, 16384, -32768, 32767], "<i2")
    np.testing.assert_array_equal(read_sound(samples.tobytes()), samples / 32_768)
    assert len(read_sound(bytes(MAX_SOUND_BYTES))) == 16_000
    too_much = bytes(MAX_SOUND_BYTES + 2)
    for content, words in ((b"", "damaged"), (b"abc", "damaged"), (too_much, "at most 32000")):
        with pytest.raises(RunError, match=words):
            read_sound(content)


def test_frames_can_be_read_back_as_the_format_says() -> None:
    motion = smooth_motion_example(7)
    message = frames_message(120, motion, made_ms=61.5, waited_ms=3.0, visitors=2)
    assert HEADER.unpack_from(message) == (120, 7, NUM_FACES, 61.5, 3.0, 2, 0)
    at = HEADER.size
    assert at == 20
    trans = np.frombuffer(message, "<f4", 21, at).reshape(7, 3)
    np.testing.assert_array_equal(trans, motion.trans)
    turns = np.frombuffer(message, "<i2", 7 * 55 * 4, at + 84).reshape(-1, 4) / 32_767
    apart = Rotation.from_quat(turns) * Rotation.from_rotvec(motion.poses.reshape(-1, 3)).inv()
    assert apart.magnitude().max() < 2e-4
    faces = np.frombuffer(message, np.uint8, offset=at + 84 + 7 * 440).reshape(7, 52) / 255
    np.testing.assert_allclose(faces, motion.expressions[:, :52].clip(0, 1), atol=0.002)


def test_a_system_that_plans_tells_its_plan_and_keeps_what_was_planned_when_each_frame_was_made(
    planning: LiveSession, told: list[Any], clock: Clock
) -> None:
    made: list[tuple[int, int, dict]] = []
    step = planning._live.step

    def watched() -> Any:
        first = planning._live.next_frame
        motion = step()
        made.append((first, planning._live.next_frame, told_plan(planning._live.ahead, first)))
        return motion

    planning._live.step = watched  # type: ignore[method-assign]
    speak(planning, clock, 3.6, 4800)
    plans = [message["plan"] for message in told if isinstance(message, dict)]
    starts = [HEADER.unpack_from(message)[0] for message in told if isinstance(message, bytes)]
    assert len(plans) == len(starts) >= 3 and plans == [plan for _, _, plan in made]
    assert [plan["from"] for plan in plans] == [round(start / 30, 3) for start in starts]
    for plan in plans:
        for hand in (plan["left"], plan["right"]):
            assert hand[0][0] <= plan["from"] < hand[0][1] and hand[-1][1] > plan["from"] + 2
            assert all(one[1] == pytest.approx(other[0]) for one, other in pairwise(hand))
            assert {phase for _, _, phase, _ in hand} <= set(PHASES)
        assert all(at >= plan["from"] for at in plan["nods"])
    kept = planning.kept().minute
    assert kept.plan is not None and kept.first_frame == 0
    assert kept.plan.duration_s == pytest.approx(kept.motion.num_frames / 30)
    checked = 0
    for side in ("left", "right"):
        phases = kept.plan.hand(side)
        assert phases[0].start_s == 0
        assert all(one.end_s == pytest.approx(other.start_s) for one, other in pairwise(phases))
        for first, stop, told_then in made:
            for frame in range(first, stop):
                at = (frame + 0.5) / 30
                now = next(one for one in phases if one.start_s <= at < one.end_s)
                then = next(one for one in told_then[side] if one[0] <= at < one[1])
                assert (now.phase, now.kind) == (then[2], then[3])
                checked += 1
    assert checked == 2 * kept.motion.num_frames


def test_its_sliders_lead_from_the_next_window_on_and_of_other_systems_they_are_refused(
    planning: LiveSession, session: LiveSession, clock: Clock
) -> None:
    planning.lead({"manner": {"large": 2.0, "smile": 0}})
    speak(planning, clock, 1.0, 4800)
    assert planning._live._plans.manner == Manner(large=2.0, smile=0.0)
    wrong = (None, {"manner": {"large": 99}}, {"manner": {"more": 1}}, {"manner": None}, [])
    leads: list[Callable[[], None]] = [lambda told=told: planning.lead(told) for told in wrong]
    for lead in leads:
        with pytest.raises(RunError):
            lead()
    with pytest.raises(RunError, match="performs no plans, so its sliders do nothing"):
        session.lead({"manner": {}})
