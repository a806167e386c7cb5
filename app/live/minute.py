"""The last minute of a live session: its sound, its motion and its plan, frame beside frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
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


def performed(plans: Iterable[tuple[int, PlannedAhead]], first: int, count: int) -> GesturePlan:
    """The plan of some frames of a session, the first of which is its second 0. Each takes the
    place of all that was planned before from the frame of the session on that stands beside it."""
    events: dict[str, list[Any]] = {name: [] for name in LISTS}
    for frame, ahead in plans:
        from_s, zero_s = frame / FPS, ahead.origin / FPS
        for name in LISTS:
            planned = [_shifted(one, zero_s) for one in getattr(ahead.condition, name)]
            new = [one for one in planned if _end(one) > from_s or _start(one) >= from_s]
            until_s = min([from_s, *map(_start, new)])
            events[name] = [*_cut(events[name], 0.0, until_s), *new]
    start_s, end_s = first / FPS, (first + count) / FPS
    lists = {
        name: tuple(_shifted(one, -start_s) for one in _cut(of, start_s, end_s))
        for name, of in events.items()
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
    """Pieces of sound and motion as they came; forgets those that are older than a minute."""

    def __init__(self) -> None:
        self.frames = 0
        """Of the session, so far."""
        self._motion: deque[tuple[int, Motion, PlannedAhead | None]] = deque()
        """Each with its first frame, and the plan that it performs."""
        self._sound: deque[np.ndarray] = deque()
        self._forgotten = 0
        """Samples."""

    def __len__(self) -> int:
        """How many samples and frames are held."""
        return sum(map(len, self._sound)) + sum(each.num_frames for _, each, _ in self._motion)

    def add_sound(self, samples: np.ndarray) -> None:
        self._sound.append(samples)

    def add_motion(self, motion: Motion, ahead: PlannedAhead | None = None) -> None:
        """The next frames, and the plan that they perform."""
        self._motion.append((self.frames, motion, ahead))
        self.frames += motion.num_frames
        while len(self._motion) > 1 and self._motion[1][0] <= self._first_frame:
            self._motion.popleft()
        while self._forgotten + len(self._sound[0]) <= _sample_of(self._first_frame):
            self._forgotten += len(self._sound.popleft())

    @property
    def _first_frame(self) -> int:
        return max(0, self.frames - KEPT_FRAMES)

    def kept(self) -> Minute:
        """The last minute, or all there is of it.

        Raises:
            RunError: if that is too little.
        """
        if self.frames < SHORTEST_FRAMES:
            raise RunError(NOTHING_YET.format(seconds=SHORTEST_FRAMES // FPS))
        first, count = self._first_frame, min(self.frames, KEPT_FRAMES)
        motion = put_together([each for _, each, _ in self._motion]).part(slice(-count, None))
        to_origin = motion.trans[:1] * np.array([1, 0, 1], np.float32)
        start = _sample_of(first) - self._forgotten
        plans = [(frame, ahead) for frame, _, ahead in self._motion if ahead is not None]
        return Minute(
            np.concatenate(self._sound)[start : start + _sample_of(count)],
            replace(motion, trans=motion.trans - to_origin),
            first,
            performed(plans, first, count) if plans else None,
        )


def _sample_of(frame: int) -> int:
    return round(frame * SAMPLE_RATE / FPS)
