"""A plan as markers on a time line, as animation software has them: moments with names."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

from conventions.rates import FPS
from model.plan.plan import SIDES, GesturePlan


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
