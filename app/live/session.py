"""Live session of one visitor with its last minute; its messages are in `app.run.frame_packets`."""

from __future__ import annotations

import secrets
import statistics
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float32

from app.errors import RunError
from app.run.frame_packets import frames_message
from app.run.requests.parts import GenerationSpeech, LiveRecording, OutputOptions, SamplingOptions
from app.run.requests.requests import GenerateRequest
from conventions.rates import FPS, SAMPLE_RATE
from model.generation.base import System
from model.generation.live import LiveGenerator, Pace
from model.generation.windows import GenerateOptions
from model.motion.motion import Motion, concatenate, save_motion
from model.plan.files import write_plan_file
from model.plan.plan import SIDES, GesturePlan, PlanError, PointEvent, StreamedPlan
from model.plan.style import LiveStyle
from model.speech.audio import write_wav
from model.speech.features import StreamingMelEncoder

MIN_CUT_EVENT_S = 0.5 / FPS
"""Shortest remainder (s) of an event that is cut."""
PLAN_LISTS = ("left", "right", "nods", "looks", "brows", "smiles", "blinks", "stands", "planted")


def merge_plans(
    plans: Iterable[tuple[int, StreamedPlan]], first_frame: int, num_frames: int
) -> GesturePlan:
    """Return the plan of ``num_frames`` frames of a session; its second 0 is ``first_frame``.

    Each plan comes with the frame of the session from which it replaces all earlier ones.
    """
    events: dict[str, list[Any]] = {name: [] for name in PLAN_LISTS}
    for frame, ahead in plans:
        from_s, zero_s = frame / FPS, ahead.zero_frame / FPS
        for name in PLAN_LISTS:
            planned = [_shifted(one, zero_s) for one in getattr(ahead.condition, name)]
            new = [one for one in planned if one.end_s > from_s or one.start_s >= from_s]
            until_s = min([from_s, *(one.start_s for one in new)])
            events[name] = [*_cut(events[name], 0.0, until_s), *new]
    start_s, end_s = first_frame / FPS, (first_frame + num_frames) / FPS
    lists = {
        name: tuple(_shifted(one, -start_s) for one in _cut(of, start_s, end_s))
        for name, of in events.items()
    }
    return GesturePlan(num_frames / FPS, **lists)


def _shifted(event: Any, by_s: float) -> Any:
    if isinstance(event, PointEvent):
        return replace(event, time_s=event.time_s + by_s)
    return replace(event, start_s=event.start_s + by_s, end_s=event.end_s + by_s)


def _cut(events: list[Any], start_s: float, end_s: float) -> list[Any]:
    """Return events cut to the time between two seconds."""
    pieces = []
    for one in events:
        if isinstance(one, PointEvent):
            if start_s <= one.time_s < end_s:
                pieces.append(one)
            continue
        begins, ends = max(one.start_s, start_s), min(one.end_s, end_s)
        if ends - begins >= MIN_CUT_EVENT_S:
            pieces.append(replace(one, start_s=begins, end_s=ends))
    return pieces


MAX_RECORDED_FRAMES = 60 * FPS
SHORTEST_FRAMES = 2 * FPS
NOTHING_YET = "There is no live motion to save yet. Speak for at least {seconds} s, then try again."


@dataclass(frozen=True)
class SessionRecording:
    """Recording that is saved: sound and motion of the same length."""

    waveform: np.ndarray
    """Waveform (N,) float32, 16 kHz."""
    motion: Motion
    first_frame: int
    """Index of the first frame in the session."""
    plan: GesturePlan | None = None
    """Plan that the motion performs; None for a system without plans."""


class RecordingBuffer:
    """Buffer of sound and motion in pieces; drops those older than a minute."""

    def __init__(self) -> None:
        self.frames = 0
        """Number of motion frames of the session so far."""
        self._motion: deque[tuple[int, Motion, StreamedPlan | None]] = deque()
        """Pieces of motion, each with its first frame and its plan."""
        self._sound: deque[np.ndarray] = deque()
        self._forgotten = 0
        """Number of samples dropped from the start."""

    def __len__(self) -> int:
        """Return the number of samples and frames in the buffer."""
        return sum(map(len, self._sound)) + sum(each.num_frames for _, each, _ in self._motion)

    def add_sound(self, samples: Float32[np.ndarray, " N"]) -> None:
        self._sound.append(samples)

    def add_motion(self, motion: Motion, plan: StreamedPlan | None = None) -> None:
        """Append the next frames and the plan that they perform."""
        self._motion.append((self.frames, motion, plan))
        self.frames += motion.num_frames
        while len(self._motion) > 1 and self._motion[1][0] <= self._first_frame:
            self._motion.popleft()
        while self._forgotten + len(self._sound[0]) <= _sample_of(self._first_frame):
            self._forgotten += len(self._sound.popleft())

    @property
    def _first_frame(self) -> int:
        return max(0, self.frames - MAX_RECORDED_FRAMES)

    def recording(self) -> SessionRecording:
        """Return the last minute, or all of a shorter session; raises RunError if too little."""
        if self.frames < SHORTEST_FRAMES:
            raise RunError(NOTHING_YET.format(seconds=SHORTEST_FRAMES // FPS))
        first, count = self._first_frame, min(self.frames, MAX_RECORDED_FRAMES)
        motion = concatenate([each for _, each, _ in self._motion]).part(slice(-count, None))
        to_origin = motion.trans[:1] * np.array([1, 0, 1], np.float32)
        start = _sample_of(first) - self._forgotten
        plans = [(frame, ahead) for frame, _, ahead in self._motion if ahead is not None]
        return SessionRecording(
            np.concatenate(self._sound)[start : start + _sample_of(count)],
            replace(motion, trans=motion.trans - to_origin),
            first,
            merge_plans(plans, first, count) if plans else None,
        )


def _sample_of(frame: int) -> int:
    return round(frame * SAMPLE_RATE / FPS)


MAX_DELAY_S = 8.0
"""Delay (s) of motion behind speech after which the machine is too slow."""
MAX_WINDOW_MS = 400.0
"""Most CPU time (ms) of a window: with more, a body alone on a machine lags by more than 1.5 s."""
TRIAL_WINDOWS = 3
SAMPLING_STEPS_WITH_PLAN = 4
"""Sampling steps of systems that also plan: with six, half of them could not keep up."""
MessageCallback = Callable[[bytes | dict[str, Any]], None]

NORMAL_BACKLOG_S = 2.0
"""Speech (s) without motion yet while a body keeps up."""

EARLIER = "Only the last {kept:.0f} s are stored; the {first:.1f} s before them were discarded."
BEHIND = (
    "The saved run ends {behind:.1f} s before the end of your speech: the server was too slow to "
    "generate the motion in time."
)
TOO_SLOW = (
    "This server is too slow for {visitors}: the motion is {behind:.0f} s late. Try again later, "
    "or choose a system with fewer sampling steps."
)
SLOW_SYSTEM = (
    "{system} needs {ms:.1f} ms per frame on this server; live motion allows at most {limit:.1f} "
    "ms. Choose a system with fewer sampling steps, such as gan/5."
)


class LiveSession:
    """Live session of one body that follows the speech; used from one thread."""

    def __init__(
        self,
        system: System,
        sampling: SamplingOptions,
        tell: MessageCallback,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make a session and its generator.

        Args:
            tell: callback that takes frames as bytes and other messages as an object.

        Raises:
            RunError, UnknownNameError: if the system cannot be used live with that speaker.
        """
        check_supports_live(system)
        self.sampling, self.pace, self.name = sampling, Pace(), system.name
        self.minute = RecordingBuffer()
        self._tell, self._clock = tell, clock
        self._frames_of_window = system.windowing.frames
        self._features = StreamingMelEncoder()
        self.plans = system.condition_type is GesturePlan
        """True if the system performs plans, so that the style sliders have an effect."""
        steps = SAMPLING_STEPS_WITH_PLAN if self.plans else None
        options = GenerateOptions(sampling.speaker or "", seed=sampling.seed, steps=steps)
        self._live = LiveGenerator(system, options, self.pace)
        self._manner: LiveStyle | None = None
        """Slider values to apply at the next window; None if they have not been moved."""
        self._inbox: list[np.ndarray] = []
        self._samples = 0
        self._due_since = 0.0
        self._costs: deque[float] = deque(maxlen=64)
        self.windows = 0
        self.cookie = self.address = ""
        """Visitor's cookie and address; empty if there is none or it is not known."""
        self.token = secrets.token_urlsafe(32)
        self.ended_at = 0.0

    def ready_message(self) -> dict[str, Any]:
        """Return the settings that a browser needs before it sends sound."""
        return {"hop": self.pace.min_hop, "ahead": self.pace.look_ahead, "plans": self.plans}

    def add_audio(self, samples: Float32[np.ndarray, " N"]) -> None:
        """Append the next samples to the input."""
        self._samples += len(samples)
        self._inbox.append(samples)
        self.minute.add_sound(samples)

    def set_style(self, message: Any) -> None:
        """Set the sliders from the next window on; raises RunError if invalid or without plans."""
        if not self.plans:
            raise RunError(
                f"{self.name} does not use gesture plans, so the style sliders have no effect on "
                "it."
            )
        self._manner = parse_live_style(message)

    @property
    def has_work(self) -> bool:
        """True if there is new sound, or enough of it for a window: input for `process_input`."""
        return bool(self._inbox) or self._live.is_due

    def process_input(self, num_sessions: int = 1) -> None:
        """Compute features of new sound, and generate one window if it is due.

        Raises RunError if the system or the machine is too slow.
        """
        sound, self._inbox = self._inbox, []
        if sound:
            was_due = self._live.is_due
            self._live.add_features(
                torch.from_numpy(self._features.add_samples(np.concatenate(sound)))
            )
            if not was_due:
                self._due_since = self._clock()
        if not self._live.is_due:
            return
        behind_s = self._live.num_generatable_frames / FPS
        if behind_s > MAX_DELAY_S:
            who = "one visitor" if num_sessions == 1 else f"{num_sessions} visitors at once"
            raise RunError(TOO_SLOW.format(visitors=who, behind=behind_s))
        manner, self._manner = self._manner, None
        if manner is not None:
            self._live.set_style(manner)
        first, began, used = self._live.next_frame, self._clock(), time.thread_time()
        (motion,) = self._live.step()
        made_ms = 1000 * (self._clock() - began)
        waited_ms = 1000 * (began - self._due_since)
        self._due_since = self._clock()
        self.windows += 1
        self._costs.append(1000 * (time.thread_time() - used))
        self.minute.add_motion(motion, self._live.ahead)
        self._tell(
            frames_message(
                first, motion, generation_ms=made_ms, waited_ms=waited_ms, visitors=num_sessions
            )
        )
        if self._live.ahead is not None:
            self._tell({"plan": planned_events_json(self._live.ahead, first)})
        self._check_cost()

    @property
    def median_window_cpu_ms(self) -> float:
        """Median CPU time of a window (ms); NaN before the first."""
        return statistics.median(self._costs) if self._costs else float("nan")

    def save_last_minute(self, folder: Path) -> GenerateRequest:
        """Write the last minute to a folder; return its request; raises RunError if too little."""
        minute = self.minute.recording()
        wav, npz, plan = (folder / f"live.{ending}" for ending in ("wav", "npz", "plan.json"))
        write_wav(wav, minute.waveform)
        save_motion(minute.motion, npz)
        if minute.plan is not None:
            write_plan_file(minute.plan, plan)
        facts = {
            "first_frame_of_session": minute.first_frame,
            "least_new_frames_a_window": self.pace.min_hop,
            "frames_heard_ahead": self.pace.look_ahead,
            "speech_level": "running",
            "windows_of_session": self.windows,
            "window_cpu_ms": round(self.median_window_cpu_ms, 1),
        }
        why = missing_speech_note(minute, self._samples / SAMPLE_RATE)
        take = LiveRecording(npz, facts, why, plan if minute.plan else None)
        return GenerateRequest(
            speech=GenerationSpeech(path=wav),
            sampling=self.sampling,
            output=OutputOptions(out=folder / "results"),
            live_recording=take,
        )

    def _check_cost(self) -> None:
        if self.windows != TRIAL_WINDOWS + 1:  # the first window also loads libraries
            return
        cost = min([*self._costs][1:])
        if cost > MAX_WINDOW_MS:
            frame_ms, limit = cost / self._frames_of_window, MAX_WINDOW_MS / 60
            raise RunError(SLOW_SYSTEM.format(system=self.name, ms=frame_ms, limit=limit))


def missing_speech_note(recording: SessionRecording, spoken_s: float) -> str:
    """Explain why less is saved than the ``spoken_s`` of speech; empty if nothing is missing."""
    saved_s = recording.motion.num_frames / FPS
    made_s = recording.first_frame / FPS + saved_s
    reasons = []
    if recording.first_frame:
        reasons.append(EARLIER.format(kept=saved_s, first=made_s - saved_s))
    if spoken_s - made_s > NORMAL_BACKLOG_S:
        reasons.append(BEHIND.format(behind=spoken_s - made_s))
    return " ".join(reasons)


def check_supports_live(system: System) -> None:
    """Check that the encoder does not need the whole speech in advance; raises RunError."""
    if system.encoder.name != "mel64":
        raise RunError(
            f"{system.name} uses the speech encoder {system.encoder.name}, which needs the whole "
            "recording. Choose another system."
        )


def warm_up(system: System, speaker: str) -> None:
    """Generate a first window from silence; raises UnknownNameError for an unknown speaker."""
    live = LiveGenerator(system, GenerateOptions(speaker))
    live.add_features(
        torch.from_numpy(StreamingMelEncoder().add_samples(np.zeros(SAMPLE_RATE, np.float32)))
    )
    live.step()


def planned_events_json(streamed: StreamedPlan, first_frame: int) -> dict[str, Any]:
    """Return the JSON of planned events from a frame on, in seconds of the session.

    They replace all events sent earlier for that time; one that continues there is included.
    """
    plan, zero_s, from_s = streamed.condition, streamed.zero_frame / FPS, first_frame / FPS

    def span(event: Any) -> list[float]:
        return [round(event.start_s + zero_s, 3), round(event.end_s + zero_s, 3)]

    def later(events: Any) -> list[Any]:
        return [event for event in events if event.end_s + zero_s > from_s]

    hands = {
        side: [[*span(phase), phase.phase, phase.kind] for phase in later(plan.hand(side))]
        for side in SIDES
    }
    nods = [round(nod.time_s + zero_s, 3) for nod in plan.nods if nod.time_s + zero_s >= from_s]
    looks = [[*span(look), look.yaw_deg, look.pitch_deg] for look in later(plan.looks)]
    return {"from": round(from_s, 3), **hands, "nods": nods, "looks": looks}


def parse_live_style(message: Any) -> LiveStyle:
    """Parse the style sliders of a browser's message; raises RunError if they are invalid."""
    sliders = message.get("manner") if isinstance(message, dict) else None
    try:
        return LiveStyle.parse(sliders)
    except PlanError as error:
        raise RunError(str(error)) from None
