"""A plan as annotators write it down, in named tiers, and the plan that such tiers tell.

Our own tiers tell all of a plan. Those of other habits are understood as far as their names and
labels can be: a tier for each phase, short labels, no places; what was made of them is said.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

from conventions.rates import FPS
from model.plan.palette import REST_PLACE, Place, usual_goal
from model.plan.plan import (
    PHASES,
    SIDES,
    Blink,
    Brow,
    GesturePlan,
    HandPhase,
    Look,
    Nod,
    Phase,
    PlanError,
    Planted,
    Side,
    Smile,
    Stand,
)

PHASE_TIER, KIND_TIER, WORD_TIER, GOAL_TIER = "gesture", "kind", "word", "goal"
_SAME_MOMENT_S = 0.5 / FPS
APEX_S = 0.08
"""A stroke and the apex that tells its word are at most so far apart."""
USUAL_NOD_DEG, USUAL_BROW, USUAL_SMILE = 4.0, 0.5, 0.4
"""Of those marked without a number."""
MAX_ROWS = 100_000
_FEW = 6


@dataclass(frozen=True)
class Row:
    """What a tier says of some time; of a moment where both times are the same."""

    start_s: float
    end_s: float
    label: str

    @property
    def middle_s(self) -> float:
        if self.start_s == self.end_s:
            return self.start_s
        return round(0.5 * (self.start_s + self.end_s), 4)


@dataclass(frozen=True)
class NamedTier:
    """Rows under one name, in time."""

    name: str
    rows: tuple[Row, ...]
    has_points: bool = False
    """Its rows are moments."""
    parent: str = ""
    """The tier whose rows these tell more of, one for one of some of them."""


@dataclass(frozen=True)
class PlanRead:
    """A plan from a file, and what a person should know of how it was taken."""

    plan: GesturePlan
    notes: tuple[str, ...] = ()


def tiers_of(plan: GesturePlan) -> tuple[NamedTier, ...]:
    """All that the plan tells. Times and numbers are rounded to four decimals.

    Raises:
        PlanError: if events of one list overlap: no tier can hold them.
    """
    tiers: list[NamedTier] = []
    for side in SIDES:
        phases, name = plan.hand(side), f"{PHASE_TIER}_{side}"

        def told(
            what: str,
            label: Callable[[HandPhase], str],
            side: Side = side,
            name: str = name,
        ) -> NamedTier:
            rows = (_row(phase, label(phase)) for phase in plan.hand(side))
            return NamedTier(f"{what}_{side}", tuple(r for r in rows if r.label), parent=name)

        tiers += [
            NamedTier(name, tuple(_row(phase, phase.phase) for phase in phases)),
            told(KIND_TIER, lambda phase: phase.kind),
            told(WORD_TIER, lambda phase: phase.word),
            told(GOAL_TIER, lambda phase: _numbered(phase.goal)),
        ]
    moments: Mapping[str, Iterable[tuple[float, str]]] = {
        "nods": ((nod.time_s, _numbered([nod.depth_deg])) for nod in plan.nods),
        "brows": ((brow.time_s, _numbered([brow.height])) for brow in plan.brows),
        "blinks": ((blink.time_s, "shut") for blink in plan.blinks),
    }
    tiers += [
        NamedTier(
            name,
            tuple(Row(round(at, 4), round(at, 4), label) for at, label in sorted(rows)),
            has_points=True,
        )
        for name, rows in moments.items()
    ]
    tiers += [
        NamedTier("gaze", _in_turn("looks", [
            _row(look, _numbered([look.yaw_deg, look.pitch_deg])) for look in plan.looks])),
        NamedTier("smile", _in_turn("smiles", [
            _row(smile, _numbered([smile.size])) for smile in plan.smiles])),
        NamedTier("weight", _in_turn("stands", [_row(one, one.leg) for one in plan.stands])),
        *(
            NamedTier(f"foot_{side}", _in_turn("planted feet", [
                _row(one, "planted") for one in plan.planted if one.foot == side]))
            for side in SIDES
        ),
    ]  # fmt: skip
    return tuple(tiers)


def _row(event: HandPhase | Look | Smile | Stand | Planted, label: str) -> Row:
    return Row(round(event.start_s, 4), round(event.end_s, 4), label)


def _in_turn(name: str, rows: list[Row]) -> tuple[Row, ...]:
    rows = sorted(rows, key=lambda row: row.start_s)
    for before, after in pairwise(rows):
        if after.start_s < before.end_s:
            raise PlanError(
                f"The plan's {name} overlap at {after.start_s:.2f} s, which a tier cannot hold; "
                "part them, or write the plan as JSON."
            )
    return tuple(rows)


def _numbered(numbers: Iterable[float]) -> str:
    return " ".join(f"{number:.4f}" for number in numbers)


Told = TypeVar("Told")
_LEFT, _RIGHT, _BOTH = {"left", "lh", "l"}, {"right", "rh", "r"}, {"both", "bh", "bimanual"}
_SPEECH = {"words", "phones", "accents", "listening", "apex", "transcript", "utterance", "speech"}
_GESTURES = {PHASE_TIER, "gestures", "phrase", "phrases", "hand"}
_PHASE_WORDS: Mapping[str, Phase] = {
    "rest": "rest", "rests": "rest", "resting": "rest",
    "preparation": "preparation", "preparations": "preparation", "prep": "preparation",
    "preps": "preparation",
    "stroke": "stroke", "strokes": "stroke",
    "hold": "hold", "holds": "hold", "psh": "hold",
    "beat": "beat", "beats": "beat", "baton": "beat",
    "retraction": "retraction", "retractions": "retraction", "retract": "retraction",
    "retr": "retraction", "ret": "retraction", "recovery": "retraction",
}  # fmt: skip
_LETTERS: Mapping[str, Phase] = {
    "p": "preparation", "s": "stroke", "h": "hold", "b": "beat", "r": "retraction",
}  # fmt: skip
_WHAT: Mapping[str, set[str]] = {
    "nods": {"nod", "nods"},
    "gaze": {"gaze", "look", "looks"},
    "brows": {"brow", "brows", "eyebrow", "eyebrows"},
    "smile": {"smile", "smiles"},
    "blinks": {"blink", "blinks"},
    "weight": {"weight", "stand", "stands"},
    "foot": {"foot", "feet"},
}


def plan_of_tiers(tiers: Sequence[NamedTier], duration_s: float) -> PlanRead:
    """The plan that tiers tell, by their names: ours, or others that speak of hands and phases.

    Raises:
        PlanError: if no tier tells what a hand does, or what they tell is no plan.
    """
    named = _Named(tiers)
    if not named.tells_hands:
        found = ", ".join(tier.name[:40] for tier in tiers[:_FEW]) or "no tier"
        raise PlanError(
            f"No tier tells what a hand does: name one gesture_right or gesture_left; found "
            f"{found}."
        )
    hands = {side: named.hand(side) for side in SIDES}
    plan = GesturePlan(
        duration_s=duration_s,
        left=hands["left"],
        right=hands["right"],
        nods=named.told("nods", lambda r: Nod(r.middle_s, _first(r, USUAL_NOD_DEG))),
        looks=named.told("gaze", lambda r: Look(r.start_s, r.end_s, *_direction(r))),
        brows=named.told("brows", lambda r: Brow(r.middle_s, _height(r))),
        smiles=named.told("smile", lambda r: Smile(r.start_s, r.end_s, _first(r, USUAL_SMILE))),
        blinks=named.told("blinks", lambda r: Blink(r.middle_s)),
        stands=named.told("weight", _stand),
        planted=tuple(
            Planted(row.start_s, row.end_s, side) for side in SIDES for row in named.feet[side]
        ),
    )
    return PlanRead(plan, tuple(named.notes))


class _Named:
    """Tiers by what their names say they tell."""

    def __init__(self, tiers: Sequence[NamedTier]) -> None:
        self.notes: list[str] = []
        self.phases: dict[Side, list[tuple[Row, Phase, str]]] = {side: [] for side in SIDES}
        self.tells_hands = False
        """Some tier is there for what hands do, be it empty."""
        self.feet: dict[Side, list[Row]] = {side: [] for side in SIDES}
        self._more: dict[tuple[str, Side], list[Row]] = {}
        self._at_end: dict[tuple[str, Side], dict[float, str]] = {}
        self._body: dict[str, list[Row]] = {}
        marks = [
            (row.end_s, row.label.split(" "))
            for tier in tiers
            if tier.name == "apex"
            for row in tier.rows
        ]
        self._apexes = {
            side: {at: mark[2] for at, mark in marks if len(mark) == 3 and mark[1] == side}
            for side in SIDES
        }
        left_out: list[str] = []
        proper: list[tuple[NamedTier, tuple[Side, ...], Phase | None]] = []
        phrases: list[tuple[NamedTier, tuple[Side, ...], Phase | None]] = []
        for tier in tiers:
            if len(tier.rows) > MAX_ROWS:
                raise PlanError(f"Tier {tier.name[:40]} has over {MAX_ROWS} rows.")
            words = _words(tier.name)
            sides = _sides(words)
            what = next((name for name, signs in _WHAT.items() if signs & words), None)
            phase: Phase | None = next(
                (p for word, p in _PHASE_WORDS.items() if word in words), None
            )
            if _SPEECH & words:
                continue
            if what == "foot":
                for side in sides:
                    self.feet[side] += tier.rows
            elif what:
                self._body.setdefault(what, []).extend(tier.rows)
            elif sides and words & {GOAL_TIER, "goals"}:
                self._tell_more(GOAL_TIER, sides, tier.rows)
            elif sides and words & {WORD_TIER, "lexical", "affiliate"}:
                self._tell_more(WORD_TIER, sides, tier.rows)
            elif words & {KIND_TIER, "type", "shape"}:
                self._tell_more(KIND_TIER, sides or ("right",), tier.rows)
            elif phase or words & {"phase", "phases"} or (words & _GESTURES and _has_phases(tier)):
                proper.append((tier, sides, phase))
            elif words & _GESTURES and "unit" not in words:
                phrases.append((tier, sides, None))
            elif tier.rows:
                left_out.append(tier.name)
        if proper:  # then phrases tell what kind they are of
            for tier, sides, _ in phrases:
                self._tell_more(KIND_TIER, sides or ("right",), tier.rows)
        self.tells_hands = bool(proper or phrases)
        self._take_phases(proper or phrases)
        if left_out:
            self.notes.append(f"Left out, for they tell of no plan: {_listed(left_out)}.")

    def _take_phases(
        self, tiers: Sequence[tuple[NamedTier, tuple[Side, ...], Phase | None]]
    ) -> None:
        strokes = set()
        for tier, sides, phase in tiers:
            if not sides:
                self.notes.append(
                    f"Tier {tier.name[:40]} names no hand; it was taken for the right."
                )
            for row in tier.rows:
                name, kind = (phase, row.label) if phase else _phase_of(row.label)
                if name is None:
                    strokes.add(row.label)
                    name, kind = "stroke", row.label.lower()
                for side in sides or ("right",):
                    self.phases[side].append((row, name, kind))
        if strokes:
            self.notes.append(
                f"Taken as kinds of strokes: {_listed(sorted(strokes))}; phases are "
                f"{', '.join(PHASES)}."
            )

    def _tell_more(self, what: str, sides: Iterable[Side], rows: Iterable[Row]) -> None:
        for side in sides:
            self._more.setdefault((what, side), []).extend(rows)
            ends = {round(row.end_s, 4): row.label for row in rows}
            self._at_end.setdefault((what, side), {}).update(ends)

    def told(self, what: str, made: Callable[[Row], Told]) -> tuple[Told, ...]:
        """What is told of the body, in time."""
        rows = sorted(self._body.get(what, []), key=lambda row: row.start_s)
        return tuple(made(row) for row in rows)

    def hand(self, side: Side) -> tuple[HandPhase, ...]:
        """A hand's phases with their places; where none are told, with usual ones."""
        rows = sorted(self.phases[side], key=lambda found: found[0].start_s)
        kinds = [
            kind or self._of(KIND_TIER, side, row) or self._around(KIND_TIER, side, row)
            for row, _, kind in rows
        ]
        goals = self._goals(side, [row for row, _, _ in rows])
        if rows and all(goal is None for goal in goals):
            self.notes.append(
                f"No places are told for the {side} hand; it goes where such gestures usually do."
            )
        found: list[HandPhase] = []
        before = REST_PLACE
        for k, (row, phase, _) in enumerate(rows):
            goal = goals[k]
            if goal is None:
                later = range(k, len(rows))
                stroke = next((j for j in later if rows[j][1] == "stroke"), k)
                kind = kinds[k] or kinds[stroke]
                goal = usual_goal(phase, kind, before, goals[stroke])
            word = self._of(WORD_TIER, side, row) or self._landed(side, row, phase)
            found.append(HandPhase(row.start_s, row.end_s, phase, goal, kinds[k], word))
            before = goal
        return tuple(found)

    def _goals(self, side: Side, rows: Sequence[Row]) -> list[Place | None]:
        """That which is told for a row's end, or else the last one reached by then."""
        told = sorted(self._more.get((GOAL_TIER, side), []), key=lambda row: row.end_s)
        goals = {round(row.end_s, 4): _place(row) for row in told}
        times = list(goals)
        found: list[Place | None] = []
        for row in rows:
            own = goals.get(round(row.end_s, 4))
            if own is None and goals:
                reached = bisect_right(times, row.end_s + _SAME_MOMENT_S)
                own = goals[times[max(reached - 1, 0)]]
            found.append(own)
        return found

    def _of(self, what: str, side: Side, row: Row) -> str:
        return self._at_end.get((what, side), {}).get(round(row.end_s, 4), "")

    def _around(self, what: str, side: Side, row: Row) -> str:
        """Of the row of some longer tier in which this one lies."""
        rows = self._more.get((what, side), [])
        around = (more for more in rows if more.start_s <= row.middle_s < more.end_s)
        return next((more.label for more in around), "")

    def _landed(self, side: Side, row: Row, phase: Phase) -> str:
        words = self._apexes[side]
        if phase != "stroke" or not words:
            return ""
        at = min(words, key=lambda at: abs(at - row.end_s))
        return words[at] if abs(at - row.end_s) < APEX_S else ""


def _words(name: str) -> set[str]:
    """The words of a tier's name, however they are joined: ``RH_Phase``, ``rightHand-Stroke``."""
    parted = re.sub(r"([a-z])([A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", r"\1 \2", name[:200])
    return set(re.findall(r"[a-z]+", parted.lower()))


def _has_phases(tier: NamedTier) -> bool:
    """Most of its labels tell phases."""
    return 2 * sum(_phase_of(row.label)[0] is not None for row in tier.rows) > len(tier.rows)


def _sides(words: set[str]) -> tuple[Side, ...]:
    is_left, is_right = bool(words & _LEFT), bool(words & _RIGHT)
    if words & _BOTH or (is_left and is_right):
        return SIDES
    return ("left",) if is_left else ("right",) if is_right else ()


def _phase_of(label: str) -> tuple[Phase | None, str]:
    """Phase and kind that a label tells: ``stroke offer``, ``Prep``, ``post-stroke hold``."""
    name, _, kind = label.partition(" ")
    if name in PHASES:
        return PHASES[PHASES.index(name)], kind
    words = re.findall(r"[a-z]+", label.lower())
    if len(words) == 1 and words[0] in _LETTERS:
        return _LETTERS[words[0]], ""
    known: list[Phase] = [_PHASE_WORDS[word] for word in words if word in _PHASE_WORDS]
    return known[-1] if known else None, ""  # the last: "post-stroke hold"


def _first(row: Row, usual: float) -> float:
    return (_numbers(row) or [usual])[0]


def _numbers(row: Row) -> list[float]:
    """The numbers that a label begins with."""
    numbers: list[float] = []
    for part in row.label.split():
        try:
            number = float(part)
        except ValueError:
            break
        if not math.isfinite(number):
            raise PlanError(f"The label {row.label[:40]!r} at {row.start_s:g} s is not finite.")
        numbers.append(number)
    return numbers


def _place(row: Row) -> Place:
    numbers = _numbers(row)
    if len(numbers) != 3:
        raise PlanError(
            f"The goal {row.label[:40]!r} at {row.end_s:g} s is no three numbers: metres out, up "
            "and forward of the chest."
        )
    return numbers[0], numbers[1], numbers[2]


_DIRECTIONS: Mapping[str, tuple[float, float]] = {
    "left": (12.0, 0.0),
    "right": (-12.0, 0.0),
    "up": (0.0, -8.0),
    "down": (0.0, 10.0),
    "away": (14.0, 5.0),
}


def _direction(row: Row) -> tuple[float, float]:
    numbers = _numbers(row)
    if len(numbers) >= 2:
        return numbers[0], numbers[1]
    words = _words(row.label)
    return next((way for name, way in _DIRECTIONS.items() if name in words), (0.0, 0.0))


def _height(row: Row) -> float:
    usual = -USUAL_BROW if _words(row.label) & {"frown", "lower", "lowered"} else USUAL_BROW
    return _first(row, usual)


def _stand(row: Row) -> Stand:
    words = _words(row.label)
    for leg in (*SIDES, "both"):
        if leg in words:
            return Stand(row.start_s, row.end_s, leg)
    raise PlanError(f"The weight {row.label[:40]!r} at {row.start_s:g} s is not left, right, both.")


def _listed(names: Sequence[str]) -> str:
    few = ", ".join(repr(name[:40]) for name in names[:_FEW])
    return few if len(names) <= _FEW else f"{few} and {len(names) - _FEW} more"
