"""Gesture plans in files (JSON, TextGrid, ELAN), and as markers for animation software."""

from __future__ import annotations

import json
import os
from pathlib import Path

from conventions.rates import FPS
from model.plan import annotation_files
from model.plan.annotation_files import NamedTier
from model.plan.plan import FORMAT, SIDES, GesturePlan, PlanError, PlanResult
from model.plan.tiers import GOAL_TIER, PHASE_TIER, plan_to_tiers, tiers_to_plan
from model.storage.escaping import csv_text
from model.storage.files import read_within_limit, write_atomically
from model.storage.json_validation import InvalidJsonError, parse_json

ENDINGS = (".json", ".TextGrid", ".eaf")
MAX_BYTES = 16 * 2**20


def read_plan_file(path: Path) -> PlanResult:
    """Read a plan with notes on its reading; raises PlanError if missing, too large or no plan."""
    return parse_plan(read_within_limit(path, MAX_BYTES, PlanError), path.name)


def parse_plan(data: bytes, file: str) -> PlanResult:
    """Parse a plan from the bytes of a file with that name, see `read_plan_file`."""
    ending = Path(file).suffix.lower()
    if ending not in (".textgrid", ".eaf"):
        return PlanResult(_of_json(data, file))
    tiers, duration_s, notes = (annotation_files.parse_elan if ending == ".eaf" else _grid_tiers)(
        data, file
    )
    try:
        read = tiers_to_plan(tiers, duration_s)
        return PlanResult(read.plan, (*notes, *read.notes))
    except PlanError as error:
        raise PlanError(f"{file}: {error}") from None


def _of_json(data: bytes, file: str) -> GesturePlan:
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.pop("format", None) != FORMAT:
        raise PlanError(f"{file} is not a plan of format {FORMAT}; give one written by `plan`.")
    # No file of text holds half a character, which JSON can spell.
    text = json.dumps(content, ensure_ascii=False).encode("utf-8", "replace")
    try:
        return parse_json(text, GesturePlan)
    except InvalidJsonError as error:
        raise PlanError(f"{file} cannot be used: {error}.") from None


def read_corpus_textgrid(path: Path) -> GesturePlan:
    """Read phases and goals of both hands from the corpus's TextGrid; raises PlanError."""
    tiers, duration_s, _ = _grid_tiers(read_within_limit(path, MAX_BYTES, PlanError), path.name)
    there = {tier.name for tier in tiers}
    for name in (f"{what}_{side}" for side in SIDES for what in (PHASE_TIER, GOAL_TIER)):
        if name not in there:
            raise PlanError(f"{path.name} has no tier {name}.")
    return tiers_to_plan(tiers, duration_s).plan


def _grid_tiers(data: bytes, file: str) -> tuple[list[NamedTier], float, tuple[str, ...]]:
    """Parse the tiers of a TextGrid without empty intervals, its duration, and notes."""
    text, notes = annotation_files.decode_text(data, file, PlanError)
    tiers, duration_s = annotation_files.parse_textgrid(text, file, PlanError)
    if not tiers:
        raise PlanError(f"{file} has no tiers.")
    if not 0 < duration_s < 1e6:
        raise PlanError(
            f"{file} lasts {duration_s:g} s; it must last more than 0 s and less than 1,000,000 s."
        )
    named: list[NamedTier] = []
    for tier in tiers:
        rows = tuple(row for row in tier.rows if row.text or tier.has_points)
        for row in rows:
            if not (0 <= row.start_s < 1e6 and 0 <= row.end_s < 1e6):
                raise PlanError(
                    f"{file} has {row.text[:40]!r} from {row.start_s:g} to {row.end_s:g} s; times "
                    "must be from 0 s to less than 1,000,000 s."
                )
        named.append(NamedTier(tier.name, rows, tier.has_points))
    return named, duration_s, notes


def check_plan_suffix(path: Path) -> None:
    """Check that a file's suffix is one of a plan; raises PlanError if it is not."""
    if path.suffix.lower() not in {ending.lower() for ending in ENDINGS}:
        raise PlanError(
            f"{path.name} has the wrong suffix; a plan file must end in {', '.join(ENDINGS)}."
        )


def write_plan_file(plan: GesturePlan, path: Path, speech: Path | None = None) -> None:
    """Write a plan in the format of the file's suffix, atomically; ELAN opens the speech with it.

    Raises PlanError if the format is unknown or cannot hold the plan; WriteError with the reason.
    """
    check_plan_suffix(path)
    ending = path.suffix.lower()
    if ending == ".json":
        text = plan.as_json()
    elif ending == ".eaf":
        sound = "" if speech is None else os.path.relpath(speech, path.parent)
        text = annotation_files.format_elan(plan_to_tiers(plan), plan.duration_s, sound)
    else:
        tiers = plan_to_tiers(plan, for_praat=True)
        end_s = max(plan.duration_s, *(row.end_s for tier in tiers for row in tier.rows), 0.0)
        text = annotation_files.format_textgrid(tiers, plan.duration_s, end_s)
    write_atomically(path, text)


def plan_markers(plan: GesturePlan) -> list[tuple[float, str]]:
    """Return sorted starts (s) and names of phases but rests, of nods, gazes, brows and blinks."""
    markers = [(nod.time_s, f"nod {nod.depth_deg:.0f}°") for nod in plan.nods]
    for side in SIDES:
        for phase in plan.hand(side):
            kind = f" ({phase.kind})" if phase.kind else ""
            word = f" on {phase.word}" if phase.word else ""
            if phase.phase != "rest":
                markers.append((phase.start_s, f"{side} {phase.phase}{kind}{word}"))
    for look in plan.looks:
        markers.append((look.start_s, f"gaze {look.yaw_deg:.0f}° {look.pitch_deg:.0f}°"))
    markers += [(brow.time_s, "frown" if brow.height < 0 else "brows") for brow in plan.brows]
    return sorted([*markers, *((blink.time_s, "blink") for blink in plan.blinks)])


def markers_csv(plan: GesturePlan) -> str:
    """Format markers as CSV with ``frame`` (the nearest, from 0), ``time_s`` and ``name``."""
    rows = [(round(at_s * FPS), f"{at_s:.4f}", name) for at_s, name in plan_markers(plan)]
    return csv_text([("frame", "time_s", "name"), *rows], "\n")
