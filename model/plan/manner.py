"""How a plan is drawn that is performed at once: sliders of a whole performance while it goes on.

Nobody knows yet what a plan of live speech will be like, so all of them say how many times as much
as the speech asks for.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from model.plan.editing import within_reach
from model.plan.palette import REST_PLACE
from model.plan.plan import HandPhase, PlanError

LIMITS = {
    "often": (0.2, 4.0), "large": (0.3, 2.5), "high_m": (-0.3, 0.3), "fast": (0.5, 2.0),
    "both": (0.1, 10.0), "smile": (0.0, 4.0),
}  # fmt: skip


@dataclass(frozen=True)
class Manner:
    """All 1, and 0 m, is what the speech asks for."""

    often: float = 1.0
    """How many times as likely a gesture begins."""
    large: float = 1.0
    high_m: float = 0.0
    fast: float = 1.0
    """Of preparations, strokes and ways back."""
    both: float = 1.0
    """How many times as likely one hand joins the other."""
    smile: float = 1.0

    def __post_init__(self) -> None:
        """
        Raises:
            PlanError: if something is beyond what sliders reach.
        """
        for name, (least, most) in LIMITS.items():
            if not least <= getattr(self, name) <= most:
                value = getattr(self, name)
                raise PlanError(f"{name} is {value:g}; it must lie between {least:g} and {most:g}.")

    @staticmethod
    def of(told: Any) -> Manner:
        """From what a program tells: an object of numbers.

        Raises:
            PlanError: if it is anything else.
        """
        names = {each.name for each in fields(Manner)}
        if not isinstance(told, dict) or not set(told) <= names:
            raise PlanError(f"A manner is an object of some of {', '.join(sorted(names))}.")
        for name, value in told.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise PlanError(f"{name} is no number.")
        return replace(Manner(), **{name: float(value) for name, value in told.items()})

    def done(self, phase: HandPhase) -> HandPhase:
        """A phase of a gesture as large and as high as it shall be."""
        if phase.phase in ("rest", "retraction") or (self.large, self.high_m) == (1.0, 0.0):
            return phase
        out, up, forward = (
            r + self.large * (g - r) for g, r in zip(phase.goal, REST_PLACE, strict=True)
        )
        return within_reach([replace(phase, goal=(out, up + self.high_m, forward))])[0][0]
