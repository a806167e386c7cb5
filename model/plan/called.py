"""Strokes that words call for where speech has placed none.

A planner that hears only the sound strikes on what is stressed. Some words are gestured on most of
the times they are said ("nobody", "again", "big"): where such a word falls on a hand that is still,
it gets its gesture as often as annotated speakers make one there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from model.plan.kinds import AFTER_WORD_S, BEFORE_WORD_S, KindTable, Spoken, drawn_by
from model.plan.palette import PREPARED
from model.plan.plan import SIDES, GesturePlan, HandPhase
from model.plan.tracks import STILL, without_gaps

PREPARATION_S, STROKE_S, HOLD_S, RETRACTION_S = 0.49, 0.31, 0.3, 0.8
"""Usual lengths in the corpus's annotation (medians; a hold of those that end in a retraction)."""
LANDS_AT = 0.3
"""Of the word's length, where a stroke usually ends."""
LEAST_REST_S = 0.2
"""What is left of a rest or a hold before it, so that it can be seen."""
_BOTH = 0.5


def with_called_strokes(
    plan: GesturePlan, words: Sequence[Spoken], table: KindTable, rng: np.random.Generator
) -> GesturePlan:
    """The plan with strokes on words that call for them. Chance is drawn for every word, used or
    not, so that plans of one text share it."""
    hands = {side: list(without_gaps(plan.hand(side), plan.duration_s)) for side in SIDES}
    has_changed = False
    for word in words:
        obeys, which, hand = rng.random(3)
        text = word.text.lower()
        if obeys >= table.struck.get(text, 0.0) or _is_struck(plan, word):
            continue
        shares = table.calls[text]
        kind = list(shares)[drawn_by(np.array(list(shares.values())), which)]
        lands_s = word.start_s + LANDS_AT * (word.end_s - word.start_s)
        is_both = table.both[table.names.index(kind)] > _BOTH
        still = {side: _still_at(hands[side], lands_s) for side in SIDES}
        free = [(side, k) for side, k in still.items() if k is not None]
        if not free or (is_both and len(free) < len(SIDES)):
            continue
        for side, k in free if is_both else [free[int(hand * len(free))]]:
            hands[side] = _struck(hands[side], k, lands_s, _goal(table, kind), kind, text)
            has_changed = True
    if not has_changed:
        return plan
    return replace(plan, left=tuple(hands["left"]), right=tuple(hands["right"]))


def _is_struck(plan: GesturePlan, word: Spoken) -> bool:
    return any(
        phase.phase == "stroke"
        and word.start_s - BEFORE_WORD_S <= phase.end_s <= word.end_s + AFTER_WORD_S
        for side in SIDES
        for phase in plan.hand(side)
    )


def _goal(table: KindTable, kind: str) -> tuple[float, float, float]:
    out, up, forward = table.goal[table.names.index(kind)]
    return float(out), float(up), float(forward)


def _still_at(phases: Sequence[HandPhase], lands_s: float) -> int | None:
    """The rest or hold that has room for preparation and stroke, and a moment after them."""
    begins_s = lands_s - STROKE_S - PREPARATION_S - LEAST_REST_S
    for k, phase in enumerate(phases):
        if phase.start_s <= begins_s and lands_s + HOLD_S <= phase.end_s:
            return k if phase.phase in STILL else None
    return None


def _struck(
    phases: Sequence[HandPhase],
    k: int,
    lands_s: float,
    goal: tuple[float, float, float],
    kind: str,
    word: str,
) -> list[HandPhase]:
    """The phases of a hand with a stroke in number ``k``, which is still."""
    old = phases[k]
    strikes_s, readies_s = lands_s - STROKE_S, lands_s - STROKE_S - PREPARATION_S
    out, up, forward = (at + off for at, off in zip(goal, PREPARED, strict=True))
    new = [
        replace(old, end_s=readies_s),
        HandPhase(readies_s, strikes_s, "preparation", (out, up, forward), kind),
        HandPhase(strikes_s, lands_s, "stroke", goal, kind, word),
    ]
    retracts_s = lands_s + HOLD_S
    rests_s = retracts_s + RETRACTION_S
    if old.phase == "rest" and rests_s + LEAST_REST_S <= old.end_s:
        new += [
            HandPhase(lands_s, retracts_s, "hold", goal, kind),
            HandPhase(retracts_s, rests_s, "retraction", old.goal, kind),
            replace(old, start_s=rests_s),
        ]
    else:
        new.append(HandPhase(lands_s, old.end_s, "hold", goal, kind))
    return [*phases[:k], *new, *phases[k + 1 :]]
