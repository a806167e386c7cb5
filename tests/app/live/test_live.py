"""Live sessions: sound in, frames out, the last minute kept, and places for all."""

import os
import queue
import signal
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
from app.live import session as limits
from app.live import session_process as module
from app.live import sessions as sounds
from app.live.session import (
    MAX_RECORDED_FRAMES,
    LiveSession,
    RecordingBuffer,
    check_supports_live,
    merge_plans,
    missing_speech_note,
    planned_events_json,
)
from app.live.session_process import SessionScheduler, parse_live_options
from app.live.sessions import MAX_SOUND_BYTES, AudioGuard, LiveSessions, decode_audio
from app.run.frame_packets import HEADER, NUM_FACES, frames_message
from app.run.models import get_system
from app.run.requests.parts import SamplingOptions
from model.generation.live import LiveGenerator
from model.generation.windows import GenerateOptions
from model.motion.motion import load_motion
from model.plan.plan import PHASES, Blink, Gaze, GesturePlan, HandPhase, Nod, Stance, StreamedPlan
from model.plan.style import LiveStyle
from model.sampling.samplers import UnknownNameError
from model.speech.features import StreamingMelEncoder
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform
from tests.model.plan.made import phase

NAME = "globaldiff/global"
OPTIONS = SamplingOptions(systems=(NAME,), speaker="ann", seed=2)
TOLD = {"system": NAME, "speaker": "ann", "seed": 2}
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
    return LiveSession(get_system(NAME, weights), OPTIONS, told.append, clock)


@pytest.fixture
def planning(planned_weights: Path, told: list[Any], clock: Clock) -> LiveSession:
    system = get_system("workbench/planned", planned_weights)
    check_supports_live(system)
    ask = replace(OPTIONS, systems=("workbench/planned",))
    return LiveSession(system, ask, told.append, clock)


def speak(session: LiveSession, clock: Clock, seconds: float, size: int = 4000) -> None:
    for block in sound(seconds, size):
        clock.now += len(block) / 32_000
        session.add_audio(decode_audio(block))
        while session.has_work:
            session.process_input()


@pytest.fixture
def microphone(clock: Clock) -> AudioGuard:
    return AudioGuard(clock)


def put(at: AudioGuard, clock: Clock, seconds: float, block: bytes, every_s: float) -> None:
    """The same block again and again."""
    for _ in range(round(seconds / every_s)):
        clock.now += every_s
        at.check(block)


def test_frames_follow_the_speech_as_the_model_makes_them_and_can_be_kept(
    session, told, clock, weights, tmp_path
):
    speak(session, clock, 3.0)
    headers = [HEADER.unpack_from(message) for message in told]
    assert [first for first, *_ in headers] == list(np.cumsum([0] + [h[1] for h in headers])[:-1])
    made = sum(count for _, count, *_ in headers)
    assert 90 - 9 - 9 - 3 <= made <= 90 - 9
    kept = session.save_last_minute(tmp_path).live_recording
    assert kept is not None
    motion = load_motion(kept.motion)
    assert motion.num_frames == made and kept.metadata["first_frame_of_session"] == 0
    assert (
        kept.metadata["windows_of_session"] == len(headers) and kept.metadata["window_cpu_ms"] > 0
    )
    assert kept.truncation_note == "" and kept.plan is None

    live = LiveGenerator(get_system(NAME, weights), GenerateOptions("ann", seed=2))
    features, pieces = StreamingMelEncoder(), []
    for block in sound(3.0):
        samples = np.frombuffer(block, "<i2").astype(np.float32) / 32_768
        live.add_features(torch.from_numpy(features.add_samples(samples)))
        if live.is_due:
            pieces += live.step()
    poses = np.concatenate([piece.poses for piece in pieces])
    np.testing.assert_allclose(motion.poses, poses, atol=1e-5)


def test_memory_does_not_grow(session, clock, monkeypatch):
    monkeypatch.setattr("app.live.session.MAX_RECORDED_FRAMES", 60)

    def held() -> int:
        return len(session.minute) + len(session._features._sound) + len(session._live._speech)

    speak(session, clock, 5.0, size=8000)
    before = held()
    speak(session, clock, 2.5, size=8000)
    assert held() < 1.02 * before


def test_caps_of_speed_and_length_are_told(microphone, clock, monkeypatch):
    put(microphone, clock, 3.0, SECOND, 1.0)
    microphone.check(SECOND)
    with pytest.raises(RunError, match="s ahead of real time"):
        for _ in range(3):
            microphone.check(SECOND)
    monkeypatch.setattr(sounds, "MAX_S", 8.0)
    clock.now += 4
    with pytest.raises(RunError, match="at most"):
        put(microphone, clock, 3.0, SECOND, 1.0)


@pytest.mark.parametrize(
    ("spoken", "steps", "sentence"),
    [
        # Seconds, a block each so many.
        ("word", [(180, 3.0)], ""),  # a third of the time, as over a bad connection
        ("word", [(60, 60.0), (30, 1.0)], ""),  # its models took a minute to be read
        ("word", [(180, 3.0), (100, 5.0)], "needs audio without gaps"),
        ("sample", [(81, 9.0)], r"Only 0\.0 s of audio arrived in the last 27 s"),
        ("silence", [(180, 1.0)], ""),
        ("silence", [(182, 1.0)], "There was no sound for 3 minutes"),
    ],
)
def test_a_place_that_is_not_used_is_lost(microphone, clock, spoken, steps, sentence):
    word = sound(1.0, size=16_000)[0]
    block = {"word": word, "sample": b"\0\0", "silence": SECOND}[spoken]
    if spoken == "silence":
        put(microphone, clock, 100.0, SECOND, 1.0)
        put(microphone, clock, 1.0, word, 1.0)  # somebody is there
    if not sentence:
        for seconds, every_s in steps:
            put(microphone, clock, seconds, block, every_s)
        return
    with pytest.raises(RunError, match=sentence):
        for seconds, every_s in steps:
            put(microphone, clock, seconds, block, every_s)


def test_a_machine_that_cannot_keep_up_and_a_slow_system_are_told(
    weights, session, clock, monkeypatch
):
    for block in sound(9.5):
        clock.now += 0.25
        session.add_audio(decode_audio(block))
    with pytest.raises(RunError, match="too slow for 3 visitors at once"):
        session.process_input(num_sessions=3)
    monkeypatch.setattr(limits, "MAX_WINDOW_MS", 1e-6)
    slow = LiveSession(get_system(NAME, weights), OPTIONS, lambda _: None, clock)
    with pytest.raises(RunError, match=r"globaldiff/global needs .* ms per frame.*gan/5"):
        speak(slow, clock, 3.0)
    assert slow.windows == limits.TRIAL_WINDOWS + 1


def test_what_is_missing_of_what_was_spoken_is_said(session, clock):
    speak(session, clock, 3.0)
    minute = session.minute.recording()
    made_s = minute.motion.num_frames / 30
    assert missing_speech_note(minute, made_s + 1.9) == ""
    told = missing_speech_note(minute, made_s + 2.5)
    assert told.startswith("The saved run ends 2.5 s before the end of your speech")
    later = replace(minute, first_frame=45)
    assert missing_speech_note(later, made_s).startswith(
        f"Only the last {made_s:.0f} s are stored; the 1.5 s"
    )


def test_what_asks_for_nothing_is_refused(weights, told):
    good = {"system": "globaldiff/global", "speaker": "ann", "seed": 2**31 - 1}
    assert parse_live_options(good).seed == 2**31 - 1
    wrong = [{"system": ["gan/5"]}, *({"seed": seed} for seed in (None, -1, True, 1e300, 2**31))]
    for asked in (None, 3, [], {}, {"system": "gan/5"}, *(good | each for each in wrong)):
        with pytest.raises(RunError):
            parse_live_options(asked)
    with pytest.raises(UnknownNameError, match="no speaker 'eve'"):
        system = get_system(NAME, weights)
        LiveSession(system, replace(OPTIONS, speaker="eve"), told.append)


def test_sound_is_read_as_it_was_written_and_other_bytes_are_refused():
    samples = np.array([0, 16384, -32768, 32767], "<i2")
    np.testing.assert_array_equal(decode_audio(samples.tobytes()), samples / 32_768)
    assert len(decode_audio(bytes(MAX_SOUND_BYTES))) == 16_000
    too_much = bytes(MAX_SOUND_BYTES + 2)
    for content, words in ((b"", "damaged"), (b"abc", "damaged"), (too_much, "the limit is 32000")):
        with pytest.raises(RunError, match=words):
            decode_audio(content)


def test_frames_can_be_read_back_as_the_format_says():
    motion = smooth_motion_example(7)
    message = frames_message(120, motion, generation_ms=61.5, waited_ms=3.0, visitors=2)
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
    planning, told, clock
):
    made: list[tuple[int, int, dict]] = []
    step = planning._live.step

    def watched() -> Any:
        first = planning._live.next_frame
        motion = step()
        made.append(
            (first, planning._live.next_frame, planned_events_json(planning._live.ahead, first))
        )
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
    kept = planning.minute.recording()
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
    planning, session, clock
):
    planning.set_style({"manner": {"size_factor": 2.0, "smile_factor": 0}})
    speak(planning, clock, 1.0, 4800)
    assert planning._live._stream.style == LiveStyle(size_factor=2.0, smile_factor=0.0)
    wrong = (None, {"manner": {"size_factor": 99}}, {"manner": {"more": 1}}, {"manner": None}, [])
    leads: list[Callable[[], None]] = [lambda told=told: planning.set_style(told) for told in wrong]
    for lead in leads:
        with pytest.raises(RunError):
            lead()
    with pytest.raises(RunError, match="does not use gesture plans, so the style sliders have no"):
        session.set_style({"manner": {}})


@pytest.fixture(scope="module")
def motion():
    return smooth_motion_example(3000)


def spoken(motion, seconds: float, piece: int = 13) -> RecordingBuffer:
    """Sound whose samples count, a second ahead of frames that count."""
    minute = RecordingBuffer()
    sound = np.arange(round(16_000 * (seconds + 1)), dtype=np.float32)
    for first in range(0, len(sound), 640):
        minute.add_sound(sound[first : first + 640])
        known = min(int((first - 16_000) / 16_000 * 30), round(30 * seconds))
        while minute.frames + piece <= known:
            start = minute.frames
            minute.add_motion(motion.part(slice(start, start + piece)))
    return minute


@pytest.mark.parametrize("seconds", [5.0, 59.9, 61.3, 80.0])
def test_what_is_kept_is_the_last_minute_with_its_own_sound_and_little_more_is_held(
    motion, seconds
):
    minute = spoken(motion, seconds)
    end = minute.frames
    kept = minute.recording()
    first = max(0, end - MAX_RECORDED_FRAMES)
    assert kept.first_frame == first and kept.motion.num_frames == end - first
    np.testing.assert_array_equal(kept.motion.poses, motion.poses[first:end])
    start = round(first * 16_000 / 30)
    count = round((end - first) * 16_000 / 30)
    np.testing.assert_array_equal(kept.waveform, np.arange(start, start + count))
    moved = kept.motion.trans - motion.trans[first:end]
    np.testing.assert_allclose(moved - moved[:1], 0, atol=1e-6)
    assert (kept.motion.trans[0, [0, 2]] == 0).all() and abs(moved[0, 1]) == 0
    assert len(minute) < 16_000 * 63 + MAX_RECORDED_FRAMES + 13


def test_too_little_is_told(motion):
    minute = RecordingBuffer()
    minute.add_sound(np.zeros(64_000, np.float32))
    for count in (0, 59):
        if count:
            minute.add_motion(motion.part(slice(count)))
        with pytest.raises(RunError, match=r"no live motion to save yet\. Speak for at least 2 s"):
            minute.recording()
    minute.add_motion(motion.part(slice(59, 60)))
    assert minute.recording().motion.num_frames == 60


def ahead(origin: int, *right: HandPhase, **lists) -> StreamedPlan:
    return StreamedPlan(GesturePlan(6.0, right=right, **lists), origin, ())


def phases_of(plan: GesturePlan) -> list[tuple[str, float, float]]:
    return [(one.phase, round(one.start_s, 3), round(one.end_s, 3)) for one in plan.right]


def test_each_plan_takes_the_place_of_the_one_before_from_its_first_frame_on():
    rest, preparation = phase(3.0, 4.0, "rest"), phase(4.0, 4.6, "preparation")
    then = phase(2.0, 2.8, "rest"), phase(2.8, 3.2, "preparation"), phase(3.2, 4.0, "stroke")
    plans = [
        (0, ahead(-90, rest, preparation, nods=(Nod(4.0, 5.0),))),
        (9, ahead(-60, *then)),
    ]
    plan = merge_plans(plans, 0, 45)
    assert plan.duration_s == 1.5 and not plan.nods, "the nod was planned otherwise later"
    assert phases_of(plan) == [("rest", 0.0, 0.8), ("preparation", 0.8, 1.2), ("stroke", 1.2, 1.5)]
    plans.append((40, ahead(-30, phase(2.2, 2.9, "stroke"), blinks=(Blink(2.5),))))
    assert phases_of(merge_plans(plans, 0, 60))[2:] == [("stroke", 1.2, 1.9)]
    assert [one.time_s for one in merge_plans(plans, 30, 30).blinks] == [pytest.approx(0.5)]


def test_what_went_on_before_the_minute_begins_with_it():
    spans = {"looks": (Gaze(0.0, 4.0, 5.0, 0.0),), "stands": (Stance(1.0, 9.0, "left"),)}
    plans = [(0, ahead(0, phase(0.0, 2.0, "rest"), phase(2.0, 6.0, "hold"), **spans))]
    plan = merge_plans(plans, 30, 90)
    assert phases_of(plan) == [("rest", 0.0, 1.0), ("hold", 1.0, 3.0)]
    assert [(one.start_s, one.end_s) for one in plan.looks] == [(0.0, 3.0)]


class ByHand(LiveSessions):
    """Its process is the test."""

    def __init__(self, weights: Path) -> None:
        super().__init__(weights)
        self.performers = SessionScheduler(weights, self._hear)
        self._child: Any = self  # it is there

    def begin(self, cookie: str, tell: Callable[[object], None] | None = None, **more: Any) -> int:
        return self.open(TOLD, cookie, tell or nothing, **more)

    def _hear(self, number: int, told: object) -> None:
        self._callbacks.get(number, nothing)(told)

    def _send(self, number: int, verb: str, told: object = None) -> None:
        self.performers.handle_message(number, verb, told)


@pytest.fixture
def sessions(weights: Path) -> ByHand:
    return ByHand(weights)


def nothing(message: object) -> None:
    """Nobody listens."""


def put_all(sessions: LiveSessions, number: int, seconds: float) -> None:
    for block in sound(seconds):
        sessions.add_audio(number, block)


def test_everyone_gets_a_window_before_anyone_gets_a_second(sessions):
    turns: list[str] = []
    for name, seconds in (("a", 2.9), ("b", 2.9), ("c", 1.2)):

        def tell(message: object, name: str = name) -> None:
            if isinstance(message, bytes):
                turns.append(name)

        put_all(sessions, sessions.begin(name, tell), seconds)
    while sessions.performers.generate_next_window():
        pass
    assert turns[:3] == ["a", "b", "c"]
    assert set(turns[3:]) == {"a", "b"} and turns.count("a") == turns.count("b")


def test_places_are_bounded_in_all_and_for_each_address(sessions, monkeypatch, told):
    assert (module.MAX_SESSIONS, module.MAX_SESSIONS_PER_ADDRESS) == (10, 6)  # as the README has it
    monkeypatch.setattr(module, "MAX_SESSIONS", 4)
    monkeypatch.setattr(module, "MAX_SESSIONS_PER_ADDRESS", 2)
    first, _, _ = (sessions.begin("", told.append, address="10.0.0.1") for _ in range(3))
    assert "Your network address already has 2 live sessions" in told[-1]
    for k in range(2):
        sessions.begin(str(k), address=f"10.0.1.{k}")
    for cookie in ("fifth", ""):
        sessions.begin(cookie, told.append, address="10.0.2.1")
        assert "4 live sessions are already running on this server" in told.pop()
    sessions.close(first)
    sessions.begin("mine", address="10.0.0.1")
    sessions.begin("mine", address="10.0.0.1")  # in another tab: the first ends
    assert len(sessions.performers.open) == 4


def test_a_browser_has_one_session_and_no_other_browser_ends_it(sessions, told):
    for cookie in ("mine", "other", "", ""):
        sessions.begin(cookie, told.append if cookie == "mine" else None)
    assert module.TAKEN_OVER not in told and len(sessions.performers.open) == 4
    sessions.begin("mine")
    assert told[1:] == [module.TAKEN_OVER] and len(sessions.performers.open) == 4


def test_a_minute_is_kept_for_its_own_browser_and_for_a_while(
    sessions, monkeypatch, tmp_path, told
):
    number = sessions.begin("mine", told.append)
    token = told[0]["token"]
    with pytest.raises(RunError, match="Speak for at least"):
        sessions.save_last_minute(token, "mine", tmp_path)
    put_all(sessions, number, 2.9)
    sessions.performers.generate_next_window()
    sessions.performers.generate_next_window()
    kept = sessions.save_last_minute(token, "mine", tmp_path)
    assert kept.sampling == OPTIONS
    assert (
        kept.live_recording is not None and load_motion(kept.live_recording.motion).num_frames > 60
    )
    sessions.close(number)
    assert sessions.save_last_minute(token, "mine", tmp_path) == kept
    for other, cookie in ((token, "yours"), (token, ""), ("x", "mine"), ("ü", "")):
        with pytest.raises(RunError, match="no live recording"):
            sessions.save_last_minute(other, cookie, tmp_path)
    monkeypatch.setattr(module, "KEEP_S", -1.0)
    with pytest.raises(RunError, match="no live recording"):
        sessions.save_last_minute(token, "mine", tmp_path)
    assert not sessions.performers.ended and not sessions._callbacks


def test_a_fault_ends_its_own_session_only(sessions, monkeypatch, told):
    numbers = [sessions.begin("a", told.append), sessions.begin("b")]
    broken, whole = (sessions.performers.open[number] for number in numbers)
    monkeypatch.setattr(broken, "process_input", lambda num_sessions: 1 / 0)
    for number in numbers:
        put_all(sessions, number, 1.5)
    for _ in range(3):
        sessions.performers.generate_next_window()
    assert len(told) == 2 and "report it with this number" in str(told[1])
    assert whole.windows == 1 and list(sessions.performers.open) == numbers[1:]


def test_a_process_that_is_killed_is_told_and_the_next_who_speaks_has_another(weights):
    sessions = LiveSessions(weights)
    told: queue.SimpleQueue[Any] = queue.SimpleQueue()
    try:
        sessions.open(TOLD, "", told.put)
        assert told.get(timeout=60)["hop"] == 9
        killed = sessions._child
        assert killed is not None
        os.kill(killed.pid, signal.SIGKILL)
        assert "SIGKILL" in told.get(timeout=60)
        sessions.open(TOLD, "", told.put)
        assert sessions._child not in (None, killed)
    finally:
        sessions.end_process()
