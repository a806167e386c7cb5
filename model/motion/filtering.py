"""The Savitzky-Golay filter of the official GlobalDiff inference, on stitched sequences."""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float, Float32
from scipy.signal import savgol_filter
from torch import Tensor

from conventions.joints import NUM_JOINTS
from conventions.names import PostFilter
from model.motion.motion import Motion
from model.motion.rotations import (
    axis_angle_from_matrix,
    matrix_from_axis_angle,
    matrix_from_rot6d,
    rot6d_from_matrix,
)

SAVGOL_FRAMES = 7
SAVGOL_ORDER = 2


def smooth_over_time(
    values: Float[np.ndarray, " T *channels"],
) -> Float[np.ndarray, " T *channels"]:
    """Savitzky-Golay, 7 frames, order 2, in double precision.

    Under 5 frames it changes nothing; under 7 it uses 5.
    """
    window = min(SAVGOL_FRAMES, len(values) - 1 + len(values) % 2)
    if window <= SAVGOL_ORDER + 1:
        return values.astype(np.float64)
    return np.asarray(savgol_filter(values.astype(np.float64), window, SAVGOL_ORDER, axis=0))


def smooth_rotations(rotmat: Float[Tensor, "T *joints 3 3"]) -> Float[Tensor, "T *joints 3 3"]:
    """The row-6D form filtered over time, then made a rotation again."""
    smooth = smooth_over_time(rot6d_from_matrix(rotmat).numpy())
    return matrix_from_rot6d(torch.from_numpy(smooth))


def filtered(motion: Motion, post_filter: PostFilter) -> Motion:
    """The motion as it is seen behind a filter."""
    return smooth_motion(motion) if post_filter == "savgol" else motion


def smooth_motion(motion: Motion) -> Motion:
    """The motion behind the filter: each local rotation, the translation and the expressions."""
    poses = np.empty_like(motion.poses)
    for joint in range(NUM_JOINTS):  # one at a time: memory stays small for long clips
        columns = slice(3 * joint, 3 * joint + 3)
        axis_angle = torch.tensor(motion.poses[:, columns], dtype=torch.float64)
        smooth = smooth_rotations(matrix_from_axis_angle(axis_angle))
        poses[:, columns] = axis_angle_from_matrix(smooth).numpy()

    def filtered(values: Float32[np.ndarray, "T C"]) -> Float32[np.ndarray, "T C"]:
        return smooth_over_time(values).astype(np.float32)

    return replace(
        motion,
        poses=poses,
        trans=filtered(motion.trans),
        expressions=filtered(motion.expressions),
    )
