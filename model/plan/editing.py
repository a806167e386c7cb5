"""Edits of a gesture plan: each returns another plan, or raises a `PlanError` with the reason.

The phases of a hand follow one another without a gap, from start to end: when one becomes longer
its neighbours become shorter, but no phase falls below its shortest duration. A gesture is its
preparation, the hold before its stroke, the stroke, and the holds and beats after it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from model.plan.annotation_files import Interval
from model.plan.kinds import (
    BIMANUAL_TOLERANCE_S,
    HOLD_S,
    MIN_REST_S,
    PREPARATION_S,
    REST_POSITION,
    RETRACTION_S,
    STROKE_END_IN_WORD,
    STROKE_S,
    TWO_HANDED_KINDS,
    USUAL_STROKE_GOALS,
    GesturePhases,
    Position,
    group_gesture_phases,
    preparation_goal,
    usual_stroke_goal,
)
from model.plan.plan import (
    SIDES,
    Blink,
    Brow,
    Gaze,
    GesturePlan,
    HandPhase,
    Nod,
    Phase,
    PlanError,
    PlanResult,
    PointEvent,
    Side,
    Smile,
    SpanEvent,
    Stance,
    fill_gaps,
)

MIN_PHASE_S: dict[Phase, float] = {
    "rest": MIN_REST_S, "preparation": 0.2, "stroke": 0.2, "hold": 0.1, "beat": 0.1,
    "retraction": 0.5,
}  # fmt: skip
"""Shortest duration of a phase after an edit (s); one that was shorter is not changed."""
MIN_RETRACTION_S = MIN_PHASE_S["retraction"] + MIN_REST_S
"""Shortest time in which a hand retracts to rest (s)."""
MAX_CHEST_TO_WRIST_M = 0.72
"""Largest distance of a wrist from the chest (m)."""
BODY_WIDTH_M, BODY_DEPTH_M, MIN_UP_M, MAX_UP_M = 0.16, 0.14, -0.5, 0.12
"""Region of the body in the chest's frame: to either side, forwards, and its range upwards (m)."""
TIME_TOLERANCE_S = 0.01
"""Tolerance with which a gesture or phase is identified by its end (s)."""
_TINY_S = 1e-6
Hands = Literal["left", "right", "both"]


@dataclass(frozen=True)
class GestureKey:
    """Identity of a gesture: its hand and the end of its last stroke."""

    side: Side
    stroke_end_s: float


class NoRoomError(PlanError):
    """No time for a gesture, because the hand makes another one there."""

    def __init__(self, sentence: str, kind: str, gesture: GestureKey | None) -> None:
        super().__init__(sentence)
        self.kind = kind
        self.gesture = gesture
        """The other gesture; None if it cannot be identified."""


def _phases(plan: GesturePlan, side: Side) -> list[HandPhase]:
    return list(fill_gaps(plan.hand(side), plan.duration_s))


def gestures(plan: GesturePlan, side: Side) -> tuple[GestureKey, ...]:
    """Return the gestures of a hand in order of time."""
    return tuple(
        GestureKey(side, s.last_stroke.end_s) for s in group_gesture_phases(plan) if s.side == side
    )


def default_stroke_end_on_word(word: Interval) -> float:
    """Return the default time of the end of a stroke on a word."""
    return word.start_s + STROKE_END_IN_WORD * (word.end_s - word.start_s)


def move_gesture(
    plan: GesturePlan, gesture: GestureKey, stroke_end_s: float, word: str | None = None
) -> PlanResult:
    """Move a gesture so that its last stroke ends at ``stroke_end_s``, on ``word`` if given."""
    phases, block = _taken_out(plan, gesture)
    if word is not None:
        block = [replace(one, word=word if one.phase == "stroke" else "") for one in block]
    by_s = stroke_end_s - gesture.stroke_end_s
    block = [replace(p, start_s=p.start_s + by_s, end_s=p.end_s + by_s) for p in block]
    return _laid(plan, gesture.side, phases, block)


def delete_gesture(plan: GesturePlan, gesture: GestureKey) -> PlanResult:
    """Delete a gesture; the hand stays as it was before it."""
    phases, _ = _taken_out(plan, gesture)
    return PlanResult(plan.with_hand(gesture.side, tuple(phases)))


def add_gesture(
    plan: GesturePlan, kind: str, stroke_end_s: float, hands: Hands | None = None, word: str = ""
) -> PlanResult:
    """Add a gesture of the palette with a stroke that ends at ``stroke_end_s``.

    ``hands`` None is both for kinds that both hands make, or else the right.
    """
    if kind not in USUAL_STROKE_GOALS:
        raise PlanError(
            f"There is no gesture {kind[:40]!r}; choose one of {', '.join(USUAL_STROKE_GOALS)}."
        )
    hands = hands or ("both" if kind in TWO_HANDED_KINDS else "right")
    goal = usual_stroke_goal(kind)
    strikes_s = stroke_end_s - STROKE_S
    block = [
        HandPhase(
            strikes_s - PREPARATION_S, strikes_s, "preparation", preparation_goal(goal), kind
        ),
        HandPhase(strikes_s, stroke_end_s, "stroke", goal, kind, word),
        HandPhase(stroke_end_s, stroke_end_s + HOLD_S, "hold", goal, kind),
    ]
    return _on_hands(plan, _sides(hands), block)


def change_hands(plan: GesturePlan, gesture: GestureKey, hands: Hands) -> PlanResult:
    """Transfer a gesture to other hands, and delete it from its present ones."""
    phases, block = _taken_out(plan, gesture)
    plan = plan.with_hand(gesture.side, tuple(phases))
    partner = other_hand_gesture(plan, gesture)
    if partner is not None:
        plan = plan.with_hand(partner.side, tuple(_taken_out(plan, partner)[0]))
    return _on_hands(plan, _sides(hands), block)


def set_hold(plan: GesturePlan, gesture: GestureKey, hold_s: float) -> PlanResult:
    """Set the length of the hold at the end of a gesture; 0 removes it."""
    if not 0 <= hold_s < math.inf:
        raise PlanError(f"The hold must last 0 s or longer; got {hold_s:g} s.")
    phases, block = _taken_out(plan, gesture)
    while block[-1].phase == "hold":
        block.pop()
    end_s = block[-1].end_s
    if hold_s > 0:
        held_at = HandPhase(end_s, end_s + hold_s, "hold", block[-1].goal, block[-1].kind)
        block.append(held_at)
    edited = _laid(plan, gesture.side, phases, block)
    now = next(p for p in edited.plan.hand(gesture.side) if p.end_s >= end_s + _TINY_S)
    if now.phase == "hold" and hold_s > 0 and now.end_s < end_s + hold_s - _TINY_S:
        note = f"The hold was cut at {now.end_s:.2f} s, where the next gesture begins."
        return replace(edited, notes=(*edited.notes, note))
    return edited


def scale_gesture(plan: GesturePlan, gesture: GestureKey, size: float) -> PlanResult:
    """Scale a gesture's goals about the rest position by a factor."""
    if not 0.1 <= size <= 4:
        raise PlanError(f"The size factor must be from 0.1 to 4; got {size:g}.")

    def grown(goal: Position) -> Position:
        out, up, forward = (r + size * (g - r) for g, r in zip(goal, REST_POSITION, strict=True))
        return out, up, forward

    return _with_goals(plan, gesture, grown)


def raise_gesture(plan: GesturePlan, gesture: GestureKey, by_m: float) -> PlanResult:
    """Raise or lower a gesture by metres."""
    if not abs(by_m) <= 1:
        raise PlanError(f"The change in height must be at most 1 m up or down; got {by_m:g} m.")
    return _with_goals(plan, gesture, lambda goal: (goal[0], goal[1] + by_m, goal[2]))


def scale_gesture_speed(plan: GesturePlan, gesture: GestureKey, speed: float) -> PlanResult:
    """Change the speed of preparation and strokes by a factor; holds and strokes' end stay."""
    if not 0.2 <= speed <= 5:
        raise PlanError(f"The speed factor must be from 0.2 to 5; got {speed:g}.")
    phases, block = _taken_out(plan, gesture)
    notes: list[str] = []
    at_s, slower = gesture.stroke_end_s, []
    for one in reversed([p for p in block if p.end_s <= gesture.stroke_end_s + 1e-9]):
        wanted = (one.end_s - one.start_s) / (1 if one.phase == "hold" else speed)
        lasts = max(wanted, _least(one))
        if lasts > wanted + 1e-9:
            notes.append(f"The {one.phase} now lasts {lasts:.2f} s, the shortest possible.")
        slower.append(replace(one, start_s=at_s - lasts, end_s=at_s))
        at_s -= lasts
    after = [one for one in block if one.end_s > gesture.stroke_end_s + 1e-9]
    edited = _laid(plan, gesture.side, phases, [*reversed(slower), *after])
    return replace(edited, notes=(*notes, *edited.notes))


def move_phase_end(
    plan: GesturePlan, side: Side, phase_end_s: float, new_end_s: float
) -> PlanResult:
    """Move the end of a hand's phase from ``phase_end_s`` to ``new_end_s``, or near it.

    A hold without time left to retract lasts until the next gesture. If a gesture now ends early
    enough for the hand to go to rest before the next one, it does.
    """
    phases = _phases(plan, side)
    k = _ending_at(phases, phase_end_s)
    if k is None:
        raise PlanError(f"No phase of the {side} hand ends at {phase_end_s:.2f} s.")
    if k == len(phases) - 1:
        raise PlanError(
            f"The {side} hand's last phase, a {phases[k].phase}, ends with the speech; its end "
            "cannot be moved."
        )
    one, then = phases[k], phases[k + 1]
    if then.phase == "retraction":
        changed, why = _before_way_back(phases, k, new_end_s, plan.duration_s)
    elif (
        then.phase == "preparation"
        and one.phase in ("stroke", "hold", "beat")
        and then.start_s - max(new_end_s, one.start_s + _least(one)) >= MIN_RETRACTION_S
    ):
        to_s, why = _no_earlier(one, new_end_s)
        back = _back_to_rest(phases, to_s, then.start_s)
        changed = [*phases[:k], replace(one, end_s=to_s), *back, *phases[k + 1 :]]
    else:
        to_s, why = _no_earlier(one, new_end_s)
        latest_s = then.end_s - _least(then)
        if to_s > latest_s:
            to_s, why = latest_s, _needs(one, then, latest_s)
        changed = [*phases]
        changed[k], changed[k + 1] = replace(one, end_s=to_s), replace(then, start_s=to_s)
    if why and abs(changed[k].end_s - one.end_s) < TIME_TOLERANCE_S:
        raise PlanError(why)
    return PlanResult(plan.with_hand(side, tuple(changed)), (why,) if why else ())


def other_hand_phase_end(plan: GesturePlan, side: Side, end_s: float) -> float | None:
    """Return the end of the other hand's corresponding phase of a gesture, or None."""
    filled = replace(plan, left=tuple(_phases(plan, "left")), right=tuple(_phases(plan, "right")))
    k = _ending_at(filled.hand(side), end_s)
    own = None if k is None else _gesture_with(filled, side, filled.hand(side)[k])
    partner = other_hand_gesture(plan, own) if own else None
    theirs = _find_stroke(filled, partner) if partner else None
    if partner is None or theirs is None or k is None:
        return None
    near = [
        phase.end_s
        for phase in filled.hand(partner.side)[theirs.first_index : theirs.last_index + 1]
        if phase.phase == filled.hand(side)[k].phase
        and abs(phase.end_s - end_s) < BIMANUAL_TOLERANCE_S
    ]
    return min(near, key=lambda at: abs(at - end_s), default=None)


def _before_way_back(
    phases: Sequence[HandPhase], k: int, at_s: float, duration_s: float
) -> tuple[list[HandPhase], str]:
    """Return the phases with a new end of the one before a retraction, and a note."""
    one, back = phases[k], phases[k + 1]
    rest = phases[k + 2] if k + 2 < len(phases) and phases[k + 2].phase == "rest" else None
    until_s = back.end_s if rest is None else rest.end_s
    after = phases[k + 2 if rest is None else k + 3 :]
    to_s, why = _no_earlier(one, at_s)
    rested_s = until_s if rest is None else until_s - _least(rest)
    latest_s = rested_s - _least(back)
    if to_s > latest_s and one.phase == "hold":
        end = (
            "the speech ends"
            if until_s > duration_s - TIME_TOLERANCE_S
            else "the next gesture begins"
        )
        why = f"The hold lasts until {end} at {until_s:.2f} s: there is no time for a retraction."
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
    why = f"The {one.phase} ends at {earliest_s:.2f} s: it must last at least {_least(one):.2g} s."
    return earliest_s, why


def _needs(one: HandPhase, then: HandPhase, latest_s: float) -> str:
    return (
        f"The {one.phase} ends at {latest_s:.2f} s: the next {then.phase} needs at least "
        f"{_least(then):.2g} s."
    )


def _least(phase: HandPhase) -> float:
    return min(MIN_PHASE_S[phase.phase], phase.end_s - phase.start_s)


def _ending_at(phases: Sequence[HandPhase], end_s: float) -> int | None:
    near = min(range(len(phases)), key=lambda i: abs(phases[i].end_s - end_s), default=None)
    return near if near is not None and abs(phases[near].end_s - end_s) < TIME_TOLERANCE_S else None


_LISTS: dict[type, str] = {
    Nod: "nods", Gaze: "looks", Brow: "brows", Smile: "smiles", Blink: "blinks", Stance: "stands",
}  # fmt: skip


def add_event(plan: GesturePlan, event: SpanEvent | PointEvent) -> PlanResult:
    """Add a nod, gaze, brow, smile, blink or stance; a span replaces what it overlaps."""
    name, start_s, end_s = _LISTS[type(event)], event.start_s, event.end_s
    if not 0 <= start_s <= end_s <= plan.duration_s:
        raise PlanError(
            f"Times must be within the speech, 0 to {plan.duration_s:.2f} s; got {start_s:g} to "
            f"{end_s:g} s."
        )
    events = getattr(plan, name)
    if isinstance(event, SpanEvent):
        events = [
            replace(one, start_s=from_s, end_s=to_s)
            for one in events
            for from_s, to_s in (
                (one.start_s, min(one.end_s, start_s)),
                (max(one.start_s, end_s), one.end_s),
            )
            if from_s < to_s
        ]
    in_time = sorted((*events, event), key=lambda one: one.start_s)
    return PlanResult(replace(plan, **{name: tuple(in_time)}))


def _sides(hands: Hands) -> tuple[Side, ...]:
    return SIDES if hands == "both" else (hands,)


def _find_stroke(plan: GesturePlan, gesture: GestureKey) -> GesturePhases | None:
    """Return the plan's stroke of a gesture, within a hundredth of a second."""
    own = (stroke for stroke in group_gesture_phases(plan) if stroke.side == gesture.side)
    off = {abs(stroke.last_stroke.end_s - gesture.stroke_end_s): stroke for stroke in own}
    return off[min(off)] if off and min(off) < TIME_TOLERANCE_S else None


def _gesture_with(plan: GesturePlan, side: Side, phase: HandPhase) -> GestureKey | None:
    for stroke in group_gesture_phases(plan):
        if (
            stroke.side == side
            and phase in plan.hand(side)[stroke.first_index : stroke.last_index + 1]
        ):
            return GestureKey(side, stroke.last_stroke.end_s)
    return None


def other_hand_gesture(plan: GesturePlan, gesture: GestureKey) -> GestureKey | None:
    """Return the other hand's gesture with a stroke that ends at the same time."""
    other = SIDES[1 - SIDES.index(gesture.side)]
    near = [
        g
        for g in gestures(plan, other)
        if abs(g.stroke_end_s - gesture.stroke_end_s) < BIMANUAL_TOLERANCE_S
    ]
    return near[0] if near else None


def _taken_out(plan: GesturePlan, gesture: GestureKey) -> tuple[list[HandPhase], list[HandPhase]]:
    """Return the hand's phases without a gesture, and the gesture's phases."""
    phases = _phases(plan, gesture.side)
    stroke = _find_stroke(plan.with_hand(gesture.side, tuple(phases)), gesture)
    if stroke is None:
        raise PlanError(
            f"The {gesture.side} hand has no gesture whose stroke ends at "
            f"{gesture.stroke_end_s:.2f} s."
        )
    block = phases[stroke.first_index : stroke.last_index + 1]
    before = phases[stroke.first_index - 1] if stroke.first_index > 0 else None
    after = stroke.last_index + 1
    if before is None or before.phase in ("rest", "retraction"):
        if after < len(phases) and phases[after].phase == "retraction":
            after += 1
        goal = before.goal if before else _rest_goal(phases)
        still = HandPhase(block[0].start_s, phases[after - 1].end_s, "rest", goal)
    else:
        start_s, end_s = block[0].start_s, block[-1].end_s
        still = HandPhase(start_s, end_s, "hold", before.goal, before.kind)
    return _merged([*phases[: stroke.first_index], still, *phases[after:]]), block


def _rest_goal(phases: Sequence[HandPhase]) -> Position:
    """Return the goal of the hand's first rest."""
    return next((p.goal for p in phases if p.phase in ("rest", "retraction")), REST_POSITION)


def _merged(phases: Sequence[HandPhase]) -> list[HandPhase]:
    """Merge consecutive rests and holds."""
    merged: list[HandPhase] = []
    for phase in phases:
        last = merged[-1] if merged else None
        is_same = last is not None and last.phase == phase.phase and last.goal == phase.goal
        if last is not None and is_same and phase.phase in ("rest", "hold"):
            merged[-1] = replace(last, end_s=phase.end_s)
        else:
            merged.append(phase)
    return merged


def _on_hands(plan: GesturePlan, sides: Sequence[Side], block: Sequence[HandPhase]) -> PlanResult:
    done = PlanResult(plan)
    for side in sides:
        done = done.then(lambda new, on=side: _laid(new, on, _phases(new, on), block))
    return done


def _laid(
    plan: GesturePlan, side: Side, phases: Sequence[HandPhase], block: Sequence[HandPhase]
) -> PlanResult:
    """Insert a gesture into a hand's phases, in place of rests, holds and retractions only."""
    notes: list[str] = []
    body = [one for one in block if one.phase != "preparation"]
    least_s = MIN_PHASE_S["stroke"]
    k = next(k for k, one in enumerate(body) if one.phase == "stroke")
    if body[k].end_s - body[k].start_s < least_s - _TINY_S:
        notes.append(f"The stroke was shorter than {least_s:g} s, so its start was moved earlier.")
        stroke = replace(body[k], start_s=body[k].end_s - least_s)
        body = [*_until(body[:k], stroke.start_s), stroke, *body[k + 1 :]]
    strikes_s = body[0].start_s
    busy_s = max(one.end_s for one in body if one.phase != "hold")
    ready = _preparation(phases, block, body[0])
    least_s = 0.0 if ready is None else MIN_PHASE_S["preparation"]
    if strikes_s < least_s - _TINY_S or busy_s > plan.duration_s + _TINY_S:
        raise PlanError(
            f"The stroke would last from {strikes_s:.2f} to {busy_s:.2f} s; it must start at "
            f"{least_s:g} s or later (time for the preparation) and end before the speech does, at "
            f"{plan.duration_s:.2f} s."
        )
    moving = [one for one in phases if one.phase in ("preparation", "stroke", "beat")]
    for one in moving:
        if one.start_s < busy_s - _TINY_S and one.end_s > strikes_s - least_s + _TINY_S:
            kind = f" ({one.kind.replace('_', ' ')})" if one.kind else ""
            raise NoRoomError(
                f"The {side} hand makes a {one.phase}{kind} from {one.start_s:.2f} to "
                f"{one.end_s:.2f} s; there is no time for a stroke from {strikes_s:.2f} to "
                f"{busy_s:.2f} s.",
                one.kind,
                _gesture_with(plan.with_hand(side, tuple(phases)), side, one),
            )
    if ready is not None:
        free_s = max((one.end_s for one in moving if one.end_s <= strikes_s), default=0.0)
        ready_s = max(free_s, min(ready.start_s, strikes_s - MIN_PHASE_S["preparation"]))
        body.insert(0, replace(ready, start_s=ready_s, end_s=strikes_s))
    until_s = min((one.start_s for one in moving if one.start_s >= busy_s - _TINY_S), default=None)
    body, mended = clamp_goals(body)
    later = [] if until_s is None else [one for one in phases if one.start_s >= until_s - _TINY_S]
    ending = _ending(phases, body, plan.duration_s if until_s is None else until_s)
    new = _merged([*_until(phases, body[0].start_s), *ending, *later])
    return PlanResult(plan.with_hand(side, tuple(new)), (*notes, *mended))


def _preparation(
    phases: Sequence[HandPhase], block: Sequence[HandPhase], stroke: HandPhase
) -> HandPhase | None:
    """Return the preparation; None if the stroke had none and the hand is already raised."""
    own = [one for one in block if one.phase == "preparation"]
    if own:
        return replace(own[-1], start_s=own[0].start_s)
    before = [one for one in phases if one.start_s < stroke.start_s - _TINY_S]
    if before and before[-1].phase not in ("rest", "retraction"):
        return None
    start_s = stroke.start_s - PREPARATION_S
    return HandPhase(
        start_s, stroke.start_s, "preparation", preparation_goal(stroke.goal), stroke.kind
    )


def _until(phases: Sequence[HandPhase], end_s: float) -> list[HandPhase]:
    """Return the phases before a time; a retraction that is cut too short becomes a hold."""
    shortened = [
        replace(p, end_s=min(p.end_s, end_s)) for p in phases if p.start_s < end_s - _TINY_S
    ]
    if shortened and shortened[-1].phase == "retraction":
        last = shortened[-1]
        whole = next(p for p in phases if p.start_s == last.start_s)
        if (
            last.end_s < whole.end_s - _TINY_S
            and last.end_s - last.start_s < MIN_PHASE_S["retraction"]
        ):
            before = shortened[-2] if len(shortened) > 1 else None
            goal, kind = (before.goal, before.kind) if before else (last.goal, "")
            shortened[-1] = HandPhase(last.start_s, last.end_s, "hold", goal, kind)
    return shortened


def _ending(
    phases: Sequence[HandPhase], body: Sequence[HandPhase], until_s: float
) -> list[HandPhase]:
    """Return a gesture with what follows it: a retraction, or a hold if time is short."""
    shortened = [
        replace(p, end_s=min(p.end_s, until_s)) for p in body if p.start_s < until_s - _TINY_S
    ]
    last = shortened[-1]
    left_s = until_s - last.end_s
    if left_s >= MIN_RETRACTION_S:
        shortened += _back_to_rest(phases, last.end_s, until_s)
    elif left_s > _TINY_S and last.phase == "hold":
        shortened[-1] = replace(last, end_s=until_s)
    elif left_s > _TINY_S:
        shortened.append(HandPhase(last.end_s, until_s, "hold", last.goal, last.kind))
    return shortened


def _back_to_rest(
    phases: Sequence[HandPhase], from_s: float, until_s: float
) -> tuple[HandPhase, HandPhase]:
    back_s = from_s + min(RETRACTION_S, until_s - from_s - MIN_REST_S)
    goal = _rest_goal(phases)
    rest = HandPhase(back_s, until_s, "rest", goal)
    return HandPhase(from_s, back_s, "retraction", goal), rest


def _with_goals(
    plan: GesturePlan, gesture: GestureKey, new: Callable[[Position], Position]
) -> PlanResult:
    phases, block = _taken_out(plan, gesture)
    changed = [replace(one, goal=new(one.goal)) for one in block]
    return _laid(plan, gesture.side, phases, changed)


def clamp_goals(block: Sequence[HandPhase]) -> tuple[list[HandPhase], tuple[str, ...]]:
    """Move goals into the arm's reach and out of the body, with notes."""
    clamped, notes = [], []
    for one in block:
        out, up, forward = one.goal
        far = math.dist(one.goal, (0.0, 0.0, 0.0)) / MAX_CHEST_TO_WRIST_M
        if far > 1:
            out, up, forward = out / far, up / far, forward / far
            notes.append(
                "A hand position out of reach was moved to "
                f"{MAX_CHEST_TO_WRIST_M:g} m from the chest."
            )
        is_inside = abs(out) < BODY_WIDTH_M and MIN_UP_M < up < MAX_UP_M
        if is_inside and forward < BODY_DEPTH_M:
            forward = BODY_DEPTH_M
            notes.append("A hand position inside the body was moved in front of it.")
        clamped.append(replace(one, goal=tuple(round(n, 4) for n in (out, up, forward))))
    return clamped, tuple(dict.fromkeys(notes))
