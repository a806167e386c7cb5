"""Plans in files, told apart by their ending, and as markers for animation software."""

from __future__ import annotations

import csv
import io
import os
from dataclasses import dataclass
from pathlib import Path

from conventions.rates import FPS
from model.plan.annotation import PlanRead
from model.plan.elan import elan_of, read_elan_plan
from model.plan.plan import SIDES, GesturePlan, PlanError, read_plan
from model.plan.textgrid import read_textgrid_plan, textgrid_of
from model.storage.files import written_atomically

ENDINGS = (".json", ".TextGrid", ".eaf")


def read_plan_file(path: Path) -> PlanRead:
    """A plan, and what a person should know of how it was taken.

    Raises:
        PlanError: if the file is missing, too large, or holds no plan; one sentence.
    """
    ending = path.suffix.lower()
    if ending == ".textgrid":
        return read_textgrid_plan(path)
    if ending == ".eaf":
        return read_elan_plan(path)
    return PlanRead(read_plan(path))


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
        text = elan_of(plan, "" if speech is None else os.path.relpath(speech, path.parent))
    else:
        text = textgrid_of(plan)
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
    found = [
        Marker(phase.start_s, _told(f"{side} {phase.phase}", phase.kind, phase.word))
        for side in SIDES
        for phase in plan.hand(side)
        if phase.phase != "rest"
    ]
    found += [Marker(nod.time_s, f"nod {nod.depth_deg:.0f}°") for nod in plan.nods]
    found += [
        Marker(look.start_s, f"look {look.yaw_deg:.0f}° {look.pitch_deg:.0f}°")
        for look in plan.looks
    ]
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


def _told(what: str, kind: str, word: str) -> str:
    kind = f" ({kind})" if kind else ""
    return f"{what}{kind} on {word}" if word else f"{what}{kind}"
