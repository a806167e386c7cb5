"""Edits of a gesture plan: validated as untrusted input, and applied."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, cast

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config
from typing_extensions import TypedDict

from app.errors import RunError
from conventions.names import printable
from model.plan import editing
from model.plan.editing import TIME_TOLERANCE_S, GestureKey, Hands, NoRoomError
from model.plan.files import check_plan_suffix, parse_plan
from model.plan.plan import (
    SIDES,
    Blink,
    Gaze,
    GesturePlan,
    Nod,
    PlanError,
    PlanResult,
    PointEvent,
    Side,
    SpanEvent,
)
from model.plan.style import LIMITS, StyleChange
from model.speech.transcript import Word
from model.storage.json_validation import first_error_clause

MAX_EDITS = 60
"""Maximum number of edits in one request."""
MAX_PLAN_CHARACTERS = 2_000_000
NOD_DEG = 8.0
LOOK_S = 1.0
AT_S = 0.05
"""Tolerance (s) for finding an event to remove by its time."""
STEP_S = 0.1
"""Step (s) of the search for the nearest free place."""
Values = Mapping[str, Any]
Words = Sequence[Word]
ApplyEdit = Callable[[GesturePlan, Values, Words], PlanResult]


@dataclass(frozen=True)
class Edit:
    """Edit of a gesture plan: its kind and values."""

    kind: str
    """A key of `EDIT_KINDS`."""
    values: Values

    def as_json(self) -> dict[str, Any]:
        """Return the edit as JSON, as it was received."""
        return {"do": self.kind, **self.values}


@dataclass(frozen=True)
class AlternativeEdits:
    """Alternative to an edit that cannot be done."""

    label: str
    edits: tuple[Edit, ...]


@dataclass(frozen=True)
class EditKind:
    """Kind of edit: its function, and the validator of its values."""

    validator: TypeAdapter
    apply: ApplyEdit


@dataclass(frozen=True, kw_only=True)
class PlanEditRequest:
    """Request to generate a motion of a run again with an edited plan."""

    run: Path
    """Folder of the run, to which the motion is added."""
    weights: Path
    """Folder of trained systems."""
    source_row: str
    """Name of the row with the plan to edit."""
    edits: tuple[Edit, ...] = ()
    """Edits in order; without any, the row is only prepared for editing."""
    max_speech_s: float = 600.0
    """Maximum length of the speech (s)."""
    body: Path | None = None
    """Body of the tracked point; None for the open one."""


@dataclass(frozen=True)
class EditResult:
    """Result of a plan edit."""

    take_number: int
    """Number of the take; 0 if the row was only prepared."""
    notes: tuple[str, ...] = ()
    """Sentences on corrections, or on why the edit was not done if there are alternatives."""
    suggestions: tuple[AlternativeEdits, ...] = ()


def parse_edits(message: object) -> tuple[Edit, ...]:
    """Parse a list of edits as app/page/web/player/editing.js writes it; may raise RunError."""
    if not isinstance(message, list) or len(message) > MAX_EDITS:
        raise RunError(f"Edits must be sent as a list of at most {MAX_EDITS}.")
    return tuple(_edit(one) for one in message)


def apply_edits(plan: GesturePlan, edits: Sequence[Edit], words: Words) -> PlanResult:
    """Apply all edits in order, and return the plan with notes on corrections.

    The words of the speech are those to which edits refer by index. Raises PlanError or RunError if
    one edit cannot be done; then none is.
    """
    done = PlanResult(plan)
    for edit in edits:
        done = done.then(lambda new, one=edit: EDIT_KINDS[one.kind].apply(new, one.values, words))
    return done


def find_alternatives(plan: GesturePlan, edit: Edit, words: Words) -> tuple[AlternativeEdits, ...]:
    """Return alternatives to an edit that has no time for its gesture; empty if it can be done.

    They are the nearest free place, and the replacement of the gesture in the way, where possible.
    """

    def can_be(*edits: Edit) -> bool:
        try:
            apply_edits(plan, edits, words)
        except (PlanError, RunError):
            return False
        return True

    try:
        apply_edits(plan, (edit,), words)
    except NoRoomError as error:
        suggestions = []
        if edit.kind in ("add", "move"):
            stroke_end_s, _ = _place(edit.values, words)
            steps = range(1, 1 + round(plan.duration_s / STEP_S))
            places = (
                round(stroke_end_s + by * STEP_S, 3) for step in steps for by in (step, -step)
            )
            others = {name: value for name, value in edit.values.items() if name != "word"}
            moved = (Edit(edit.kind, {**others, "at": at}) for at in places if at >= 0)
            suggestion = next((each for each in moved if can_be(each)), None)
            if suggestion is not None:
                suggestions.append(
                    AlternativeEdits(
                        f"Nearest free time, {suggestion.values['at']:.1f} s", (suggestion,)
                    )
                )
        if error.gesture is not None:
            one = {"side": error.gesture.side, "lands": error.gesture.stroke_end_s}
            gesture_kind = repr(error.kind.replace("_", " ")) if error.kind else "existing"
            instead = AlternativeEdits(
                f"Replace the {gesture_kind} gesture", (Edit("delete", one), edit)
            )
            suggestions += [instead] if can_be(*instead.edits) else []
        return tuple(suggestions)
    except (PlanError, RunError):
        pass
    return ()


def check_plan_matches_speech(plan: GesturePlan, duration_s: float) -> GesturePlan:
    """Return the plan if it has the length of the speech; raises PlanError otherwise."""
    if abs(plan.duration_s - duration_s) > 0.5:
        raise PlanError(
            f"The plan lasts {plan.duration_s:.2f} s and the speech {duration_s:.2f} s; use a plan "
            "of this speech."
        )
    return plan


def _edit(message: object) -> Edit:
    if not isinstance(message, dict):
        raise RunError("An edit must be an object with the kind of edit in 'do'.")
    do = message.get("do")
    kind = EDIT_KINDS.get(do) if isinstance(do, str) else None
    if not isinstance(do, str) or kind is None:
        kinds = ", ".join(EDIT_KINDS)
        raise RunError(
            f"There is no kind of edit {printable(str(do))[:40]!r}; choose from {kinds}."
        )
    try:
        values = kind.validator.validate_python({k: v for k, v in message.items() if k != "do"})
    except ValidationError as error:
        raise RunError(f"The edit {do!r} cannot be read: {first_error_clause(error)}.") from error
    if do in ("move", "add") and ("at" in values) == ("word" in values):
        raise RunError(f"The edit {do!r} needs either a time or a word.")
    return Edit(do, values)


def _gesture(values: Values) -> GestureKey:
    return GestureKey(values["side"], values["lands"])


def _place(values: Values, words: Words) -> tuple[float, str | None]:
    """Return the stroke end (s), and its word if the edit names one."""
    if "word" not in values:
        return values["at"], None
    if values["word"] >= len(words):
        raise RunError(f"The transcript has only {len(words)} words; choose one of them.")
    word = words[values["word"]]
    return editing.default_stroke_end_on_word(word), word.text.lower()[:80]


def _word_at(words: Words, at_s: float) -> str:
    """Return the word at a time, or ""."""
    return next((each.text.lower()[:80] for each in words if each.start_s <= at_s < each.end_s), "")


def _of_both(change: Callable[..., PlanResult], *names: str) -> ApplyEdit:
    """Make an edit that changes a gesture, and the other hand's part in it."""

    def does(plan: GesturePlan, message: Values, words: Words) -> PlanResult:
        gesture, values = _gesture(message), [message[name] for name in names]
        partner = editing.other_hand_gesture(plan, gesture)
        done = change(plan, gesture, *values)
        return done if partner is None else done.then(lambda new: change(new, partner, *values))

    return does


def _move(plan: GesturePlan, values: Values, words: Words) -> PlanResult:
    stroke_end_s, word = _place(values, words)
    if word is None:
        word = _word_at(words, stroke_end_s)
    by_s = stroke_end_s - values["lands"]
    moved = _of_both(
        lambda each, one: editing.move_gesture(each, one, one.stroke_end_s + by_s, word)
    )
    return moved(plan, values, words)


def _add(plan: GesturePlan, values: Values, words: Words) -> PlanResult:
    stroke_end_s, word = _place(values, words)
    return editing.add_gesture(plan, values["kind"], stroke_end_s, values.get("hands"), word or "")


def _end(plan: GesturePlan, values: Values, words: Words) -> PlanResult:
    """Move the end of a phase, of both hands if they share it, and update words of strokes."""
    side, by_s = cast(Side, values["side"]), values["at"] - values["ends"]
    done = editing.move_phase_end(plan, side, values["ends"], values["at"])
    also_s = editing.other_hand_phase_end(plan, side, values["ends"])
    if also_s is not None:
        other = SIDES[1 - SIDES.index(side)]
        done = done.then(lambda new: editing.move_phase_end(new, other, also_s, also_s + by_s))
    new = done.plan
    for hand in SIDES:
        ends = [one.end_s for one in plan.hand(hand) if one.phase == "stroke"]
        phases = tuple(
            replace(one, word=_word_at(words, one.end_s))
            if one.phase == "stroke"
            and all(abs(one.end_s - end_s) >= TIME_TOLERANCE_S for end_s in ends)
            else one
            for one in new.hand(hand)
        )
        new = new.with_hand(hand, phases)
    return replace(done, plan=new)


def _look(plan: GesturePlan, values: Values, words: Words) -> PlanResult:
    end_s = min(plan.duration_s, values["at"] + values.get("lasts", LOOK_S))
    if end_s <= values["at"]:
        raise PlanError(
            f"The speech ends at {plan.duration_s:.2f} s; a gaze shift must begin before that."
        )
    return editing.add_event(plan, Gaze(values["at"], end_s, values["yaw"], values["pitch"]))


def _remove(plan: GesturePlan, values: Values, words: Words) -> PlanResult:
    def off(event: SpanEvent | PointEvent) -> float:
        return abs(event.start_s - values["at"])

    events = getattr(plan, values["list"])
    nearest = min(events, key=off, default=None)
    if nearest is None or off(nearest) >= AT_S:
        raise PlanError(f"The plan's list {values['list']!r} has no event at {values['at']:.2f} s.")
    left = tuple(event for event in events if event is not nearest)
    return PlanResult(replace(plan, **{values["list"]: left}))


def _style(plan: GesturePlan, values: Values, words: Words) -> PlanResult:
    numbers = {name: value for name, value in values.items() if name != "excite"}
    return StyleChange(numbers, arousal=values.get("excite", 0.0)).apply(plan, words)


def _plan(plan: GesturePlan, values: Values, words: Words) -> PlanResult:
    """Replace the whole plan by another one of the same length."""
    name = f"plan{printable(Path(values['name']).suffix.lower())[:12]}"
    check_plan_suffix(Path(name))
    read = parse_plan(values["text"].encode("utf-8", "replace"), name)
    return PlanResult(check_plan_matches_speech(read.plan, plan.duration_s), read.notes)


_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
_Second = Annotated[float, Field(ge=0, le=3600, strict=True)]


def _kind(does: ApplyEdit, **values: Any) -> EditKind:
    values_type = with_config(_STRICT)(TypedDict("Values", values))  # pyright: ignore
    return EditKind(TypeAdapter(values_type), does)


def _within(least: float, most: float) -> Any:
    return Annotated[float, Field(ge=least, le=most)]


def _text(most: int) -> Any:
    return Annotated[str, Field(max_length=most)]


_one: dict[str, Any] = {"side": Side, "lands": _Second}
_where: dict[str, Any] = {
    "at": NotRequired[_Second], "word": NotRequired[Annotated[int, Field(ge=0, lt=200_000)]],
}  # fmt: skip
EDIT_KINDS: Mapping[str, EditKind] = {
    "move": _kind(_move, **_one, **_where),
    "delete": _kind(_of_both(editing.delete_gesture), **_one),
    "add": _kind(_add, kind=_text(40), hands=NotRequired[Hands], **_where),
    "hands": _kind(
        lambda plan, values, *_: editing.change_hands(plan, _gesture(values), values["hands"]),
        **_one, hands=Hands,
    ),
    "hold": _kind(_of_both(editing.set_hold, "hold"), **_one, hold=_within(0, 60)),
    "end": _kind(_end, side=Side, ends=_Second, at=_Second),
    "size": _kind(_of_both(editing.scale_gesture, "size"), **_one, size=_within(0.1, 4)),
    "height": _kind(_of_both(editing.raise_gesture, "by"), **_one, by=_within(-1, 1)),
    "speed": _kind(_of_both(editing.scale_gesture_speed, "speed"), **_one, speed=_within(0.2, 5)),
    "nod": _kind(
        lambda plan, values, *_: editing.add_event(
            plan, Nod(values["at"], values.get("depth", NOD_DEG))),
        at=_Second, depth=NotRequired[_within(1, 30)],
    ),
    "blink": _kind(
        lambda plan, values, *_: editing.add_event(plan, Blink(values["at"])), at=_Second
    ),
    "look": _kind(
        _look, at=_Second, lasts=NotRequired[_within(0.2, 60)], yaw=_within(-60, 60),
        pitch=_within(-40, 40),
    ),
    "remove": _kind(_remove, list=Literal["nods", "looks", "blinks"], at=_Second),
    "style": _kind(
        _style, **{name: NotRequired[_within(*limits)] for name, limits in LIMITS.items()},
        excite=NotRequired[_within(-1, 1)],
    ),
    "plan": _kind(_plan, name=_text(200), text=_text(MAX_PLAN_CHARACTERS)),
}  # fmt: skip
