"""Motion at another speed: the same path, walked faster or slower at 30 frames per second."""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from model.motion.motion import Motion
from model.motion.rotations import axis_angle_from_matrix, interpolate_rotations


def motion_at_speed(motion: Motion, speed: float) -> Motion:
    """``speed`` times as fast: frame k shows what was at frame ``k * speed``.

    Rotations are interpolated by slerp, everything else linearly. The last frame lies at or up to
    one new frame before the last one there was.
    """
    num_frames = int((motion.num_frames - 1) / speed + 1e-6) + 1
    time = np.minimum(np.arange(num_frames) * speed, motion.num_frames - 1)  # in old frames
    before = np.minimum(time.astype(int), max(motion.num_frames - 2, 0))
    after = np.minimum(before + 1, motion.num_frames - 1)
    weight = (time - before).astype(np.float32)
    rotmat = motion.local_rotations()
    at_time = interpolate_rotations(
        rotmat[before], rotmat[after], torch.from_numpy(weight)[:, None]
    )

    def blend(rows: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "S C"]:
        return rows[before] + weight[:, None] * (rows[after] - rows[before])

    return replace(
        motion,
        poses=axis_angle_from_matrix(at_time).flatten(1).numpy(),
        trans=blend(motion.trans),
        expressions=blend(motion.expressions),
    )
