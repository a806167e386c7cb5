"""Changes of a plan: each takes a plan and gives another, or says in a sentence why it cannot.

A hand's phases follow one another without a gap, from the start to the end: what one gains its
neighbours lose, and no phase is squeezed below what a hand needs for it. A gesture is its
preparation, its strokes, and the holds and beats after them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from model.plan.kinds import TOGETHER_S, Spoken, Stroke, strokes_of
from model.plan.palette import (
    BY_BOTH,
    PLACES,
    REST_PLACE,
    Place,
    ready_for,
    usual_place,
)
from model.plan.plan import (
    SIDES,
    Blink,
    Brow,
    GesturePlan,
    HandPhase,
    Look,
    Nod,
    PlanError,
    Side,
    Smile,
    Stand,
)
from model.plan.tracks import without_gaps

LEAST_STROKE_S = 0.2
LEAST_MOVE_S = 0.2
"""Of preparations and retractions."""
LEAST_BEAT_S = 0.1
USUAL_STROKE_S, USUAL_PREPARATION_S, USUAL_HOLD_S, USUAL_RETRACTION_S = 0.31, 0.49, 0.3, 0.8
LANDS_AT = 0.3
"""Of a word's length, where a stroke on it ends."""
LEAST_BACK_S, LEAST_REST_S = 0.5, 0.2
"""A hand goes back to rest only where it has so long for it, and may rest a moment."""
ARM_M = 0.72
"""Wrists reach no farther from the chest."""
BODY_WIDTH_M, BODY_DEPTH_M, LEAST_UP_M, MOST_UP_M = 0.16, 0.14, -0.5, 0.12
"""The part of the chest's frame that the body fills: so wide to either side, so far forward."""
_TINY_S = 1e-6
Hands = Literal["left", "right", "both"]


@dataclass(frozen=True)
class Gesture:
    """Which gesture is meant: the one of a hand whose last stroke ends at some time."""

    side: Side
    lands_s: float


@dataclass(frozen=True)
class Edited:
    """A changed plan, and what was mended so that it could be performed."""

    plan: GesturePlan
    notes: tuple[str, ...] = ()


def gestures(plan: GesturePlan, side: Side) -> tuple[Gesture, ...]:
    """The gestures of a hand, in time."""
    return tuple(Gesture(side, s.lands.end_s) for s in strokes_of(plan) if s.side == side)


def on_word(word: Spoken) -> float:
    """Where a stroke on a word ends."""
    return word.start_s + LANDS_AT * (word.end_s - word.start_s)


def moved(plan: GesturePlan, gesture: Gesture, lands_s: float, word: str | None = None) -> Edited:
    """The gesture at another time: its last stroke ends at ``lands_s``.

    Args:
        word: what it lands on now; None leaves what is told.

    Raises:
        PlanError: if there is no such gesture, or no time for it there.
    """
    phases, block = _taken_out(plan, gesture)
    if word is not None:
        block = [replace(one, word=word if one.phase == "stroke" else "") for one in block]
    return _laid(plan, gesture.side, phases, _shifted(block, lands_s - gesture.lands_s), lands_s)


def deleted(plan: GesturePlan, gesture: Gesture) -> Edited:
    """The plan without a gesture: the hand stays as it was before it.

    Raises:
        PlanError: if there is no such gesture.
    """
    phases, _ = _taken_out(plan, gesture)
    return Edited(plan.with_hand(gesture.side, tuple(phases)))


def added(
    plan: GesturePlan, kind: str, lands_s: float, hands: Hands | None = None, word: str = ""
) -> Edited:
    """The plan with a gesture of the palette whose stroke ends at ``lands_s``.

    Args:
        hands: None is both where both make it, or else the right.

    Raises:
        PlanError: if the palette has no such kind, or the hand has no time for it there.
    """
    if kind not in PLACES:
        raise PlanError(f"There is no gesture {kind[:40]!r}; choose one of {', '.join(PLACES)}.")
    hands = hands or ("both" if kind in BY_BOTH else "right")
    goal = usual_place(kind)
    strikes_s = lands_s - USUAL_STROKE_S
    block = [
        HandPhase(strikes_s - USUAL_PREPARATION_S, strikes_s, "preparation", ready_for(goal), kind),
        HandPhase(strikes_s, lands_s, "stroke", goal, kind, word),
        HandPhase(lands_s, lands_s + USUAL_HOLD_S, "hold", goal, kind),
    ]
    return _on_hands(plan, _sides(hands), block, lands_s)


def with_hands(plan: GesturePlan, gesture: Gesture, hands: Hands) -> Edited:
    """The gesture made by other hands, and no more by those that made it.

    Raises:
        PlanError: if there is no such gesture, or a hand has no time for it.
    """
    phases, block = _taken_out(plan, gesture)
    plan = plan.with_hand(gesture.side, tuple(phases))
    partner = partner_of(plan, gesture)
    if partner is not None:
        plan = plan.with_hand(partner.side, tuple(_taken_out(plan, partner)[0]))
    return _on_hands(plan, _sides(hands), block, gesture.lands_s)


def held(plan: GesturePlan, gesture: Gesture, hold_s: float) -> Edited:
    """The gesture with a hold of some length at its end; 0 is none.

    Raises:
        PlanError: if there is no such gesture, or the length is negative.
    """
    if not 0 <= hold_s < math.inf:
        raise PlanError(f"A hold lasts 0 s or longer; got {hold_s:g} s.")
    phases, block = _taken_out(plan, gesture)
    while block[-1].phase == "hold":
        block.pop()
    end_s = block[-1].end_s
    if hold_s > 0:
        held_at = HandPhase(end_s, end_s + hold_s, "hold", block[-1].goal, block[-1].kind)
        block.append(held_at)
    edited = _laid(plan, gesture.side, phases, block, gesture.lands_s)
    now = next(p for p in edited.plan.hand(gesture.side) if p.end_s >= end_s + 1e-6)
    if now.phase == "hold" and hold_s > 0 and now.end_s < end_s + hold_s - 1e-6:
        note = f"The hold ends at {now.end_s:.2f} s, where the next gesture begins."
        return replace(edited, notes=(*edited.notes, note))
    return edited


def sized(plan: GesturePlan, gesture: Gesture, size: float) -> Edited:
    """The gesture ``size`` times as large, seen from where hands rest.

    Raises:
        PlanError: if there is no such gesture, or the size is not .1 to 4.
    """
    if not 0.1 <= size <= 4:
        raise PlanError(f"A size is .1 to 4 times as large; got {size:g}.")
    return _with_goals(plan, gesture, lambda goal: _from_rest(goal, size))


def raised(plan: GesturePlan, gesture: Gesture, by_m: float) -> Edited:
    """The gesture so much higher, or lower.

    Raises:
        PlanError: if there is no such gesture, or it is more than an arm.
    """
    if not abs(by_m) <= 1:
        raise PlanError(f"A gesture is at most 1 m higher or lower; got {by_m:g} m.")
    return _with_goals(plan, gesture, lambda goal: (goal[0], goal[1] + by_m, goal[2]))


def hastened(plan: GesturePlan, gesture: Gesture, speed: float) -> Edited:
    """The gesture's preparation and strokes ``speed`` times as fast; it lands when it did.

    Raises:
        PlanError: if there is no such gesture, no time for it, or the speed is not .2 to 5.
    """
    if not 0.2 <= speed <= 5:
        raise PlanError(f"A speed is .2 to 5 times as fast; got {speed:g}.")
    phases, block = _taken_out(plan, gesture)
    notes: list[str] = []
    at_s, slower = gesture.lands_s, []
    for one in reversed([p for p in block if p.end_s <= gesture.lands_s + 1e-9]):
        wanted = (one.end_s - one.start_s) / speed
        lasts = max(wanted, min(one.end_s - one.start_s, _least(one)))
        if lasts > wanted + 1e-9:
            notes.append(f"Its {one.phase} lasts {lasts:.2f} s; hands need as long.")
        slower.append(replace(one, start_s=at_s - lasts, end_s=at_s))
        at_s -= lasts
    after = [one for one in block if one.end_s > gesture.lands_s + 1e-9]
    edited = _laid(plan, gesture.side, phases, [*reversed(slower), *after], gesture.lands_s)
    return replace(edited, notes=(*notes, *edited.notes))


Body = Nod | Look | Brow | Smile | Blink | Stand
_LISTS: dict[type, str] = {
    Nod: "nods", Look: "looks", Brow: "brows", Smile: "smiles", Blink: "blinks", Stand: "stands",
}  # fmt: skip


def with_event(plan: GesturePlan, event: Body) -> Edited:
    """The plan with a nod, look, brow, smile, blink or stand; a span cuts others of its list.

    Raises:
        PlanError: if it lies outside of the speech, or is none.
    """
    name = _LISTS[type(event)]
    end_s = getattr(event, "end_s", getattr(event, "time_s", 0.0))
    start_s = getattr(event, "start_s", end_s)
    if not 0 <= start_s <= end_s <= plan.duration_s:
        raise PlanError(
            f"The speech goes from 0 to {plan.duration_s:.2f} s; got {start_s:g} to {end_s:g} s."
        )
    events = list(getattr(plan, name))
    if hasattr(event, "start_s"):
        events = [part for one in events for part in _around_span(one, start_s, end_s)]
    events.append(event)
    events.sort(key=lambda one: getattr(one, "start_s", getattr(one, "time_s", 0.0)))
    return Edited(replace(plan, **{name: tuple(events)}))


def without_event(plan: GesturePlan, event: Body) -> Edited:
    """The plan without an event of the head, face or legs.

    Raises:
        PlanError: if it has no such.
    """
    name = _LISTS[type(event)]
    events = list(getattr(plan, name))
    if event not in events:
        raise PlanError(f"The plan has no such {type(event).__name__.lower()}.")
    events.remove(event)
    return Edited(replace(plan, **{name: tuple(events)}))


def keeping(locked: Sequence[Gesture], before: GesturePlan, edited: Edited) -> Edited:
    """What was edited, if all that is locked stayed.

    Raises:
        PlanError: if a locked gesture is gone or another: holds after it alone may give way.
    """
    for gesture in locked:
        old = _moves_of(before, gesture)
        if old != _moves_of(edited.plan, gesture):
            raise PlanError(
                f"The {gesture.side} hand's gesture at {gesture.lands_s:.2f} s is locked; unlock "
                "it to change it."
            )
    return edited


def _moves_of(plan: GesturePlan, gesture: Gesture) -> list[HandPhase] | None:
    stroke = _found(plan, gesture)
    if stroke is None:
        return None
    phases = plan.hand(gesture.side)[stroke.first : stroke.last + 1]
    return [phase for phase in phases if phase.phase != "hold"]


def _around_span(event: Any, start_s: float, end_s: float) -> list[Any]:
    """What is left of a span beside another."""
    parts = []
    if event.start_s < start_s:
        parts.append(replace(event, end_s=min(event.end_s, start_s)))
    if event.end_s > end_s:
        parts.append(replace(event, start_s=max(event.start_s, end_s)))
    return parts


def _sides(hands: Hands) -> tuple[Side, ...]:
    return SIDES if hands == "both" else (hands,)


def _found(plan: GesturePlan, gesture: Gesture) -> Stroke | None:
    """The gesture among the plan's, to a hundredth of a second."""
    own = (stroke for stroke in strokes_of(plan) if stroke.side == gesture.side)
    off = {abs(stroke.lands.end_s - gesture.lands_s): stroke for stroke in own}
    nearest = min(off, default=math.inf)
    return off[nearest] if nearest < 0.01 else None


def partner_of(plan: GesturePlan, gesture: Gesture) -> Gesture | None:
    """The other hand's gesture that lands with this one."""
    other = SIDES[1 - SIDES.index(gesture.side)]
    near = [g for g in gestures(plan, other) if abs(g.lands_s - gesture.lands_s) < TOGETHER_S]
    return near[0] if near else None


def _taken_out(plan: GesturePlan, gesture: Gesture) -> tuple[list[HandPhase], list[HandPhase]]:
    """The phases of the hand without a gesture, and the gesture's own."""
    filled = plan.with_hand(gesture.side, without_gaps(plan.hand(gesture.side), plan.duration_s))
    stroke = _found(filled, gesture)
    if stroke is None:
        raise PlanError(
            f"The {gesture.side} hand makes no gesture that lands at {gesture.lands_s:.2f} s."
        )
    phases = list(filled.hand(gesture.side))
    block = phases[stroke.first : stroke.last + 1]
    before = phases[stroke.first - 1] if stroke.first > 0 else None
    after = stroke.last + 1
    if before is None or before.phase in ("rest", "retraction"):
        if after < len(phases) and phases[after].phase == "retraction":
            after += 1
        goal = before.goal if before else rest_goal(phases)
        still = HandPhase(block[0].start_s, phases[after - 1].end_s, "rest", goal)
    else:
        start_s, end_s = block[0].start_s, block[-1].end_s
        still = HandPhase(start_s, end_s, "hold", before.goal, before.kind)
    return _merged([*phases[: stroke.first], still, *phases[after:]]), block


def rest_goal(phases: Sequence[HandPhase]) -> Place:
    """Where a hand rests, the first time it does."""
    return next((p.goal for p in phases if p.phase in ("rest", "retraction")), REST_PLACE)


def _merged(phases: Sequence[HandPhase]) -> list[HandPhase]:
    """Rests and holds that follow on one another as one."""
    found: list[HandPhase] = []
    for phase in phases:
        last = found[-1] if found else None
        is_same = last is not None and last.phase == phase.phase and last.goal == phase.goal
        if last is not None and is_same and phase.phase in ("rest", "hold"):
            found[-1] = replace(last, end_s=phase.end_s)
        else:
            found.append(phase)
    return found


def _shifted(block: Sequence[HandPhase], by_s: float) -> list[HandPhase]:
    return [replace(one, start_s=one.start_s + by_s, end_s=one.end_s + by_s) for one in block]


def _on_hands(
    plan: GesturePlan, sides: Sequence[Side], block: Sequence[HandPhase], lands_s: float
) -> Edited:
    notes: list[str] = []
    for side in sides:
        phases = list(without_gaps(plan.hand(side), plan.duration_s))
        edited = _laid(plan, side, phases, list(block), lands_s)
        plan = edited.plan
        notes += edited.notes
    return Edited(plan, tuple(dict.fromkeys(notes)))


def _least(phase: HandPhase) -> float:
    """The shortest that a phase can be."""
    least = {"stroke": LEAST_STROKE_S, "beat": LEAST_BEAT_S, "hold": 0.0, "rest": 0.0}
    return least.get(phase.phase, LEAST_MOVE_S)


def _laid(
    plan: GesturePlan,
    side: Side,
    phases: Sequence[HandPhase],
    block: Sequence[HandPhase],
    lands_s: float,
) -> Edited:
    """The plan with a gesture laid over what a hand does: where it is still or goes back it gives
    way, nowhere else.

    Raises:
        PlanError: if there is no time for it.
    """
    notes: list[str] = []
    body = [one for one in block if one.phase != "preparation"]
    strikes_s = body[0].start_s
    if body[0].end_s - strikes_s < LEAST_STROKE_S - _TINY_S:
        notes.append(f"Its stroke was shorter than {LEAST_STROKE_S:g} s and begins earlier.")
        strikes_s = body[0].end_s - LEAST_STROKE_S
        body[0] = replace(body[0], start_s=strikes_s)
    busy_s = max(one.end_s for one in body if one.phase != "hold")
    ready = _preparation(phases, block, body[0])
    least_s = 0.0 if ready is None else LEAST_MOVE_S
    if strikes_s < least_s - _TINY_S or busy_s > plan.duration_s + _TINY_S:
        raise PlanError(
            f"A gesture that lands at {lands_s:.2f} s strikes from {strikes_s:.2f} to {busy_s:.2f} "
            f"s; that must lie between {least_s:g} s, so that the hand gets there, and the end at "
            f"{plan.duration_s:.2f} s."
        )
    moving = [one for one in phases if one.phase in ("preparation", "stroke", "beat")]
    for one in moving:
        if one.start_s < busy_s - _TINY_S and one.end_s > strikes_s - least_s + _TINY_S:
            kind = f" ({one.kind})" if one.kind else ""
            raise PlanError(
                f"The {side} hand makes a {one.phase}{kind} from {one.start_s:.2f} to "
                f"{one.end_s:.2f} s; there is no time for a gesture that strikes from "
                f"{strikes_s:.2f} to {busy_s:.2f} s."
            )
    if ready is not None:
        free_s = max((one.end_s for one in moving if one.end_s <= strikes_s), default=0.0)
        ready_s = max(free_s, min(ready.start_s, strikes_s - LEAST_MOVE_S))
        body.insert(0, replace(ready, start_s=ready_s, end_s=strikes_s))
    until_s = min((one.start_s for one in moving if one.start_s >= busy_s - _TINY_S), default=None)
    body, mended = within_reach(body)
    later = [] if until_s is None else [one for one in phases if one.start_s >= until_s - _TINY_S]
    ending = _ending(phases, body, plan.duration_s if until_s is None else until_s)
    new = _merged([*_until(phases, body[0].start_s), *ending, *later])
    return Edited(plan.with_hand(side, tuple(new)), (*notes, *mended))


def _preparation(
    phases: Sequence[HandPhase], block: Sequence[HandPhase], stroke: HandPhase
) -> HandPhase | None:
    """How the hand gets ready; a stroke that had no preparation needs none where a hand is up."""
    own = [one for one in block if one.phase == "preparation"]
    if own:
        return replace(own[-1], start_s=own[0].start_s)
    before = [one for one in phases if one.start_s < stroke.start_s - _TINY_S]
    if before and before[-1].phase not in ("rest", "retraction"):
        return None
    start_s = stroke.start_s - USUAL_PREPARATION_S
    return HandPhase(start_s, stroke.start_s, "preparation", ready_for(stroke.goal), stroke.kind)


def _until(phases: Sequence[HandPhase], end_s: float) -> list[HandPhase]:
    """The phases before some time; a hand that has no time to go back stays where it is."""
    kept = [replace(p, end_s=min(p.end_s, end_s)) for p in phases if p.start_s < end_s - _TINY_S]
    if kept and kept[-1].phase == "retraction":
        last = kept[-1]
        whole = next(p for p in phases if p.start_s == last.start_s)
        if last.end_s < whole.end_s - _TINY_S and last.end_s - last.start_s < LEAST_BACK_S:
            before = kept[-2] if len(kept) > 1 else None
            goal, kind = (before.goal, before.kind) if before else (last.goal, "")
            kept[-1] = HandPhase(last.start_s, last.end_s, "hold", goal, kind)
    return kept


def _ending(
    phases: Sequence[HandPhase], body: Sequence[HandPhase], until_s: float
) -> list[HandPhase]:
    """A gesture with what follows it until the next one: back to rest where there is time."""
    found: list[HandPhase] = []
    for one in body:
        if one.start_s < until_s - _TINY_S:
            found.append(replace(one, end_s=min(one.end_s, until_s)))
    last = found[-1]
    left_s = until_s - last.end_s
    if left_s >= LEAST_BACK_S + LEAST_REST_S:
        back_s = last.end_s + min(USUAL_RETRACTION_S, left_s - LEAST_REST_S)
        goal = rest_goal(phases)
        found.append(HandPhase(last.end_s, back_s, "retraction", goal))
        if until_s - back_s > _TINY_S:
            found.append(HandPhase(back_s, until_s, "rest", goal))
    elif left_s > _TINY_S:
        if last.phase == "hold":
            found[-1] = replace(last, end_s=until_s)
        else:
            found.append(HandPhase(last.end_s, until_s, "hold", last.goal, last.kind))
    return found


def _with_goals(plan: GesturePlan, gesture: Gesture, new: Callable[[Place], Place]) -> Edited:
    phases, block = _taken_out(plan, gesture)
    changed = [replace(one, goal=new(one.goal)) for one in block]
    return _laid(plan, gesture.side, phases, changed, gesture.lands_s)


def _from_rest(goal: Place, size: float) -> Place:
    out, up, forward = (r + size * (g - r) for g, r in zip(goal, REST_PLACE, strict=True))
    return out, up, forward


def within_reach(block: Sequence[HandPhase]) -> tuple[list[HandPhase], tuple[str, ...]]:
    """Goals that an arm reaches, and that are not inside the body."""
    found, notes = [], []
    for one in block:
        out, up, forward = one.goal
        far = math.dist(one.goal, (0.0, 0.0, 0.0)) / ARM_M
        if far > 1:
            out, up, forward = out / far, up / far, forward / far
            notes.append(f"A place out of reach was brought to {ARM_M:g} m from the chest.")
        is_inside = abs(out) < BODY_WIDTH_M and LEAST_UP_M < up < MOST_UP_M
        if is_inside and forward < BODY_DEPTH_M:
            forward = BODY_DEPTH_M
            notes.append("A place inside the body was brought before it.")
        found.append(replace(one, goal=tuple(round(n, 4) for n in (out, up, forward))))
    return found, tuple(dict.fromkeys(notes))
