"""Where a phase of a hand ends: the boundary between what a hand does and what it does next, moved.

What one phase gains the next loses, and neither becomes shorter than a hand needs for it. A way
back to rest keeps its length for as long as the rest after it gives way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from model.plan.editing import (
    LEAST_BACK_S,
    LEAST_BEAT_S,
    LEAST_MOVE_S,
    LEAST_REST_S,
    LEAST_STROKE_S,
    USUAL_RETRACTION_S,
    Edited,
    Gesture,
    gestures,
    partner_of,
    rest_goal,
)
from model.plan.kinds import TOGETHER_S, Stroke, strokes_of
from model.plan.plan import SIDES, GesturePlan, HandPhase, Phase, PlanError, Side
from model.plan.tracks import without_gaps

LEAST_HOLD_S = 0.1
LEAST_S: dict[Phase, float] = {
    "rest": LEAST_REST_S, "preparation": LEAST_MOVE_S, "stroke": LEAST_STROKE_S,
    "hold": LEAST_HOLD_S, "beat": LEAST_BEAT_S, "retraction": LEAST_BACK_S,
}  # fmt: skip
"""Shorter no phase is made; one that was shorter stays so."""
SAME_S = 0.01
"""To which a phase is found by its end."""
_TINY_S = 1e-6


def ended(plan: GesturePlan, side: Side, end_s: float, at_s: float) -> Edited:
    """The phase of a hand that ends at ``end_s`` ends at ``at_s``, or as near to that as can be.

    A hold for whose way back there is no time any more lasts until the next gesture. Where a hand
    leaves a gesture so much earlier that it can go back to rest before the next one, it does.

    Raises:
        PlanError: if no phase ends there, if it ends with the speech, or if it cannot end at any
            other time in that direction.
    """
    phases = list(without_gaps(plan.hand(side), plan.duration_s))
    k = _index(phases, end_s)
    if k is None:
        raise PlanError(f"The {side} hand does nothing that ends at {end_s:.2f} s.")
    if k == len(phases) - 1:
        raise PlanError(
            f"The {side} hand's {phases[k].phase} ends with the speech; an end before that can be "
            "moved."
        )
    one, then = phases[k], phases[k + 1]
    goes_back_s = LEAST_BACK_S + LEAST_REST_S
    if then.phase == "retraction":
        changed, why = _before_way_back(phases, k, at_s, plan.duration_s)
    elif (
        then.phase == "preparation"
        and one.phase in ("stroke", "hold", "beat")
        and then.start_s - max(at_s, one.start_s + _least(one)) >= goes_back_s
    ):
        to_s, why = _no_earlier(one, at_s)
        left_s = then.start_s - to_s
        back_s = to_s + min(USUAL_RETRACTION_S, left_s - LEAST_REST_S)
        goal = rest_goal(phases)
        back = HandPhase(to_s, back_s, "retraction", goal)
        rest = HandPhase(back_s, then.start_s, "rest", goal)
        changed = [*phases[:k], replace(one, end_s=to_s), back, rest, *phases[k + 1 :]]
    else:
        to_s, why = _no_earlier(one, at_s)
        latest_s = then.end_s - _least(then)
        if to_s > latest_s:
            to_s, why = latest_s, _needs(one, then, latest_s)
        changed = [*phases]
        changed[k], changed[k + 1] = replace(one, end_s=to_s), replace(then, start_s=to_s)
    if why and abs(changed[k].end_s - one.end_s) < SAME_S:
        raise PlanError(why)
    return Edited(plan.with_hand(side, tuple(changed)), (why,) if why else ())


def counterpart(plan: GesturePlan, side: Side, end_s: float) -> float | None:
    """When the phase ends that is the other hand's part in the phase of a hand that ends at
    ``end_s``; None where the hands do not make a gesture together, or end it apart."""
    filled = plan.with_hand(side, without_gaps(plan.hand(side), plan.duration_s))
    phases = filled.hand(side)
    k = _index(phases, end_s)
    own = None if k is None else _gesture_around(filled, side, k)
    if own is None or k is None:
        return None
    partner = partner_of(plan, Gesture(side, own.lands.end_s))
    if partner is None or partner not in gestures(plan, partner.side):
        return None
    other = SIDES[1 - SIDES.index(side)]
    filled = plan.with_hand(other, without_gaps(plan.hand(other), plan.duration_s))
    theirs = next(
        s for s in strokes_of(filled) if s.side == other and s.lands.end_s == partner.lands_s
    )
    near = [
        phase.end_s
        for phase in filled.hand(other)[theirs.first : theirs.last + 1]
        if phase.phase == phases[k].phase and abs(phase.end_s - end_s) < TOGETHER_S
    ]
    return min(near, key=lambda at: abs(at - end_s), default=None)


def _before_way_back(
    phases: Sequence[HandPhase], k: int, at_s: float, duration_s: float
) -> tuple[list[HandPhase], str]:
    """The phases with another end of the one before a way back, and what was mended."""
    one, back = phases[k], phases[k + 1]
    rest = phases[k + 2] if k + 2 < len(phases) and phases[k + 2].phase == "rest" else None
    until_s = back.end_s if rest is None else rest.end_s
    after = phases[k + 2 if rest is None else k + 3 :]
    to_s, why = _no_earlier(one, at_s)
    rested_s = until_s if rest is None else until_s - _least(rest)
    latest_s = rested_s - _least(back)
    if to_s > latest_s and one.phase == "hold":
        end = "the speech ends" if until_s > duration_s - SAME_S else "the next gesture begins"
        why = f"There is no time to go back to rest: the hold lasts until {end}, {until_s:.2f} s."
        return [*phases[:k], replace(one, end_s=until_s), *after], why
    if to_s > latest_s:
        to_s, why = latest_s, _needs(one, back, latest_s)
    if rest is None:
        tail = [replace(back, start_s=to_s)]
    else:
        back_s = min(to_s + back.end_s - back.start_s, rested_s)
        tail = [replace(back, start_s=to_s, end_s=back_s), replace(rest, start_s=back_s)]
    return [*phases[:k], replace(one, end_s=to_s), *tail, *after], why


def _no_earlier(one: HandPhase, at_s: float) -> tuple[float, str]:
    earliest_s = one.start_s + _least(one)
    if at_s >= earliest_s - _TINY_S:
        return at_s, ""
    why = f"The {one.phase} ends at {earliest_s:.2f} s: it lasts {_least(one):.2g} s at least."
    return earliest_s, why


def _needs(one: HandPhase, then: HandPhase, latest_s: float) -> str:
    return (
        f"The {one.phase} ends at {latest_s:.2f} s: the {then.phase} after it needs "
        f"{_least(then):.2g} s."
    )


def _least(phase: HandPhase) -> float:
    return min(LEAST_S[phase.phase], phase.end_s - phase.start_s)


def _index(phases: Sequence[HandPhase], end_s: float) -> int | None:
    near = min(range(len(phases)), key=lambda i: abs(phases[i].end_s - end_s), default=None)
    return near if near is not None and abs(phases[near].end_s - end_s) < SAME_S else None


def _gesture_around(plan: GesturePlan, side: Side, k: int) -> Stroke | None:
    own = (stroke for stroke in strokes_of(plan) if stroke.side == side)
    return next((stroke for stroke in own if stroke.first <= k <= stroke.last), None)
