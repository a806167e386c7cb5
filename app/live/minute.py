"""The last minute of a live session: its sound, its motion and its plan, frame beside frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from app.errors import RunError
from conventions.rates import FPS, SAMPLE_RATE
from model.motion.motion import Motion, put_together
from model.plan.plan import GesturePlan, PlannedAhead

SHORTEST_S = 0.5 / FPS
"""What is left of a cut event, at the least."""
LISTS = ("left", "right", "nods", "looks", "brows", "smiles", "blinks", "stands", "planted")


class LastPlan:
    """Each plan takes the place of all that was planned from its first frame on. Times are seconds
    of the session."""

    def __init__(self) -> None:
        self._events: dict[str, list[Any]] = {name: [] for name in LISTS}

    def go_on(self, ahead: PlannedAhead, first: int) -> None:
        """Motion is performed by this plan from a frame of the session on."""
        from_s, zero_s = first / FPS, ahead.origin / FPS
        for name in LISTS:
            planned = [_shifted(one, zero_s) for one in getattr(ahead.condition, name)]
            new = [one for one in planned if _end(one) > from_s or _start(one) >= from_s]
            until_s = min([from_s, *map(_start, new)])
            self._events[name] = [*_cut(self._events[name], 0.0, until_s), *new]

    def forget_before(self, frame: int) -> None:
        for name, events in self._events.items():
            self._events[name] = [one for one in events if _end(one) > frame / FPS]

    def part(self, first: int, count: int) -> GesturePlan:
        """The plan of some frames of the session, the first of which is its second 0."""
        start_s, end_s = first / FPS, (first + count) / FPS
        lists = {
            name: tuple(_shifted(one, -start_s) for one in _cut(events, start_s, end_s))
            for name, events in self._events.items()
        }
        return GesturePlan(count / FPS, **lists)


def _start(event: Any) -> float:
    return event.start_s if hasattr(event, "start_s") else event.time_s


def _end(event: Any) -> float:
    return event.end_s if hasattr(event, "end_s") else event.time_s


def _shifted(event: Any, by_s: float) -> Any:
    if hasattr(event, "time_s"):
        return replace(event, time_s=event.time_s + by_s)
    return replace(event, start_s=event.start_s + by_s, end_s=event.end_s + by_s)


def _cut(events: list[Any], start_s: float, end_s: float) -> list[Any]:
    """What of events lies between two moments."""
    found = []
    for one in events:
        if hasattr(one, "time_s"):
            if start_s <= one.time_s < end_s:
                found.append(one)
            continue
        begins, ends = max(one.start_s, start_s), min(one.end_s, end_s)
        if ends - begins >= SHORTEST_S:
            found.append(replace(one, start_s=begins, end_s=ends))
    return found


KEPT_FRAMES = 60 * FPS
SHORTEST_FRAMES = 2 * FPS
NOTHING_YET = (
    "There is no live motion to keep yet: speak for at least {seconds} s, then press again."
)


@dataclass(frozen=True)
class Minute:
    """What is kept: sound and motion of the same length."""

    waveform: np.ndarray
    """(N,) float32, 16 kHz."""
    motion: Motion
    first_frame: int
    """Of the session."""
    plan: GesturePlan | None = None
    """That the motion performs; None of a system that performs none."""


class LastMinute:
    """Forgets what is older than a minute, sound, motion and plan alike."""

    def __init__(self) -> None:
        self._sound: list[np.ndarray] = []
        self._motion: Motion | None = None
        self._first_frame = self._next_frame = 0
        self._plan: LastPlan | None = None

    def add_sound(self, samples: np.ndarray) -> None:
        self._sound.append(samples)

    def add_motion(self, motion: Motion, ahead: PlannedAhead | None = None) -> None:
        """The next frames, and the plan that they perform."""
        if ahead is not None:
            self._plan = self._plan or LastPlan()
            self._plan.go_on(ahead, self._next_frame)
        whole = motion if self._motion is None else put_together([self._motion, motion])
        self._motion = whole.part(slice(-KEPT_FRAMES, None))
        self._next_frame += motion.num_frames
        before = _sample_of(self._first_frame)
        self._first_frame = self._next_frame - self._motion.num_frames
        self._sound = [np.concatenate(self._sound)[_sample_of(self._first_frame) - before :]]
        if self._plan is not None:
            self._plan.forget_before(self._first_frame)

    def kept(self) -> Minute:
        """The last minute, or all there is of it.

        Raises:
            RunError: if that is too little.
        """
        motion, first = self._motion, self._first_frame
        if motion is None or motion.num_frames < SHORTEST_FRAMES:
            raise RunError(NOTHING_YET.format(seconds=SHORTEST_FRAMES // FPS))
        count = motion.num_frames
        here = replace(
            motion, trans=motion.trans - motion.trans[:1] * np.array([1, 0, 1], np.float32)
        )
        sound = np.concatenate(self._sound)[: _sample_of(count)]
        plan = None if self._plan is None else self._plan.part(first, count)
        return Minute(sound, here, first, plan)


def _sample_of(frame: int) -> int:
    return round(frame * SAMPLE_RATE / FPS)
