"""What a browser is told of the plan of a live session, and what it tells of the sliders."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from app.errors import RunError
from conventions.rates import FPS

if TYPE_CHECKING:
    from model.plan.plan import PlannedAhead
    from model.plan.style import Manner


def told_plan(ahead: PlannedAhead, first: int) -> dict[str, Any]:
    """Events of the plan from a frame of the session on, in its seconds; they take the place of all
    that was told from there on.

    Args:
        first: the frame; what goes on there is told, too.
    """
    from model.plan.plan import SIDES

    plan, zero_s, from_s = ahead.condition, ahead.origin / FPS, first / FPS

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


def manner_of(told: Any) -> Manner:
    """What the sliders say.

    Raises:
        RunError: if it is anything else.
    """
    from model.plan.plan import PlanError
    from model.plan.style import Manner

    sliders = told.get("manner") if isinstance(told, dict) else None
    try:
        return Manner.of(sliders)
    except PlanError as error:
        raise RunError(str(error)) from None
