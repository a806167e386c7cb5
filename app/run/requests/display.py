"""What is shown beyond the body as it moves: a trail, jerk as colour, tremble made large.

A person asks for it, on the command line or by what a stage shows, and videos have it. Scales are
the same for all videos of a comparison. None of it is in a user study.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, get_args

from tyro.conf import Suppress, arg

from app.errors import RunError
from app.flags import one_of
from app.run.body_motion import body_motion

if TYPE_CHECKING:
    import numpy as np

    from model.motion.motion import Motion
    from renderer.body.body import Body
    from renderer.video.marks import Heat, Marks, Trail


def finite(value: object) -> float:
    """A number of a client's.

    Raises:
        ValueError: if it is none.
    """
    try:
        if not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    except OverflowError:  # JSON has whole numbers of any length
        raise ValueError("A whole number of hundreds of digits is no number.") from None
    raise ValueError(f"{value!r} is no number.")


def whole(value: object) -> int:
    """A whole number of a client's.

    Raises:
        ValueError: if it is none.
    """
    number = finite(value)
    if number != int(number):
        raise ValueError(f"{number:g} is no whole number.")
    return int(number)


Coloring = Literal["natural", "jerk"]
COLORINGS: tuple[Coloring, ...] = get_args(Coloring)
EXAGGERATIONS = (1, 5, 20)
"""What can be asked for on a command line; a stage has a slider."""
FULL_SPEED_M_S = 1.5
"""Recorded speakers' fingertips are faster in one frame of fifty."""
_HEAT_SIGMA_FRAMES = 3.0
"""Jerk of one frame is chance, and would flicker."""


@dataclass(frozen=True)
class Told:
    """How the stage tells a field of `Display`, and what that may be."""

    name: str
    """As app/page/web/stage/look.js has it."""
    read: Callable[[object], Any]
    """Gives the field; raises ValueError of what cannot be it."""
    limits: tuple[float, float] | None = None
    """The least and the most. The stage has the same."""
    refusal: str = ""
    """What is said of a value beyond the limits, which go between its braces."""


def _is_true(told: object) -> bool:
    return told is True


def _coloring(told: object) -> Coloring:
    return "jerk" if told is True else "natural"


@dataclass(frozen=True)
class Display:
    """How motion is shown, for all videos of a comparison alike."""

    exaggeration: Annotated[float, one_of(EXAGGERATIONS), arg(name="exaggerate")] = 1.0
    """Draw tremble, all above 5 Hz, so many times as large, and say so in the picture."""
    has_trail: Annotated[bool, arg(name="trail")] = False
    """The way of the followed point through the last second, coloured by its speed."""
    coloring: Annotated[Coloring, arg(name="color")] = "natural"
    """jerk: each region of the body by how much it jerks."""
    cutoff_hz: Suppress[float] = 5.0
    """What is faster is tremble."""
    trail_frames: Suppress[int] = 30
    """How long a trail is."""
    jerk_m_s3: Suppress[float] = 500.0
    """Where the scale of the colours ends, and a trail has a dot. Recorded speakers' fingertips
    jerk more than the usual one in one frame of a hundred."""

    @classmethod
    def of_look(cls, look: Mapping[str, Any]) -> Display:
        """
        Args:
            look: what a browser tells of its stage, by the names of app/page/web/stage/look.js.

        Raises:
            ValueError, TypeError, KeyError: if it is anything else.
        """
        return cls(**{name: told.read(look[told.name]) for name, told in TOLD.items()})

    @property
    def is_plain(self) -> bool:
        return self.exaggeration == 1 and not self.has_trail and self.coloring == "natural"


TOLD: Mapping[str, Told] = {
    "exaggeration": Told("factor", finite, (1.0, 20.0), "Tremble can be shown {} times as large"),
    "has_trail": Told("hasTrail", _is_true),
    "coloring": Told("hasHeat", _coloring),
    "cutoff_hz": Told("cutoff", finite, (3.0, 8.0), "Tremble can be what is faster than {} Hz"),
    "trail_frames": Told("trailFrames", whole, (5, 90), "A trail can be {} frames long"),
    "jerk_m_s3": Told("heatScale", finite, (50.0, 2000.0), "The scale of jerk can end at {} m/s³"),
}
"""By the field of `Display`."""


def check_display(display: Display) -> None:
    """Refuse what cannot be shown.

    Raises:
        RunError: with one sentence.
    """
    for name, told in TOLD.items():
        value = getattr(display, name)
        if told.limits is not None and not told.limits[0] <= value <= told.limits[1]:
            least, most = told.limits
            raise RunError(f"{told.refusal.format(f'{least:g} to {most:g}')}; got {value:g}.")
    if display.coloring not in COLORINGS:
        raise RunError(
            f"There is no colouring {display.coloring!r}; choose one of {', '.join(COLORINGS)}."
        )


class Followed(Protocol):
    """The point of a trail; such is an `app.run.followed_point.TipSource`."""

    @property
    def point(self) -> str: ...

    def track(self, motion: Motion) -> np.ndarray: ...


def displayed(motion: Motion, display: Display) -> Motion:
    """The motion as it is drawn."""
    from model.motion.altered import exaggerate

    return exaggerate(motion, display.exaggeration, display.cutoff_hz)


def marks_of(motion: Motion, display: Display, tip: Followed, body: Body) -> Marks | None:
    """What stands in the pictures of a motion; None where it is shown as it is.

    Jerk and speed are those of the motion itself, also where it is drawn with its tremble
    multiplied.
    """
    from renderer.video.marks import Marks

    if display.is_plain:
        return None
    factor, cutoff = (f"{round(value, 1):g}" for value in (display.exaggeration, display.cutoff_hz))
    is_larger = display.exaggeration != 1
    return Marks(
        trail=_trail(motion, display, tip) if display.has_trail else None,
        heat=_heat(motion, display, body) if display.coloring == "jerk" else None,
        notice=f"EXAGGERATED x{factor}: all above {cutoff} Hz" if is_larger else "",
        tag=f"x{factor}" if is_larger else "",
    )


def _trail(motion: Motion, display: Display, tip: Followed) -> Trail:
    import numpy as np

    from model.measures.smoothness import derivative_magnitudes
    from renderer.video.marks import Trail

    track = tip.track(motion)
    speed = _by_frame(derivative_magnitudes(track, 1), len(track))
    jerk = _by_frame(derivative_magnitudes(track, 3), len(track))
    side = tip.point.split("_")[0]
    return Trail(
        points=track if display.exaggeration == 1 else tip.track(displayed(motion, display)),
        speeds=np.minimum(speed / FULL_SPEED_M_S, 1.0),
        is_spike=jerk > display.jerk_m_s3,
        legend=f"0 to {FULL_SPEED_M_S:g} m/s, dot: jerk over {display.jerk_m_s3:g} m/s³",
        close_up=f"{side}_hand" if side in ("left", "right") else "",
        num_frames=display.trail_frames,
    )


def _heat(motion: Motion, display: Display, body: Body) -> Heat:
    import numpy as np
    from scipy import ndimage  # only where something is smoothed: the page starts without

    from model.measures.smoothness import derivative_magnitudes
    from renderer.video.marks import Heat

    jerk = derivative_magnitudes(body.joint_positions(body_motion(motion)), 3)
    of_frame = _by_frame(jerk, motion.num_frames)
    smooth = ndimage.gaussian_filter1d(of_frame, _HEAT_SIGMA_FRAMES, axis=0, mode="nearest")
    shares = np.minimum(smooth / display.jerk_m_s3, 1.0)
    return Heat(shares.astype(np.float32), f"jerk: 0 to {display.jerk_m_s3:g} m/s³")


def _by_frame(values: np.ndarray, num_frames: int) -> np.ndarray:
    """A value for each frame: of the difference that has it in its middle, at the ends the nearest;
    0 in a clip too short to have any."""
    import numpy as np

    if not len(values):
        return np.zeros((num_frames, *values.shape[1:]))
    before = (num_frames - len(values)) // 2
    return values[np.clip(np.arange(num_frames) - before, 0, len(values) - 1)]
