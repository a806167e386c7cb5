"""How much each joint jerks around the snapshots of Figure 6, and where it is in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from renderer.body.body import Body, BodyMotion
    from renderer.figures.figure6.figure6 import JointMarks
    from renderer.scene.stage import Stage
    from renderer.video.render import RenderSettings

AROUND_FRAMES = 8
"""Jerk of one frame is chance; the mean over about half a second around a snapshot is told."""
LEAST_FULL_SCALE = 500.0
"""In m/s³. Recorded speakers reach this with a hand in quick gestures: what is smooth stays pale,
however smooth the other motions are."""
_PERCENTILE = 98.0


def jerk_marks(
    body: Body,
    motions: Mapping[str, BodyMotion],
    frames: Sequence[int],
    settings: RenderSettings,
    stage: Stage,
) -> JointMarks:
    """Marks for the snapshots of these motions at some frames, all on one scale.

    The full scale is a round number that nearly all values stay under.
    """
    from renderer.figures.figure6.figure6 import JointMarks
    from renderer.video.projection import projected_joints

    values = {name: _jerk_around(body, motion, frames) for name, motion in motions.items()}
    highest = float(np.percentile(np.concatenate(list(values.values())), _PERCENTILE))
    return JointMarks(
        pixels={
            name: projected_joints(body, motion, frames, settings, stage)
            for name, motion in motions.items()
        },
        values=values,
        full_scale=_round_up(max(highest, LEAST_FULL_SCALE)),
    )


def _jerk_around(body: Body, motion: BodyMotion, frames: Sequence[int]) -> np.ndarray:
    """Mean jerk of each joint around each frame, (N, J) in m/s³; 0 in a clip under 4 frames."""
    from model.measures.smoothness import derivative_magnitudes
    from renderer.scene.stage import frames_of

    found = []
    for frame in frames:
        near = slice(max(0, frame - AROUND_FRAMES), frame + AROUND_FRAMES + 1)
        jerk = derivative_magnitudes(body.joint_positions(frames_of(motion, near)), 3)
        found.append(jerk.mean(axis=0) if len(jerk) else np.zeros(jerk.shape[1]))
    return np.stack(found)


def _round_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value))
