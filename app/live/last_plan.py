"""What the body of a live session was planned to do, put together of the plans made on the way."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from conventions.rates import FPS

if TYPE_CHECKING:
    from model.generation.base import PlannedAhead
    from model.plan.plan import GesturePlan

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
            planned = [_shifted(one, zero_s) for one in getattr(ahead.plan, name)]
            new = [one for one in planned if _end(one) > from_s or _start(one) >= from_s]
            until_s = min([from_s, *map(_start, new)])
            self._events[name] = [*_cut(self._events[name], 0.0, until_s), *new]

    def forget_before(self, frame: int) -> None:
        for name, events in self._events.items():
            self._events[name] = [one for one in events if _end(one) > frame / FPS]

    def part(self, first: int, count: int) -> GesturePlan:
        """The plan of some frames of the session, the first of which is its second 0."""
        from model.plan.plan import GesturePlan

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
