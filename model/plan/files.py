"""Gesture plans in files (JSON, TextGrid, ELAN), as tiers, and as markers for animation software.

Our tiers hold all of a plan. Those of other projects are interpreted by their names and labels (a
tier for each phase, short labels, no goals); notes say how.
"""

from __future__ import annotations

import json
import math
import os
import re
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from conventions.rates import FPS
from model.plan.annotation_files import (
    Interval,
    NamedTier,
    decode_text,
    elan_of,
    elan_tiers,
    format_textgrid,
    parse_textgrid,
)
from model.plan.kinds import REST_PLACE, Place, usual_goal
from model.plan.plan import (
    FORMAT,
    PHASES,
    SIDES,
    Blink,
    Brow,
    FootContact,
    Gaze,
    GesturePlan,
    HandPhase,
    Moment,
    Nod,
    Phase,
    PlanError,
    PlanResult,
    Side,
    Smile,
    Span,
    Stand,
)
from model.storage.escaping import csv_text
from model.storage.files import read_capped, write_atomically
from model.storage.json_validation import FieldError, parse_json

PHASE_TIER, KIND_TIER, WORD_TIER, GOAL_TIER = "gesture", "kind", "word", "goal"
_SAME_MOMENT_S = 0.5 / FPS
APEX_S = 0.08
"""Largest time between a stroke's end and the apex that names its word (s)."""
USUAL_NOD_DEG, USUAL_BROW, USUAL_SMILE = 4.0, 0.5, 0.4
"""Defaults for nods (degrees), brows and smiles without a number."""
MAX_ROWS = 100_000
_FEW = 6


def tiers_of(plan: GesturePlan, *, for_praat: bool = False) -> tuple[NamedTier, ...]:
    """Convert a plan to tiers, with times and numbers rounded to four decimals.

    Args:
        for_praat: without parent tiers, which Praat lacks: phases and kinds share one label, and
            words and goals are points at the phases' ends.

    Raises:
        PlanError: if events of one list overlap: no tier can hold them.
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
            told = [(p, text) for p, text in zip(phases, texts, strict=True) if text]
            rows = tuple(_row(phase, text, for_praat) for phase, text in told)
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
                    f"The plan's rows of {name} overlap at {after.start_s:.2f} s, which a tier "
                    "cannot hold; part them, or write the plan as JSON."
                )
        tiers.append(NamedTier(name, tuple(rows), name in ("nods", "brows", "blinks")))
    return tuple(tiers)


def _row(event: Span | Moment, label: str, is_point: bool = False) -> Interval:
    start_s = event.end_s if is_point else event.start_s
    return Interval(round(start_s, 4), round(event.end_s, 4), label)


def _numbered(*numbers: float) -> str:
    return " ".join(f"{number:.4f}" for number in numbers)


_LEFT, _RIGHT, _BOTH = {"left", "lh", "l"}, {"right", "rh", "r"}, {"both", "bh", "bimanual"}
_SPEECH = {"words", "phones", "accents", "listening", "apex", "transcript", "utterance", "speech"}
_GESTURES = {PHASE_TIER, "gestures", "phrase", "phrases", "hand"}
_PHASES: Mapping[str, Phase] = {
    "rest": "rest", "prep": "preparation", "stroke": "stroke", "hold": "hold", "psh": "hold",
    "beat": "beat", "baton": "beat", "ret": "retraction", "recover": "retraction",
}  # fmt: skip
"""Phases by word stems; the next tables are for body tiers and more hand tiers."""
_LETTERS: Mapping[str, Phase] = {
    "p": "preparation", "s": "stroke", "h": "hold", "b": "beat", "r": "retraction",
}  # fmt: skip
_BODY: Mapping[str, str] = {
    "nod": "nods", "gaze": "gaze", "look": "gaze", "brow": "brows", "eyebrow": "brows",
    "smile": "smile", "blink": "blinks", "weight": "weight", "stand": "weight", "foot": "foot",
    "feet": "foot",
}  # fmt: skip
_MORE: Mapping[str, str] = {
    "goal": GOAL_TIER, "word": WORD_TIER, "lexical": WORD_TIER, "affiliate": WORD_TIER,
    "kind": KIND_TIER, "type": KIND_TIER, "shape": KIND_TIER,
}  # fmt: skip
_T = TypeVar("_T", bound=str)


def _meant(words: Iterable[str], stems: Mapping[str, _T]) -> list[_T]:
    """Return the meanings of the words that start with one of the stems, in order."""
    return [told for word in words for stem, told in stems.items() if word.startswith(stem)]


_Rows = defaultdict[tuple[str, str], list[Interval]]
"""Rows by content and by hand or foot; "" for the whole body."""


def plan_of_tiers(tiers: Sequence[NamedTier], duration_s: float) -> PlanResult:
    """Convert tiers to a plan by their names: ours, or others that mention hands and phases.

    Raises:
        PlanError: if no tier describes a hand, or the tiers form no valid plan.
    """
    rows: _Rows = defaultdict(list)
    of_phases: list[tuple[NamedTier, tuple[Side, ...], Phase | None]] = []
    phrases: list[tuple[NamedTier, tuple[Side, ...], Phase | None]] = []
    notes: list[str] = []
    left_out: list[str] = []

    def add(what: str, sides: Iterable[str], of: Iterable[Interval]) -> None:
        for side in sides:
            rows[what, side] += of

    names = [tier.name for tier in tiers if tier.rows]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise PlanError(f"There are two tiers called {twice[:40]}; rename or delete one of them.")
    for tier in tiers:
        if len(tier.rows) > MAX_ROWS:
            raise PlanError(f"Tier {tier.name[:40]} has over {MAX_ROWS} rows.")
        words = _words(tier.name)
        sides = _sides(words)
        (body, *_), (more, *_) = (_meant(words, stems) or [""] for stems in (_BODY, _MORE))
        phase: Phase | None = next(iter(_meant(words, _PHASES)), None)
        if tier.name == "apex":
            add("apex", [""], tier.rows)
        if _SPEECH & words:
            continue
        if body:
            add(body, sides if body == "foot" else [""], tier.rows)
        elif more and (sides or more == KIND_TIER):
            add(more, sides or ["right"], tier.rows)
        elif phase or words & {"phase", "phases"} or (words & _GESTURES and _has_phases(tier)):
            of_phases.append((tier, sides, phase))
        elif words & _GESTURES and "unit" not in words:
            phrases.append((tier, sides, None))
        elif tier.rows:
            left_out.append(tier.name)
    if not of_phases and not phrases:
        found = ", ".join(tier.name[:40] for tier in tiers[:_FEW]) or "no tier"
        raise PlanError(
            f"No tier tells what a hand does: name one gesture_right or gesture_left; found "
            f"{found}."
        )
    for tier, sides, _ in phrases if of_phases else ():  # then they are the kinds of phases
        add(KIND_TIER, sides or ["right"], tier.rows)
    strokes: set[str] = set()
    for tier, sides, phase in of_phases or phrases:
        if not sides:
            notes.append(f"Tier {tier.name[:40]} names no hand; it was taken for the right.")
        for row in tier.rows:
            name, kind = (phase, row.text) if phase else _phase_of(row.text)
            if name is None:
                strokes.add(row.text)
                name, kind = "stroke", row.text.lower()
            add(PHASE_TIER, sides or ["right"], [replace(row, text=f"{name} {kind}")])
    if strokes:
        notes.append(
            f"Taken as kinds of strokes: {_listed(sorted(strokes))}; phases are "
            f"{', '.join(PHASES)}."
        )
    if left_out:
        notes.append(f"Left out, for they tell of no plan: {_listed(left_out)}.")
    left, right = (_hand(rows, side, notes) for side in SIDES)

    def in_time(what: str) -> list[Interval]:
        return sorted(rows[what, ""], key=lambda row: row.start_s)

    plan = GesturePlan(
        duration_s,
        left,
        right,
        tuple(Nod(r.middle_s, _first(r, USUAL_NOD_DEG)) for r in in_time("nods")),
        tuple(Gaze(r.start_s, r.end_s, *_direction(r)) for r in in_time("gaze")),
        tuple(Brow(r.middle_s, _height(r)) for r in in_time("brows")),
        tuple(Smile(r.start_s, r.end_s, _first(r, USUAL_SMILE)) for r in in_time("smile")),
        tuple(Blink(r.middle_s) for r in in_time("blinks")),
        tuple(_stand(r) for r in in_time("weight")),
        tuple(FootContact(r.start_s, r.end_s, side) for side in SIDES for r in rows["foot", side]),
    )
    return PlanResult(plan, tuple(notes))


def _hand(rows: _Rows, side: Side, notes: list[str]) -> tuple[HandPhase, ...]:
    """Return a hand's phases with their goals; usual goals replace missing ones, with a note."""
    phases = sorted(rows[PHASE_TIER, side], key=lambda row: row.start_s)
    kinds_at, words_at = (
        {round(row.end_s, 4): row.text for row in rows[what, side]}
        for what in (KIND_TIER, WORD_TIER)
    )
    told = sorted(rows[GOAL_TIER, side], key=lambda row: row.end_s)
    places = {round(row.end_s, 4): _place(row) for row in told}
    times = list(places)
    if phases and not places:
        notes.append(
            f"No places are told for the {side} hand; it goes where such gestures usually do."
        )
    names: list[Phase] = [next(p for p in PHASES if row.text.startswith(f"{p} ")) for row in phases]
    kinds = [
        row.text.partition(" ")[2]
        or kinds_at.get(round(row.end_s, 4))
        or next((r.text for r in rows[KIND_TIER, side] if r.start_s <= row.middle_s < r.end_s), "")
        for row in phases
    ]
    found: list[HandPhase] = []
    goal = REST_PLACE
    for k, (row, phase) in enumerate(zip(phases, names, strict=True)):
        end_s = round(row.end_s, 4)
        if places:  # that of the phase's end, or else the last one reached by then
            last = max(bisect_right(times, row.end_s + _SAME_MOMENT_S) - 1, 0)
            goal = places.get(end_s, places[times[last]])
        else:
            stroke = names.index("stroke", k) if "stroke" in names[k:] else k
            goal = usual_goal(phase, kinds[k] or kinds[stroke], goal)
        word = words_at.get(end_s, "")
        if not word and phase == "stroke":
            word = _landed_on(rows["apex", ""], side, row.end_s)
        found.append(HandPhase(row.start_s, row.end_s, phase, goal, kinds[k], word))
    return tuple(found)


def _landed_on(apexes: Sequence[Interval], side: Side, end_s: float) -> str:
    """Return the word of the corpus's apex (kind, hand, word) nearest to the end of a stroke."""
    marks = ((row.end_s, row.text.split(" ")) for row in apexes)
    words = {at: mark[2] for at, mark in marks if len(mark) == 3 and mark[1] == side}
    at = min(words, key=lambda at: abs(at - end_s), default=math.inf)
    return words[at] if abs(at - end_s) < APEX_S else ""


def _words(name: str) -> Set[str]:
    """Split a tier's name into lower-case words: ``RH_Phase``, ``rightHand-Stroke``."""
    parted = re.sub(r"([a-z])([A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", r"\1 \2", name[:200])
    return dict.fromkeys(re.findall(r"[a-z]+", parted.lower())).keys()


def _has_phases(tier: NamedTier) -> bool:
    """Check whether most labels of a tier name phases."""
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
    if len(words) == 1 and words[0] in _LETTERS:
        return _LETTERS[words[0]], ""
    known = _meant(words, _PHASES)
    return known[-1] if known else None, ""  # the last: "post-stroke hold"


def _numbers(row: Interval) -> list[float]:
    """Parse the numbers at the start of a label."""
    numbers: list[float] = []
    for part in row.text.split():
        try:
            number = float(part)
        except ValueError:
            break
        if not math.isfinite(number):
            raise PlanError(f"The label {row.text[:40]!r} at {row.start_s:g} s is not finite.")
        numbers.append(number)
    return numbers


def _first(row: Interval, usual: float) -> float:
    return (_numbers(row) or [usual])[0]


def _place(row: Interval) -> Place:
    numbers = _numbers(row)
    if len(numbers) != 3:
        raise PlanError(
            f"The goal {row.text[:40]!r} at {row.end_s:g} s is no three numbers: metres out, up "
            "and forward of the chest."
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
    usual = -USUAL_BROW if _words(row.text) & {"frown", "lower", "lowered"} else USUAL_BROW
    return _first(row, usual)


def _stand(row: Interval) -> Stand:
    words = _words(row.text)
    for leg in (*SIDES, "both"):
        if leg in words:
            return Stand(row.start_s, row.end_s, leg)
    raise PlanError(f"The weight {row.text[:40]!r} at {row.start_s:g} s is not left, right, both.")


def _listed(names: Sequence[str]) -> str:
    few = ", ".join(repr(name[:40]) for name in names[:_FEW])
    return few if len(names) <= _FEW else f"{few} and {len(names) - _FEW} more"


ENDINGS = (".json", ".TextGrid", ".eaf")
MAX_BYTES = 16 * 2**20


def read_plan_file(path: Path) -> PlanResult:
    """Read a plan with notes on how it was read.

    Raises:
        PlanError: if the file is missing, too large, or holds no plan; one sentence.
    """
    return plan_in(read_capped(path, MAX_BYTES, PlanError), path.name)


def plan_in(data: bytes, file: str) -> PlanResult:
    """Parse a plan from the bytes of a file with that name, see `read_plan_file`."""
    ending = Path(file).suffix.lower()
    if ending not in (".textgrid", ".eaf"):
        return PlanResult(_of_json(data, file))
    tiers, duration_s, notes = (elan_tiers if ending == ".eaf" else _grid_tiers)(data, file)
    try:
        read = plan_of_tiers(tiers, duration_s)
        return PlanResult(read.plan, (*notes, *read.notes))
    except PlanError as error:
        raise PlanError(f"{file}: {error}") from None


def _of_json(data: bytes, file: str) -> GesturePlan:
    try:
        told = json.loads(data)
    except (ValueError, RecursionError):
        told = None
    if not isinstance(told, dict) or told.pop("format", None) != FORMAT:
        raise PlanError(f"{file} is no plan of format {FORMAT}, as `plan --out` writes it.")
    # No file of text holds half a character, which JSON can spell.
    text = json.dumps(told, ensure_ascii=False).encode("utf-8", "replace")
    try:
        return parse_json(text, GesturePlan)
    except FieldError as error:
        raise PlanError(f"{file} cannot be used: {error}.") from None


def annotated_plan(path: Path) -> GesturePlan:
    """Read the plan in a TextGrid of the corpus, with phases and goals of both hands.

    Raises:
        PlanError: if it lacks the gestures of a hand or their goals.
    """
    tiers, duration_s, _ = _grid_tiers(read_capped(path, MAX_BYTES, PlanError), path.name)
    there = {tier.name for tier in tiers}
    for name in (f"{what}_{side}" for side in SIDES for what in (PHASE_TIER, GOAL_TIER)):
        if name not in there:
            raise PlanError(f"{path.name} has no tier {name}.")
    return plan_of_tiers(tiers, duration_s).plan


def _grid_tiers(data: bytes, file: str) -> tuple[list[NamedTier], float, tuple[str, ...]]:
    """Parse the tiers of a TextGrid without empty intervals, its duration, and notes."""
    text, notes = decode_text(data, file, PlanError)
    tiers, duration_s = parse_textgrid(text, file, PlanError)
    if not tiers:
        raise PlanError(f"{file} has no tier at all.")
    if not 0 < duration_s < 1e6:
        raise PlanError(f"{file} lasts {duration_s:g} s, which is no length of a plan.")
    found: list[NamedTier] = []
    for tier in tiers:
        rows = tuple(row for row in tier.rows if row.text or tier.has_points)
        for row in rows:
            if not (0 <= row.start_s < 1e6 and 0 <= row.end_s < 1e6):
                raise PlanError(
                    f"{file} has {row.text[:40]!r} from {row.start_s:g} to {row.end_s:g} s, "
                    "which is no time of a plan."
                )
        found.append(NamedTier(tier.name, rows, tier.has_points))
    return found, duration_s, notes


def check_ending(path: Path) -> None:
    """Check that a file's suffix is one of a plan.

    Raises:
        PlanError: if it is not.
    """
    if path.suffix.lower() not in {ending.lower() for ending in ENDINGS}:
        raise PlanError(
            f"{path.name} ends in {path.suffix or 'nothing'!r}; a plan is written as "
            f"{', '.join(ENDINGS)}."
        )


def write_plan_file(plan: GesturePlan, path: Path, speech: Path | None = None) -> None:
    """Write a plan in the format of the file's suffix, atomically.

    Args:
        speech: sound file that ELAN opens with the plan.

    Raises:
        PlanError: if the suffix is none of ours, or the format cannot hold the plan.
        WriteError: with the reason.
    """
    check_ending(path)
    ending = path.suffix.lower()
    if ending == ".json":
        text = plan.as_json()
    elif ending == ".eaf":
        sound = "" if speech is None else os.path.relpath(speech, path.parent)
        text = elan_of(tiers_of(plan), plan.duration_s, sound)
    else:
        tiers = tiers_of(plan, for_praat=True)
        end_s = max(plan.duration_s, *(row.end_s for tier in tiers for row in tier.rows), 0.0)
        text = format_textgrid(tiers, plan.duration_s, end_s)
    write_atomically(path, text)


def markers_of(plan: GesturePlan) -> list[tuple[float, str]]:
    """Return sorted starts (s) and names of phases but rests, of nods, gazes, brows and blinks."""
    found = [(nod.time_s, f"nod {nod.depth_deg:.0f}°") for nod in plan.nods]
    for side in SIDES:
        for phase in plan.hand(side):
            kind = f" ({phase.kind})" if phase.kind else ""
            word = f" on {phase.word}" if phase.word else ""
            if phase.phase != "rest":
                found.append((phase.start_s, f"{side} {phase.phase}{kind}{word}"))
    for look in plan.looks:
        found.append((look.start_s, f"look {look.yaw_deg:.0f}° {look.pitch_deg:.0f}°"))
    found += [(brow.time_s, "frown" if brow.height < 0 else "brows") for brow in plan.brows]
    return sorted([*found, *((blink.time_s, "blink") for blink in plan.blinks)])


def markers_csv(plan: GesturePlan) -> str:
    """Format markers as CSV with ``frame`` (the nearest, from 0), ``time_s`` and ``name``."""
    rows = [(round(at_s * FPS), f"{at_s:.4f}", name) for at_s, name in markers_of(plan)]
    return csv_text([("frame", "time_s", "name"), *rows], "\n")
