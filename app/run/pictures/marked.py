"""What videos show beyond the body as it moves: a trail, jerk as colour, tremble made large.

Scales are the same for all videos of a comparison.
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

FULL_SPEED_M_S = 1.5
"""Recorded speakers' fingertips are faster in one frame of fifty."""
_HEAT_SIGMA_FRAMES = 3.0
"""Jerk of one frame is chance, and would flicker."""


def displayed(motion: Motion, display: Display) -> Motion:
    """The motion as it is drawn."""
    from model.motion.exaggeration import exaggerate

    return exaggerate(motion, display.exaggeration, display.cutoff_hz)


def marks_of(motion: Motion, display: Display, tip: TipSource, body: Body) -> Marks | None:
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
        is_spike=jerk > display.jerk_m_s3,
        legend=f"0 to {FULL_SPEED_M_S:g} m/s, dot: jerk over {display.jerk_m_s3:g} m/s³",
        close_up=f"{side}_hand" if side in ("left", "right") else "",
        num_frames=display.trail_frames,
    )


def _heat(motion: Motion, display: Display, body: Body) -> Heat:
    from scipy import ndimage  # only where something is smoothed: the page starts without

    from app.run.body_motion import body_motion
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
    if not len(values):
        return np.zeros((num_frames, *values.shape[1:]))
    before = (num_frames - len(values)) // 2
    return values[np.clip(np.arange(num_frames) - before, 0, len(values) - 1)]
