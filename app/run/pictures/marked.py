"""What videos show beyond the body as it moves: a trail, jerk as colour, tremble made large.

All scales are fixed, so that any two videos can be compared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from app.run.display import Display

if TYPE_CHECKING:
    from app.run.pictures.followed_point import TipSource
    from model.motion.motion import Motion
    from renderer.body.body import Body
    from renderer.video.marks import Heat, Marks, Trail

SPIKE_M_S3 = 500.0
"""Recorded speakers' fingertips jerk more in one frame of a hundred; here a trail has a dot, and
the scale of the colours ends."""
FULL_SPEED_M_S = 1.5
"""Recorded speakers' fingertips are faster in one frame of fifty."""
_HEAT_SIGMA_FRAMES = 3.0
"""Jerk of one frame is chance, and would flicker."""


def displayed(motion: Motion, display: Display) -> Motion:
    """The motion as it is drawn."""
    from model.motion.exaggeration import exaggerate

    return exaggerate(motion, display.exaggeration)


def marks_of(motion: Motion, display: Display, tip: TipSource, body: Body) -> Marks | None:
    """What stands in the pictures of a motion; None where it is shown as it is.

    Jerk and speed are those of the motion itself, also where it is drawn with its tremble
    multiplied.
    """
    from model.motion.exaggeration import CUTOFF_HZ
    from renderer.video.marks import Marks

    if display.is_plain:
        return None
    factor = display.exaggeration
    return Marks(
        trail=_trail(motion, display, tip) if display.has_trail else None,
        heat=_heat(motion, body) if display.coloring == "jerk" else None,
        notice=f"EXAGGERATED x{factor}: all above {CUTOFF_HZ:g} Hz" if factor != 1 else "",
        tag=f"x{factor}" if factor != 1 else "",
    )


def _trail(motion: Motion, display: Display, tip: TipSource) -> Trail:
    from model.measures.smoothness import derivative_magnitudes
    from renderer.video.marks import Trail

    track = tip.track(motion)
    speed = _by_frame(derivative_magnitudes(track, 1), len(track))
    jerk = _by_frame(derivative_magnitudes(track, 3), len(track))
    side = tip.point.split("_")[0]
    return Trail(
        points=track if display.exaggeration == 1 else tip.track(displayed(motion, display)),
        speeds=np.minimum(speed / FULL_SPEED_M_S, 1.0),
        is_spike=jerk > SPIKE_M_S3,
        legend=f"0 to {FULL_SPEED_M_S:g} m/s, dot: jerk over {SPIKE_M_S3:g} m/s³",
        close_up=f"{side}_hand" if side in ("left", "right") else "",
    )


def _heat(motion: Motion, body: Body) -> Heat:
    from scipy import ndimage  # only where something is smoothed: the page starts without

    from app.run.pictures.export import body_motion
    from model.measures.smoothness import derivative_magnitudes
    from renderer.video.marks import Heat

    jerk = derivative_magnitudes(body.joint_positions(body_motion(motion)), 3)
    of_frame = _by_frame(jerk, motion.num_frames)
    smooth = ndimage.gaussian_filter1d(of_frame, _HEAT_SIGMA_FRAMES, axis=0, mode="nearest")
    shares = np.minimum(smooth / SPIKE_M_S3, 1.0)
    return Heat(shares.astype(np.float32), f"jerk: 0 to {SPIKE_M_S3:g} m/s³")


def _by_frame(values: np.ndarray, num_frames: int) -> np.ndarray:
    """A value for each frame: of the difference that has it in its middle, at the ends the nearest;
    0 in a clip too short to have any."""
    if not len(values):
        return np.zeros((num_frames, *values.shape[1:]))
    before = (num_frames - len(values)) // 2
    return values[np.clip(np.arange(num_frames) - before, 0, len(values) - 1)]
