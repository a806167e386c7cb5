"""What is shown beyond the body as it moves: a trail, jerk as colour, tremble made large.

A person asks for it, on the command line or by what a stage shows, and videos have it. Scales are
the same for all videos of a comparison. None of it is in a user study.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal, Protocol, get_args

from pydantic import BaseModel, ConfigDict, Field
from pydantic.alias_generators import to_camel
from tyro.conf import Suppress, arg

from app.errors import RunError
from app.flags import one_of
from app.run.body_motion import body_motion

if TYPE_CHECKING:
    import numpy as np

    from model.motion.motion import Motion
    from renderer.body.body import Body
    from renderer.video.marks import Heat, Marks, Trail


Coloring = Literal["natural", "jerk"]
COLORINGS: tuple[Coloring, ...] = get_args(Coloring)
EXAGGERATIONS = (1, 5, 20)
"""What can be asked for on a command line; a stage has a slider."""
FULL_SPEED_M_S = 1.5
"""Recorded speakers' fingertips are faster in one frame of fifty."""
_HEAT_SIGMA_FRAMES = 3.0
"""Jerk of one frame is chance, and would flicker."""


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

    @property
    def is_plain(self) -> bool:
        return self.exaggeration == 1 and not self.has_trail and self.coloring == "natural"


LIMITS: Mapping[str, tuple[float, float, str]] = {
    "exaggeration": (1.0, 20.0, "Tremble can be shown {} times as large"),
    "cutoff_hz": (3.0, 8.0, "Tremble can be what is faster than {} Hz"),
    "trail_frames": (5, 90, "A trail can be {} frames long"),
    "jerk_m_s3": (50.0, 2000.0, "The scale of jerk can end at {} m/s³"),
}
"""By the field of `Display` the least, the most, and what is said of a value beyond them, which go
between its braces; the stage has the same."""


def check_display(display: Display) -> None:
    """Refuse what cannot be shown.

    Raises:
        RunError: with one sentence.
    """
    for name, (least, most, refusal) in LIMITS.items():
        value = getattr(display, name)
        if not least <= value <= most:
            raise RunError(f"{refusal.format(f'{least:g} to {most:g}')}; got {value:g}.")
    if display.coloring not in COLORINGS:
        raise RunError(
            f"There is no colouring {display.coloring!r}; choose one of {', '.join(COLORINGS)}."
        )


class FromBrowser(BaseModel):
    """What a browser tells, by the names that its scripts have."""

    model_config = ConfigDict(
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        str_max_length=500,
        alias_generator=to_camel,
        validate_by_name=True,
    )


class Look(FromBrowser):
    """How a stage shows bodies (app/page/web/stage/look.js)."""

    exaggeration: float = Field(default=1.0, alias="factor")
    cutoff_hz: float = Field(default=5.0, alias="cutoff")
    has_trail: bool = False
    trail_frames: int = 30
    has_heat: bool = False
    jerk_m_s3: float = Field(default=500.0, alias="heatScale")
    point: str = "right_middle"
    """Of the trail."""
    is_aligned: bool = True
    """Whether the second of a pair stands where the first does, pelvis on pelvis."""
    is_whole: bool = False
    """All of the body rather than from the knees up."""
    tone: str = "light"
    """One of `TONES`; of the open body alone."""
    build: str = "average"
    """One of `BUILDS`; of the open body alone."""
    has_bones: bool = False
    has_axes: bool = False
    """Skeletons and axes lie over the bodies; a video has none, and says so."""

    @property
    def display(self) -> Display:
        names = (*LIMITS, "has_trail")
        coloring: Coloring = "jerk" if self.has_heat else "natural"
        return Display(coloring=coloring, **{name: getattr(self, name) for name in names})


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
