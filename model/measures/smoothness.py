"""Derivatives of points and joints over time, and their means; positions in metres, 30 fps."""

import numpy as np
import torch
from jaxtyping import Float

from conventions.joints import JOINT_DEPTH
from conventions.rates import FPS
from model.motion.rotations import axis_angle_from_matrix

STILL_M_S3 = 1e-6
"""Jerk of rounding errors: below it nothing moves, and a ratio means nothing."""

_ROTATION_CHUNK = 2048


def derivative_magnitudes(
    positions: Float[np.ndarray, " T *points 3"], order: int
) -> Float[np.ndarray, " entries *points"]:
    """Length of the ``order``-th difference per unit time: m/s, m/s^2, m/s^3 for 1, 2, 3.

    Entry i comes from frames i to i + order. Shorter clips give no entries.
    """
    differences = np.diff(positions.astype(np.float64), n=order, axis=0) * float(FPS) ** order
    return np.linalg.norm(differences, axis=-1)


def mean_over_time(values: Float[np.ndarray, " T *points"]) -> Float[np.ndarray, " *points"]:
    """Mean of the first axis; NaN where there are no frames."""
    return np.asarray(values.mean(axis=0)) if len(values) else np.full(values.shape[1:], np.nan)


def angular_velocity(
    rotmat: Float[np.ndarray, "T *joints 3 3"],
) -> Float[np.ndarray, "steps *joints 3"]:
    """rad/s in the moving joint's own axes: the turn from each frame to the next, times 30."""
    steps = np.empty((max(0, len(rotmat) - 1), *rotmat.shape[1:-1]))
    for start in range(0, len(steps), _ROTATION_CHUNK):
        part = torch.from_numpy(rotmat[start : start + _ROTATION_CHUNK + 1]).double()
        turn = part[:-1].transpose(-1, -2) @ part[1:]
        steps[start : start + _ROTATION_CHUNK] = axis_angle_from_matrix(turn).numpy() * FPS
    return steps


def mean_by_depth(by_joint: Float[np.ndarray, " 55"]) -> Float[np.ndarray, " 11"]:
    """Entry d is the mean over the joints that are d bones away from the pelvis."""
    depth = np.array(JOINT_DEPTH)
    return np.array([by_joint[depth == d].mean() for d in range(max(JOINT_DEPTH) + 1)])
