"""Gesture plans as annotation tiers: our own, and those of other projects.

Our tiers hold all of a plan. Those of other projects are interpreted by their names and labels (a
tier for each phase, short labels, no goals); notes say how.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, TypeVar

from conventions.rates import FPS
from model.plan.annotation_files import Interval, NamedTier
from model.plan.kinds import REST_POSITION, Position, default_goal
from model.plan.plan import (
    PHASES,
    SIDES,
    Blink,
    Brow,
    FootContact,
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
)

PHASE_TIER, KIND_TIER, WORD_TIER, GOAL_TIER = "gesture", "kind", "word", "goal"
_PHRASES, _APEX, _SPEECH = "phrase", "apex", "speech"
"""Contents of tiers that are converted to kinds or strokes, name words, or belong to no plan."""
_SAME_MOMENT_S = 0.5 / FPS
APEX_TOLERANCE_S = 0.08
"""Largest time between a stroke's end and the apex that names its word (s)."""
DEFAULT_NOD_DEG, DEFAULT_BROW, DEFAULT_SMILE = 4.0, 0.5, 0.4
"""Defaults for nods (degrees), brows and smiles without a number."""
MAX_ROWS = 100_000
_MAX_LISTED = 6


def plan_to_tiers(plan: GesturePlan, *, for_praat: bool = False) -> tuple[NamedTier, ...]:
    """Convert a plan to tiers, with times and numbers rounded to four decimals.

    Praat lacks parent tiers: for it, phases and kinds share a label, and words and goals are points
    at the phases' ends. Raises PlanError if events of a list overlap: no tier can hold them.
    """
    tiers: list[NamedTier] = []
    for side in SIDES:
        name, phases = f"{PHASE_TIER}_{side}", plan.hand(side)
        more = {
            KIND_TIER: [phase.kind for phase in phases],
            WORD_TIER: [phase.word for phase in phases],
            GOAL_TIER: [_numbered(*phase.goal) for phase in phases],
        }
        kinds = more.pop(KIND_TIER) if for_praat else [""] * len(phases)
        labels = [f"{p.phase} {kind}".rstrip(" ") for p, kind in zip(phases, kinds, strict=True)]
        tiers.append(NamedTier(name, tuple(map(_row, phases, labels))))
        for what, texts in more.items():
            labelled = [(p, text) for p, text in zip(phases, texts, strict=True) if text]
            rows = tuple(_row(phase, text, for_praat) for phase, text in labelled)
            tiers.append(NamedTier(f"{what}_{side}", rows, for_praat, "" if for_praat else name))
    of_body: tuple[tuple[str, Sequence[Any], Callable[[Any], str]], ...] = (
        ("nods", plan.nods, lambda nod: _numbered(nod.depth_deg)),
        ("brows", plan.brows, lambda brow: _numbered(brow.height)),
        ("blinks", plan.blinks, lambda _: "shut"),
        ("gaze", plan.looks, lambda look: _numbered(look.yaw_deg, look.pitch_deg)),
        ("smile", plan.smiles, lambda smile: _numbered(smile.size)),
        ("weight", plan.stands, lambda stand: stand.leg),
        ("foot_left", [p for p in plan.planted if p.foot == "left"], lambda _: "planted"),
        ("foot_right", [p for p in plan.planted if p.foot == "right"], lambda _: "planted"),
    )
    for name, events, label in of_body:
        rows = sorted((_row(each, label(each)) for each in events), key=lambda row: row.start_s)
        for before, after in pairwise(rows):
            if after.start_s < before.end_s:
                raise PlanError(
                    f"The plan's events in {name} overlap at {after.start_s:.2f} s, which is not "
                    "possible in a tier; change their times, or write the plan as JSON."
                )
        tiers.append(NamedTier(name, tuple(rows), name in ("nods", "brows", "blinks")))
    return tuple(tiers)


def _row(event: SpanEvent | PointEvent, label: str, is_point: bool = False) -> Interval:
    start_s = event.end_s if is_point else event.start_s
    return Interval(round(start_s, 4), round(event.end_s, 4), label)


def _numbered(*numbers: float) -> str:
    return " ".join(f"{number:.4f}" for number in numbers)


_LEFT, _RIGHT, _BOTH = {"left", "lh", "l"}, {"right", "rh", "r"}, {"both", "bh", "bimanual"}
_SPEECH_WORDS = {
    "words",
    "phones",
    "accents",
    "listening",
    "apex",
    "transcript",
    "utterance",
    "speech",
}
_GESTURES = {PHASE_TIER, "gestures", "phrase", "phrases", "hand"}
_PHASES: Mapping[str, Phase] = {
    "rest": "rest", "prep": "preparation", "stroke": "stroke", "hold": "hold", "psh": "hold",
    "beat": "beat", "baton": "beat", "ret": "retraction", "recover": "retraction",
}  # fmt: skip
"""Phases by word stems; the next tables are for body tiers and more hand tiers."""
_PHASE_LETTERS: Mapping[str, Phase] = {
    "p": "preparation", "s": "stroke", "h": "hold", "b": "beat", "r": "retraction",
}  # fmt: skip
_BODY: Mapping[str, str] = {
    "nod": "nods", "gaze": "gaze", "look": "gaze", "brow": "brows", "eyebrow": "brows",
    "smile": "smile", "blink": "blinks", "weight": "weight", "stand": "weight", "foot": "foot",
    "feet": "foot",
}  # fmt: skip
_EXTRA_TIERS: Mapping[str, str] = {
    "goal": GOAL_TIER, "word": WORD_TIER, "lexical": WORD_TIER, "affiliate": WORD_TIER,
    "kind": KIND_TIER, "type": KIND_TIER, "shape": KIND_TIER,
}  # fmt: skip
_TYPES = (
    "iconic", "metaphor", "deictic", "point", "emblem", "symbol", "represent", "pragmatic",
    "interact", "cohesive",
)  # fmt: skip
"""Stems of gesture types: next to them a beat is a gesture (McNeill), not this format's phase."""
_NO_GESTURE = ("adapt", "unclear", "uncertain", "unknown", "none", "fidget", "touch")
"""Stems of labels for what is no gesture."""
_OURS = frozenset(f"{PHASE_TIER}_{side}" for side in SIDES)
_T = TypeVar("_T", bound=str)


def _match_stems(words: Iterable[str], stems: Mapping[str, _T]) -> list[_T]:
    """Return the meanings of the words that start with one of the stems, in order."""
    return [kind for word in words for stem, kind in stems.items() if word.startswith(stem)]


_Rows = defaultdict[tuple[str, str], list[Interval]]
"""Rows by content and by hand or foot; "" for the whole body."""


@dataclass(frozen=True)
class _Meaning:
    """Interpretation of a tier by its name."""

    content: str
    """Hand tier, list of events, `_PHRASES`, `_APEX` or `_SPEECH`; empty if it is not known."""
    sides: tuple[Side, ...] = ()
    """Hands or feet in its name."""
    phase: Phase | None = None
    """Phase of all its rows; None if labels name the phases."""


def tiers_to_plan(tiers: Sequence[NamedTier], duration_s: float) -> PlanResult:
    """Convert our tiers, or others that name hands and phases, to a plan; raises PlanError."""
    _check_tiers(tiers)
    meanings = [(tier, _meaning(tier)) for tier in tiers]
    rows: _Rows = defaultdict(list)
    for tier, meaning in meanings:
        for side in _places_of(meaning):
            rows[meaning.content, side] += tier.rows
    of_phases, phrases = (
        [(tier, meaning) for tier, meaning in meanings if meaning.content == content]
        for content in (PHASE_TIER, _PHRASES)
    )
    if not of_phases and not phrases:
        tier_names = ", ".join(tier.name[:40] for tier in tiers[:_MAX_LISTED]) or "none"
        raise PlanError(
            "No tier holds the gestures of a hand; rename one to gesture_right or gesture_left "
            f"(tiers: {tier_names})."
        )
    for tier, meaning in phrases if of_phases else ():
        for side in _hands_of(meaning):
            rows[KIND_TIER, side] += tier.rows
    notes = _add_phases(of_phases or phrases, rows)
    if unknown := [tier.name for tier, meaning in meanings if tier.rows and not meaning.content]:
        notes.append(f"Ignored tiers with unknown names: {_listed(unknown)}.")
    left, right = (_hand(rows, side, notes) for side in SIDES)
    return PlanResult(_plan(duration_s, left, right, rows), tuple(notes))


def _check_tiers(tiers: Sequence[NamedTier]) -> None:
    names = [tier.name for tier in tiers if tier.rows]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise PlanError(f"There are two tiers called {twice[:40]}; rename or delete one of them.")
    for tier in tiers:
        if len(tier.rows) > MAX_ROWS:
            raise PlanError(f"Tier {tier.name[:40]} exceeds the limit of {MAX_ROWS} annotations.")


def _meaning(tier: NamedTier) -> _Meaning:
    """Interpret a tier by its name, and by its labels where these decide."""
    words = _words(tier.name)
    sides = _sides(words)
    (body, *_), (more, *_) = (_match_stems(words, stems) or [""] for stems in (_BODY, _EXTRA_TIERS))
    phase: Phase | None = next(iter(_match_stems(words, _PHASES)), None)
    if _SPEECH_WORDS & words:
        return _Meaning(_APEX if tier.name == _APEX else _SPEECH)
    if body:
        return _Meaning(body, sides)
    if more and (sides or more == KIND_TIER):
        return _Meaning(more, sides)
    if phase or words & {"phase", "phases"} or (words & _GESTURES and _has_phases(tier)):
        return _Meaning(PHASE_TIER, sides, phase)
    if words & _GESTURES and "unit" not in words:
        return _Meaning(_PHRASES, sides)
    return _Meaning("")


def _places_of(meaning: _Meaning) -> tuple[str, ...]:
    """Return the hands, the feet or "" for the whole body, under which rows are stored as read."""
    if meaning.content == "foot":
        return meaning.sides
    if meaning.content in (GOAL_TIER, WORD_TIER, KIND_TIER):
        return _hands_of(meaning)
    return ("",) if meaning.content in (_APEX, *_BODY.values()) else ()


def _hands_of(meaning: _Meaning) -> tuple[Side, ...]:
    """Return the hands of a tier, the right if its name has none."""
    return meaning.sides or ("right",)


def _add_phases(tiers: Sequence[tuple[NamedTier, _Meaning]], rows: _Rows) -> list[str]:
    """Add the rows of hands as phases with kinds, "stroke offer"; return notes."""
    notes: list[str] = []
    kinds: set[str] = set()
    rests: set[str] = set()
    only_beats = {meaning.phase for _, meaning in tiers} == {"beat"}
    for tier, meaning in tiers:
        if not meaning.sides:
            notes.append(f"Tier {tier.name[:40]} names no hand; it is used for the right hand.")
        has_types = only_beats or (not meaning.phase and _has_types(tier))
        phases: list[Interval] = []
        for row in tier.rows:
            label = f"{meaning.phase} {row.text}" if meaning.phase else row.text
            phase, kind = _phase_of(label)
            if phase == "beat" and has_types:
                phase, kind = "stroke", "beat"
            elif phase is None and _is_no_gesture(label, meaning):
                phase, kind = "rest", ""
                rests.add(label)
            elif phase is None:
                phase, kind = "stroke", label.lower()
                kinds.add(label)
            phases.append(replace(row, text=f"{phase} {kind}"))
        if tier.rows and (has_types or meaning.content == _PHRASES):
            notes.append(
                f"Tier {tier.name[:40]} has whole gestures without phases; each is performed as "
                "one long stroke."
            )
        if has_types and any(row.text == "stroke beat" for row in phases):
            notes.append(
                f"Beats in tier {tier.name[:40]} are read as beat gestures, because the tier has "
                "no phases; among phases, a beat is a small movement after a stroke."
            )
        for side in _hands_of(meaning):
            rows[PHASE_TIER, side] += phases
    if kinds:
        notes.append(
            f"These labels are read as gesture types of strokes: {_listed(sorted(kinds))}. Phases "
            f"are {', '.join(PHASES)}."
        )
    if rests:
        notes.append(
            f"These labels name no gesture and are read as rest: {_listed(sorted(rests))}."
        )
    return notes


def _is_no_gesture(label: str, meaning: _Meaning) -> bool:
    """Check whether a label marks an adaptor, or no gesture, or an open question ("?", "-")."""
    if not label.strip():
        return meaning.content == PHASE_TIER
    return _has_stem(label, _NO_GESTURE) or not any(sign.isalnum() for sign in label)


def _has_stem(label: str, stems: tuple[str, ...]) -> bool:
    """Check whether a word of a label begins with one of the stems."""
    return any(word.startswith(stems) for word in re.findall(r"[a-z]+", label.lower()))


def _has_types(tier: NamedTier) -> bool:
    """Check whether labels are gesture types, among which a beat is a gesture, not a phase."""
    named = [(_phase_of(row.text)[0], row.text) for row in tier.rows]
    phases = {phase for phase, _ in named} - {"rest", None}
    has_names = any(phase is None and _has_stem(label, _TYPES) for phase, label in named)
    return phases <= {"beat"} and (has_names or (bool(phases) and tier.name not in _OURS))


def _plan(
    duration_s: float, left: tuple[HandPhase, ...], right: tuple[HandPhase, ...], rows: _Rows
) -> GesturePlan:
    """Make a plan of both hands and of the events of the body."""

    def in_time(tier: str) -> list[Interval]:
        return sorted(rows[tier, ""], key=lambda row: row.start_s)

    return GesturePlan(
        duration_s,
        left,
        right,
        tuple(Nod(r.middle_s, _first(r, DEFAULT_NOD_DEG)) for r in in_time("nods")),
        tuple(Gaze(r.start_s, r.end_s, *_direction(r)) for r in in_time("gaze")),
        tuple(Brow(r.middle_s, _height(r)) for r in in_time("brows")),
        tuple(Smile(r.start_s, r.end_s, _first(r, DEFAULT_SMILE)) for r in in_time("smile")),
        tuple(Blink(r.middle_s) for r in in_time("blinks")),
        tuple(_stand(r) for r in in_time("weight")),
        tuple(FootContact(r.start_s, r.end_s, side) for side in SIDES for r in rows["foot", side]),
    )


def _hand(rows: _Rows, side: Side, notes: list[str]) -> tuple[HandPhase, ...]:
    """Return a hand's phases with their goals; usual goals replace missing ones, with a note."""
    phases = sorted(rows[PHASE_TIER, side], key=lambda row: row.start_s)
    names: list[Phase] = [next(p for p in PHASES if row.text.startswith(f"{p} ")) for row in phases]
    kinds = _kinds(phases, rows[KIND_TIER, side])
    places = sorted(rows[GOAL_TIER, side], key=lambda row: row.end_s)
    if phases and not places:
        notes.append(
            f"The {side} hand has no goals (wrist positions); each stroke ends at the usual "
            "position of its gesture type."
        )
    goals = _goals(phases, places) if places else _usual_goals(names, kinds)
    words_at = {round(row.end_s, 4): row.text for row in rows[WORD_TIER, side]}
    hand_phases: list[HandPhase] = []
    for row, phase, goal, kind in zip(phases, names, goals, kinds, strict=True):
        word = words_at.get(round(row.end_s, 4), "")
        if not word and phase == "stroke":
            word = _landed_on(rows[_APEX, ""], side, row.end_s)
        hand_phases.append(HandPhase(row.start_s, row.end_s, phase, goal, kind, word))
    return tuple(hand_phases)


def _kinds(phases: Sequence[Interval], kinds: Sequence[Interval]) -> list[str]:
    """Return the kind of each phase: of its label, or of the row of kinds that ends with it."""
    at_end = {round(row.end_s, 4): row.text for row in kinds}
    return [
        row.text.partition(" ")[2]
        or at_end.get(round(row.end_s, 4))
        or next((each.text for each in kinds if each.start_s <= row.middle_s < each.end_s), "")
        for row in phases
    ]


def _goals(phases: Sequence[Interval], places: Sequence[Interval]) -> list[Position]:
    """Return the goal of each phase: that at its end, or else the last one reached by then."""
    places_by_end = {round(row.end_s, 4): _place(row) for row in places}
    times = list(places_by_end)
    goals = []
    for row in phases:
        last = max(bisect_right(times, row.end_s + _SAME_MOMENT_S) - 1, 0)
        goals.append(places_by_end.get(round(row.end_s, 4), places_by_end[times[last]]))
    return goals


def _usual_goals(names: Sequence[Phase], kinds: Sequence[str]) -> list[Position]:
    """Return the default goal of each phase by its kind, or by that of the next stroke."""
    goals: list[Position] = []
    for k, (phase, kind) in enumerate(zip(names, kinds, strict=True)):
        stroke = names.index("stroke", k) if "stroke" in names[k:] else k
        before = goals[-1] if goals else REST_POSITION
        goals.append(default_goal(phase, kind or kinds[stroke], before))
    return goals


def _landed_on(apexes: Sequence[Interval], side: Side, end_s: float) -> str:
    """Return the word of the corpus's apex (kind, hand, word) nearest to the end of a stroke."""
    marks = ((row.end_s, row.text.split(" ")) for row in apexes)
    words = {at: mark[2] for at, mark in marks if len(mark) == 3 and mark[1] == side}
    at = min(words, key=lambda at: abs(at - end_s), default=math.inf)
    return words[at] if abs(at - end_s) < APEX_TOLERANCE_S else ""


def _words(name: str) -> Set[str]:
    """Split a tier's name into lower-case words: ``RH_Phase``, ``rightHand-Stroke``."""
    parted = re.sub(r"([a-z])([A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", r"\1 \2", name[:200])
    return dict.fromkeys(re.findall(r"[a-z]+", parted.lower())).keys()


def _has_phases(tier: NamedTier) -> bool:
    """Check whether most labels of a tier name phases."""
    if _has_types(tier):
        return False
    return 2 * sum(_phase_of(row.text)[0] is not None for row in tier.rows) > len(tier.rows)


def _sides(words: Set[str]) -> tuple[Side, ...]:
    is_left, is_right = bool(words & _LEFT), bool(words & _RIGHT)
    if words & _BOTH or (is_left and is_right):
        return SIDES
    return ("left",) if is_left else ("right",) if is_right else ()


def _phase_of(label: str) -> tuple[Phase | None, str]:
    """Parse phase and kind from a label: ``stroke offer``, ``Prep``, ``post-stroke hold``."""
    name, _, kind = label.partition(" ")
    if name in PHASES:
        return PHASES[PHASES.index(name)], kind
    words = re.findall(r"[a-z]+", label.lower())
    if len(words) == 1 and words[0] in _PHASE_LETTERS:
        return _PHASE_LETTERS[words[0]], ""
    matches = _match_stems(words, _PHASES)
    return matches[-1] if matches else None, ""  # the last: "post-stroke hold"


def _numbers(row: Interval) -> list[float]:
    """Parse the numbers at the start of a label."""
    numbers: list[float] = []
    for part in row.text.split():
        try:
            number = float(part)
        except ValueError:
            break
        if not math.isfinite(number):
            raise PlanError(f"A number in {row.text[:40]!r} at {row.start_s:g} s is not finite.")
        numbers.append(number)
    return numbers


def _first(row: Interval, usual: float) -> float:
    return (_numbers(row) or [usual])[0]


def _place(row: Interval) -> Position:
    numbers = _numbers(row)
    if len(numbers) != 3:
        raise PlanError(
            f"The goal {row.text[:40]!r} at {row.end_s:g} s must be three numbers: metres outward, "
            "up and forward from the chest."
        )
    return numbers[0], numbers[1], numbers[2]


_DIRECTIONS: Mapping[str, tuple[float, float]] = {
    "left": (12.0, 0.0), "right": (-12.0, 0.0), "up": (0.0, -8.0), "down": (0.0, 10.0),
    "away": (14.0, 5.0),
}  # fmt: skip


def _direction(row: Interval) -> tuple[float, float]:
    numbers = _numbers(row)
    if len(numbers) >= 2:
        return numbers[0], numbers[1]
    words = _words(row.text)
    return next((way for name, way in _DIRECTIONS.items() if name in words), (0.0, 0.0))


def _height(row: Interval) -> float:
    usual = -DEFAULT_BROW if _words(row.text) & {"frown", "lower", "lowered"} else DEFAULT_BROW
    return _first(row, usual)


def _stand(row: Interval) -> Stance:
    words = _words(row.text)
    for leg in (*SIDES, "both"):
        if leg in words:
            return Stance(row.start_s, row.end_s, leg)
    raise PlanError(
        f"The weight-bearing leg at {row.start_s:g} s must be left, right or both; got "
        f"{row.text[:40]!r}."
    )


def _listed(names: Sequence[str]) -> str:
    few = ", ".join(repr(name[:40]) for name in names[:_MAX_LISTED])
    return few if len(names) <= _MAX_LISTED else f"{few} and {len(names) - _MAX_LISTED} more"
