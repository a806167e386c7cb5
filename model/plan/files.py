"""Plans in files, told apart by their ending, and as markers for animation software."""

from __future__ import annotations

import csv
import io
import os
from dataclasses import dataclass
from pathlib import Path

from conventions.rates import FPS
from model.plan.annotation import (
    GOAL_TIER,
    PHASE_TIER,
    PlanRead,
    as_points,
    plan_of_tiers,
    tiers_of,
)
from model.plan.elan import elan_of, elan_tiers
from model.plan.plan import SIDES, GesturePlan, PlanError, bytes_within, plan_of_json
from model.plan.textgrid import NamedTier, decoded, is_textgrid, textgrid_of, textgrid_tiers
from model.storage.files import written_atomically

ENDINGS = (".json", ".TextGrid", ".eaf")


def read_plan_file(path: Path) -> PlanRead:
    """A plan, and what a person should know of how it was taken.

    Raises:
        PlanError: if the file is missing, too large, or holds no plan; one sentence.
    """
    return plan_in(bytes_within(path), path.name)


def plan_in(data: bytes, file: str) -> PlanRead:
    """The plan in a file of that name, see `read_plan_file`."""
    ending = Path(file).suffix.lower()
    if ending not in (".textgrid", ".eaf"):
        return PlanRead(plan_of_json(data, file))
    tiers, duration_s = (elan_tiers if ending == ".eaf" else _grid_tiers)(data, file)
    try:
        return plan_of_tiers(tiers, duration_s)
    except PlanError as error:
        raise PlanError(f"{file}: {error}") from None


def annotated_plan(path: Path) -> GesturePlan:
    """The plan in a TextGrid of the corpus, whose hands have phases and goals.

    Raises:
        PlanError: if it tells no gestures of both hands with their goals.
    """
    tiers, duration_s = _grid_tiers(bytes_within(path), path.name)
    there = {tier.name for tier in tiers}
    for name in (f"{what}_{side}" for side in SIDES for what in (PHASE_TIER, GOAL_TIER)):
        if name not in there:
            raise PlanError(f"{path.name} has no tier {name}.")
    return plan_of_tiers(tiers, duration_s).plan


def _grid_tiers(data: bytes, file: str) -> tuple[list[NamedTier], float]:
    """The tiers of a TextGrid without empty intervals, and its length."""
    try:
        text = decoded(data)
    except UnicodeDecodeError as error:
        raise PlanError(f"{file} is no text in UTF-8 or UTF-16.") from error
    if not is_textgrid(text):
        raise PlanError(f"{file} is no TextGrid; save one as text in Praat.")
    tiers, duration_s = textgrid_tiers(text)
    if not tiers:
        raise PlanError(f"{file} has no tier at all.")
    if not 0 < duration_s < 1e6:
        raise PlanError(f"{file} lasts {duration_s:g} s, which is no length of a plan.")
    found: list[NamedTier] = []
    for tier in tiers:
        rows = tuple(row for row in tier.rows if row.label or tier.has_points)
        for row in rows:
            if not (0 <= row.start_s < 1e6 and 0 <= row.end_s < 1e6):
                raise PlanError(
                    f"{file} has {row.label[:40]!r} from {row.start_s:g} to {row.end_s:g} s, "
                    "which is no time of a plan."
                )
        found.append(NamedTier(tier.name, rows, tier.has_points))
    return found, duration_s


def check_ending(path: Path) -> None:
    """
    Raises:
        PlanError: if no plan is written under such a name.
    """
    if path.suffix.lower() not in {ending.lower() for ending in ENDINGS}:
        raise PlanError(
            f"{path.name} ends in {path.suffix or 'nothing'!r}; a plan is written as "
            f"{', '.join(ENDINGS)}."
        )


def write_plan_file(plan: GesturePlan, path: Path, speech: Path | None = None) -> None:
    """Write it in the form its ending names, whole or not at all.

    Args:
        speech: what ELAN opens with the plan.

    Raises:
        PlanError: if the ending is none of ours, or the form cannot hold the plan.
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
        tiers = as_points(tiers_of(plan))
        end_s = max(plan.duration_s, *(row.end_s for tier in tiers for row in tier.rows), 0.0)
        text = textgrid_of(tiers, plan.duration_s, end_s)
    with written_atomically(path) as part:
        part.write_text(text, encoding="utf-8", newline="")


@dataclass(frozen=True)
class Marker:
    """A moment and what happens there."""

    time_s: float
    name: str

    @property
    def frame(self) -> int:
        """The nearest, from 0."""
        return round(self.time_s * FPS)


def markers_of(plan: GesturePlan) -> tuple[Marker, ...]:
    """When each phase of each hand begins, but for rests, and nods, looks, brows and blinks, in
    time."""
    found = [Marker(nod.time_s, f"nod {nod.depth_deg:.0f}°") for nod in plan.nods]
    for side in SIDES:
        for phase in plan.hand(side):
            kind = f" ({phase.kind})" if phase.kind else ""
            word = f" on {phase.word}" if phase.word else ""
            if phase.phase != "rest":
                found.append(Marker(phase.start_s, f"{side} {phase.phase}{kind}{word}"))
    for look in plan.looks:
        found.append(Marker(look.start_s, f"look {look.yaw_deg:.0f}° {look.pitch_deg:.0f}°"))
    found += [Marker(brow.time_s, "frown" if brow.height < 0 else "brows") for brow in plan.brows]
    found += [Marker(blink.time_s, "blink") for blink in plan.blinks]
    return tuple(sorted(found, key=lambda marker: (marker.time_s, marker.name)))


def markers_csv(plan: GesturePlan) -> str:
    """The same as a table: ``frame``, ``time_s``, ``name``."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("frame", "time_s", "name"))
    for marker in markers_of(plan):
        table.writerow((marker.frame, f"{marker.time_s:.4f}", marker.name))
    return text.getvalue()
