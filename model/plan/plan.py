"""Gesture plan of a motion: a typed object that can be written, read, edited and used as input.

Times are seconds from the start of the speech. A hand's phases are Kendon's (1980), as in
annotation tiers, and `beat`: a small up-and-down movement after the stroke (McNeill's superimposed
beat), not a gesture type. Goals are the wrist's position at a phase's end, in metres from the chest
joint in the chest's frame: out to the hand's side, up, forward.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field

Side = Literal["left", "right"]
SIDES: tuple[Side, ...] = get_args(Side)
Phase = Literal["rest", "preparation", "stroke", "hold", "beat", "retraction"]
PHASES: tuple[Phase, ...] = get_args(Phase)
Leg = Literal["left", "right", "both"]
FORMAT = 1
MAX_EVENTS = 200_000
"""Largest number of events of one kind; hours of speech have fewer."""
STILL_PHASES: tuple[str, ...] = ("rest", "hold")
MAX_SECONDS = 24 * 3600.0
MAX_NUMBER = 1e6
"""Largest absolute value of all numbers but times, to avoid overflow."""
HANGING_PLACE = (0.2, -0.42, 0.12)
"""Position of a hand without a plan (m)."""
GAP_S = 0.01
"""Longest time between two phases of a hand that is no gap (s)."""
MAX_GOAL_COORDINATE_M = 1.0
"""Largest absolute coordinate of a goal in the chest's frame (m)."""


ShortText = Annotated[str, Field(max_length=80)]


class PlanError(ValueError):
    """A plan that cannot be used; the message is one sentence for the user."""


class _FromJson:
    """Base of classes with strict validation from JSON: no other fields, no texts for numbers."""

    __pydantic_config__: ClassVar[Any] = {
        "strict": True, "extra": "forbid", "allow_inf_nan": False,
    }  # fmt: skip


@dataclass(frozen=True)
class SpanEvent(_FromJson):
    """An event with a duration."""

    start_s: float
    end_s: float


@dataclass(frozen=True)
class PointEvent(_FromJson):
    """An event at a point in time."""

    time_s: float

    @property
    def start_s(self) -> float:
        return self.time_s

    @property
    def end_s(self) -> float:
        return self.time_s


@dataclass(frozen=True)
class HandPhase(SpanEvent):
    """One phase of a hand's movement."""

    phase: Phase
    goal: tuple[float, float, float]
    """Position of the wrist at the end (out, up, forward) in metres; a hold may drift a little."""
    kind: ShortText = ""
    """Name of the gesture form, one of `model.plan.kinds.USUAL_STROKE_GOALS`; empty at rest."""
    word: ShortText = ""
    """Word during which a stroke ends; no lexical affiliate."""


@dataclass(frozen=True)
class Nod(PointEvent):
    """A nod of the head: down to its lowest point, and up again."""

    depth_deg: float


@dataclass(frozen=True)
class Gaze(SpanEvent):
    """Direction of the eyes and the head."""

    yaw_deg: float
    """Angle to the body's left (degrees); 0 is the listener."""
    pitch_deg: float
    """Angle downwards (degrees)."""


@dataclass(frozen=True)
class Brow(PointEvent):
    """A movement of the brows, up or to a frown."""

    height: float
    """Height, 0 to 1; a frown is below 0."""


@dataclass(frozen=True)
class Smile(SpanEvent):
    """A smile of constant size."""

    size: float
    """Size, 0 to 1."""


@dataclass(frozen=True)
class Blink(PointEvent):
    """A blink of both eyes."""


@dataclass(frozen=True)
class Stance(SpanEvent):
    """Stance: the leg that carries the body's weight."""

    leg: Leg


@dataclass(frozen=True)
class FootContact(SpanEvent):
    """A foot that does not move."""

    foot: Side


@dataclass(frozen=True)
class GesturePlan(_FromJson):
    """All planned events of a motion, each list in order of time."""

    duration_s: float
    left: tuple[HandPhase, ...] = ()
    right: tuple[HandPhase, ...] = ()
    nods: tuple[Nod, ...] = ()
    looks: tuple[Gaze, ...] = ()
    """Gaze events."""
    brows: tuple[Brow, ...] = ()
    smiles: tuple[Smile, ...] = ()
    blinks: tuple[Blink, ...] = ()
    stands: tuple[Stance, ...] = ()
    """Intervals by the leg that bears the weight."""
    planted: tuple[FootContact, ...] = ()
    """Intervals of foot contact."""

    def __post_init__(self) -> None:
        """Check order and overlaps of events, and the arm's reach; raises PlanError."""
        if not 0 < self.duration_s <= MAX_SECONDS:
            raise PlanError(
                f"The plan lasts {self.duration_s:g} s; it must be longer than 0 s and at most "
                f"{MAX_SECONDS / 3600:g} hours."
            )
        for name, events in self._lists():
            if len(events) > MAX_EVENTS:
                raise PlanError(
                    f"The plan has {len(events)} events in `{name}`; the limit is {MAX_EVENTS}."
                )
            for event in events:
                _check(name, event)
        for side in SIDES:
            _check_in_turn(side, self.hand(side))

    def hand(self, side: Side) -> tuple[HandPhase, ...]:
        """Return the phases of one hand."""
        return self.left if side == "left" else self.right

    def with_hand(self, side: Side, phases: tuple[HandPhase, ...]) -> GesturePlan:
        """Return the plan with other phases of one hand."""
        return replace(self, left=phases) if side == "left" else replace(self, right=phases)

    def at_speed(self, speed: float) -> GesturePlan:
        """Return the plan ``speed`` times as fast."""

        def faster(event: Any) -> Any:
            times = {
                f.name: getattr(event, f.name) / speed
                for f in dataclasses.fields(event)
                if f.name.endswith("_s")
            }
            return replace(event, **times)

        lists = {name: tuple(map(faster, events)) for name, events in self._lists()}
        return replace(self, duration_s=self.duration_s / speed, **lists)

    def until(self, end_s: float) -> GesturePlan:
        """Return the plan up to ``end_s``; events that last longer are cut there."""

        def truncate(events: Sequence[Any]) -> tuple[Any, ...]:
            return tuple(
                replace(event, end_s=end_s)
                if isinstance(event, SpanEvent) and event.end_s > end_s
                else event
                for event in events
                if event.start_s < end_s
            )

        lists = {name: truncate(events) for name, events in self._lists()}
        return replace(self, duration_s=end_s, **lists)

    def as_json(self) -> str:
        """Format the plan as the content of a `.json` file."""
        text = json.dumps({"format": FORMAT, **dataclasses.asdict(self)})
        rounded = json.loads(text, parse_float=lambda number: round(float(number), 4))
        return json.dumps(rounded, indent=1) + "\n"

    def _lists(self) -> Iterator[tuple[str, tuple[Any, ...]]]:
        for each in dataclasses.fields(self):
            if each.name != "duration_s":
                yield each.name, getattr(self, each.name)


@dataclass(frozen=True)
class StreamedPlan:
    """A plan around some frames of live speech."""

    condition: GesturePlan
    """Plan with second 0 at the frame ``zero_frame``; earlier events have negative times."""
    zero_frame: int
    foot_contacts_from_start: tuple[FootContact, ...]
    """Foot contacts in seconds from frame 0, unlike those in `condition`."""


def fill_gaps(phases: Sequence[HandPhase], end_s: float) -> tuple[HandPhase, ...]:
    """Return a hand's phases with gaps filled by holds, or by rests after retractions."""
    filled: list[HandPhase] = []
    at_s, goal, kind = 0.0, phases[0].goal if phases else HANGING_PLACE, ""
    still: Phase = "rest"
    for phase in phases:
        if phase.start_s - at_s > GAP_S:
            filled.append(HandPhase(at_s, phase.start_s, still, goal, kind))
        filled.append(phase)
        at_s, goal = phase.end_s, phase.goal
        rests = phase.phase in ("rest", "retraction")
        still, kind = ("rest", "") if rests else ("hold", phase.kind)
    if end_s - at_s > GAP_S:
        filled.append(HandPhase(at_s, end_s, still, goal, kind))
    return tuple(filled)


@dataclass(frozen=True)
class PlanResult:
    """A plan that was read or changed, with notes for the user, such as corrections."""

    plan: GesturePlan
    notes: tuple[str, ...] = ()

    def then(self, change: Callable[[GesturePlan], PlanResult]) -> PlanResult:
        """Apply a further change and combine the notes, each sentence once."""
        done = change(self.plan)
        return PlanResult(done.plan, tuple(dict.fromkeys((*self.notes, *done.notes))))


def _check(name: str, event: Any) -> None:
    numbers = {f.name: getattr(event, f.name) for f in dataclasses.fields(event)}
    if not all(math.isfinite(n) for n in numbers.values() if isinstance(n, float)):
        raise PlanError(f"An event in `{name}` has a number that is not finite.")
    for field_name, number in numbers.items():
        limit = MAX_SECONDS if field_name.endswith("_s") else MAX_NUMBER
        if isinstance(number, int | float) and abs(number) > limit:
            raise PlanError(
                f"An event in `{name}` has {field_name} {number:g}; the limit is {limit:g}."
            )
    if "goal" in numbers and not all(abs(n) <= MAX_GOAL_COORDINATE_M for n in numbers["goal"]):
        raise PlanError(
            f"An event in `{name}` has a goal (wrist position) over {MAX_GOAL_COORDINATE_M:g} m "
            "from the chest."
        )
    if isinstance(event, SpanEvent) and not event.start_s < event.end_s:
        raise PlanError(
            f"An event in `{name}` goes from {event.start_s:g} to {event.end_s:g} s; it must end "
            "after it begins."
        )


def _check_in_turn(side: Side, phases: tuple[HandPhase, ...]) -> None:
    for before, after in pairwise(phases):
        if after.start_s < before.end_s - 1e-3:
            raise PlanError(
                f"The {side} hand begins a {after.phase} at {after.start_s:.2f} s, in the middle "
                f"of a {before.phase}; phases of one hand must not overlap."
            )
