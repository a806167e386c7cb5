"""How motion is shown, as a person asks for it: as it is, or with what a video may add.

None of it is in a user study.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from app.errors import RunError

Coloring = Literal["natural", "jerk"]
COLORINGS: tuple[Coloring, ...] = get_args(Coloring)
FACTORS = (1, 5, 20)
"""By how much tremble may be multiplied."""


@dataclass(frozen=True)
class Display:
    """How motion is shown, for all videos of a comparison alike."""

    exaggeration: int = 1
    """One of `FACTORS`."""
    has_trail: bool = False
    """Of the followed point, over the last second."""
    coloring: Coloring = "natural"
    """``jerk``: each region of the body by how it jerks."""

    @property
    def is_plain(self) -> bool:
        return self == Display()


def check_display(display: Display) -> None:
    """Refuse what cannot be shown.

    Raises:
        RunError: with one sentence.
    """
    if display.exaggeration not in FACTORS:
        factors = ", ".join(str(factor) for factor in FACTORS)
        raise RunError(
            f"Tremble can be shown {factors} times as large; got {display.exaggeration}."
        )
    if display.coloring not in COLORINGS:
        raise RunError(
            f"There is no colouring {display.coloring!r}; choose one of {', '.join(COLORINGS)}."
        )
