"""How motion is shown, as a person asks for it: as it is, or with what a video may add.

None of it is in a user study.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from app.errors import RunError

Coloring = Literal["natural", "jerk"]
COLORINGS: tuple[Coloring, ...] = get_args(Coloring)
EXAGGERATIONS = (1.0, 20.0)
"""By how much tremble may be multiplied: the least and the most. The stage has the same limits
(app/page/web/stage/look.js), also below."""
CUTOFFS_HZ = (3.0, 8.0)
TRAILS_FRAMES = (5, 90)
JERKS_M_S3 = (50.0, 2000.0)


@dataclass(frozen=True)
class Display:
    """How motion is shown, for all videos of a comparison alike."""

    exaggeration: float = 1.0
    """By what everything faster than the cut-off is multiplied; within `EXAGGERATIONS`."""
    has_trail: bool = False
    """Of the followed point, over the last moments."""
    coloring: Coloring = "natural"
    """``jerk``: each region of the body by how it jerks."""
    cutoff_hz: float = 5.0
    """Within `CUTOFFS_HZ`."""
    trail_frames: int = 30
    """How long a trail is; within `TRAILS_FRAMES`."""
    jerk_m_s3: float = 500.0
    """Where the scale of the colours ends, and a trail has a dot; within `JERKS_M_S3`. Recorded
    speakers' fingertips jerk more than the usual one in one frame of a hundred."""

    @property
    def is_plain(self) -> bool:
        return self.exaggeration == 1 and not self.has_trail and self.coloring == "natural"


def check_display(display: Display) -> None:
    """Refuse what cannot be shown.

    Raises:
        RunError: with one sentence.
    """
    for what, value, (least, most), unit in (
        ("Tremble can be shown", display.exaggeration, EXAGGERATIONS, "times as large"),
        ("Tremble can be what is faster than", display.cutoff_hz, CUTOFFS_HZ, "Hz"),
        ("A trail can be", display.trail_frames, TRAILS_FRAMES, "frames long"),
        ("The scale of jerk can end at", display.jerk_m_s3, JERKS_M_S3, "m/s³"),
    ):
        if not least <= value <= most:
            raise RunError(f"{what} {least:g} to {most:g} {unit}; got {value:g}.")
    if display.coloring not in COLORINGS:
        raise RunError(
            f"There is no colouring {display.coloring!r}; choose one of {', '.join(COLORINGS)}."
        )
