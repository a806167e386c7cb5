"""Edits done to a plan."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

from app.errors import RunError
from app.run.takes.edits import Edit, Locked
from model.plan import editing
from model.plan.editing import Edited, Gesture
from model.plan.ends import SAME_S, counterpart, ended
from model.plan.files import ENDINGS, read_plan_file
from model.plan.plan import SIDES, Blink, GesturePlan, Look, Nod, PlanError, Side
from model.plan.style import Style, excited, style_of, with_style
from model.speech.transcript import Word

NOD_DEG = 8.0
LOOK_S = 1.0
AT_S = 0.05
"""An event that is to be removed is found by its time, to so much."""


def edited(
    plan: GesturePlan, edits: Sequence[Edit], words: Sequence[Word], locked: Sequence[Locked]
) -> Edited:
    """The plan after all of them, in their order, and what was mended.

    Args:
        words: of the speech, which edits tell by their number.

    Raises:
        PlanError, RunError: with one sentence, if one cannot be done; then none is.
    """
    kept = tuple(Gesture(cast(Side, side), lands_s) for side, lands_s in locked)
    before, notes = plan, []
    for edit in edits:
        done = _DOES[edit.do](plan, edit.values, words, kept)
        plan = done.plan
        notes += done.notes
    return editing.keeping(kept, before, Edited(plan, tuple(dict.fromkeys(notes))))


Does = Callable[[GesturePlan, Mapping[str, Any], Sequence[Word], Sequence[Gesture]], Edited]


def _move(
    plan: GesturePlan, told: Mapping[str, Any], words: Sequence[Word], locked: Sequence[Gesture]
) -> Edited:
    gesture = _gesture(told)
    lands_s, word = _place(told, words)
    if word is None and "word" not in told:
        word = _said_at(words, lands_s)
    by_s = lands_s - gesture.lands_s
    return _with_partner(
        plan, gesture, lambda each, one: editing.moved(each, one, one.lands_s + by_s, word)
    )


def _delete(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    return _with_partner(plan, _gesture(told), editing.deleted)


def _add(plan: GesturePlan, told: Mapping[str, Any], words: Sequence[Word], *_: Any) -> Edited:
    lands_s, word = _place(told, words)
    return editing.added(plan, told["kind"], lands_s, told.get("hands"), word or "")


def _hands(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    return editing.with_hands(plan, _gesture(told), told["hands"])


def _hold(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    return _with_partner(
        plan, _gesture(told), lambda each, one: editing.held(each, one, told["hold"])
    )


def _end(plan: GesturePlan, told: Mapping[str, Any], words: Sequence[Word], *_: Any) -> Edited:
    """Another end of a phase, of both hands where they make it together; strokes that end at
    another time tell the word of that time."""
    side, by_s = cast(Side, told["side"]), told["at"] - told["ends"]
    done = ended(plan, side, told["ends"], told["at"])
    also_s = counterpart(plan, side, told["ends"])
    new, notes = done.plan, list(done.notes)
    if also_s is not None:
        also = ended(new, SIDES[1 - SIDES.index(side)], also_s, also_s + by_s)
        new, notes = also.plan, [*notes, *also.notes]
    for hand in SIDES:
        known = [one.end_s for one in plan.hand(hand) if one.phase == "stroke"]
        phases = tuple(
            replace(one, word=_said_at(words, one.end_s))
            if one.phase == "stroke" and all(abs(one.end_s - end_s) >= SAME_S for end_s in known)
            else one
            for one in new.hand(hand)
        )
        new = new.with_hand(hand, phases)
    return Edited(new, tuple(dict.fromkeys(notes)))


def _size(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    return _with_partner(
        plan, _gesture(told), lambda each, one: editing.sized(each, one, told["size"])
    )


def _height(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    return _with_partner(
        plan, _gesture(told), lambda each, one: editing.raised(each, one, told["by"])
    )


def _speed(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    return _with_partner(
        plan, _gesture(told), lambda each, one: editing.hastened(each, one, told["speed"])
    )


def _nod(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    return editing.with_event(plan, Nod(told["at"], told.get("depth", NOD_DEG)))


def _blink(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    return editing.with_event(plan, Blink(told["at"]))


def _look(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    end_s = min(plan.duration_s, told["at"] + told.get("lasts", LOOK_S))
    if end_s <= told["at"]:
        raise PlanError(f"The speech ends at {plan.duration_s:.2f} s; a look begins before.")
    return editing.with_event(plan, Look(told["at"], end_s, told["yaw"], told["pitch"]))


def _remove(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    def at(event: Any) -> float:
        return event.start_s if hasattr(event, "start_s") else event.time_s

    events = getattr(plan, told["list"])
    near = [event for event in events if abs(at(event) - told["at"]) < AT_S]
    if not near:
        raise PlanError(f"The plan has none of its {told['list']} at {told['at']:.2f} s.")
    return editing.without_event(plan, min(near, key=lambda event: abs(at(event) - told["at"])))


def _style(
    plan: GesturePlan, told: Mapping[str, Any], words: Sequence[Word], locked: Sequence[Gesture]
) -> Edited:
    wish = style_of(plan)
    sliders = {each.name for each in fields(Style)}
    wish = replace(wish, **{name: told[name] for name in sliders & set(told)})
    if "excite" in told:
        wish = excited(wish, told["excite"])
    return with_style(plan, wish, words, locked)


def _plan(plan: GesturePlan, told: Mapping[str, Any], *_: Any) -> Edited:
    """Another plan in place of this one, as long as the speech."""
    ending = Path(told["name"]).suffix
    if ending.lower() not in {each.lower() for each in ENDINGS}:
        raise RunError(
            f"A plan comes as {', '.join(ENDINGS)}; this file ends in {ending[:12] or 'nothing'!r}."
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"plan{ending.lower()}")
        path.write_text(told["text"], encoding="utf-8")
        read = read_plan_file(path)
    return Edited(as_long_as(read.plan, plan.duration_s), tuple(read.notes))


def as_long_as(plan: GesturePlan, duration_s: float) -> GesturePlan:
    """
    Raises:
        PlanError: if it is of speech of another length.
    """
    if abs(plan.duration_s - duration_s) > 0.5:
        raise PlanError(
            f"The plan is of {plan.duration_s:.2f} s and the speech lasts {duration_s:.2f} s; use "
            "the plan of this speech."
        )
    return plan


_DOES: dict[str, Does] = {
    "move": _move, "delete": _delete, "add": _add, "hands": _hands, "hold": _hold, "end": _end,
    "size": _size, "height": _height, "speed": _speed, "nod": _nod, "blink": _blink,
    "look": _look, "remove": _remove, "style": _style, "plan": _plan,
}  # fmt: skip


def _gesture(told: Mapping[str, Any]) -> Gesture:
    return Gesture(told["side"], told["lands"])


def _place(told: Mapping[str, Any], words: Sequence[Word]) -> tuple[float, str | None]:
    """When it lands, and on which word if that is told."""
    if "word" not in told:
        return told["at"], None
    if told["word"] >= len(words):
        raise RunError(f"The speech has {len(words)} words that are known; choose one of them.")
    word = words[told["word"]]
    return editing.on_word(word), word.text.lower()[:80]


def _said_at(words: Sequence[Word], at_s: float) -> str:
    """The word of a moment; empty where none is said or known."""
    return next((each.text.lower()[:80] for each in words if each.start_s <= at_s < each.end_s), "")


def _with_partner(
    plan: GesturePlan, gesture: Gesture, change: Callable[[GesturePlan, Gesture], Edited]
) -> Edited:
    """A change of a gesture, and of the other hand's part in it."""
    partner = editing.partner_of(plan, gesture)
    done = change(plan, gesture)
    if partner is None:
        return done
    also = change(done.plan, partner)
    return Edited(also.plan, tuple(dict.fromkeys((*done.notes, *also.notes))))
