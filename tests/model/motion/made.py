"""Motions in which nothing moves but what a test moves."""

from typing import Any

import numpy as np

from conventions.joints import JOINT_INDEX
from model.motion.motion import ExpressionBasis, Motion


def about(axis: int, angle: Any) -> np.ndarray:
    """Axis-angle of a turn, or of one in each frame, about x, y or z."""
    axis_angle = np.zeros((*np.shape(angle), 3))
    axis_angle[..., axis] = angle
    return axis_angle


def along(axis: int, metres: np.ndarray) -> np.ndarray:
    return about(axis, metres)


def posed(
    num_frames: int,
    trans: Any = 0.0,
    units: Any = 0.0,
    basis: ExpressionBasis = "arkit52",
    **joints: Any,
) -> Motion:
    """The rest pose, but for the joints whose axis-angle (T, 3) or (3,) is given by name."""
    poses = np.zeros((num_frames, 55, 3), np.float32)
    for name, axis_angle in joints.items():
        poses[:, JOINT_INDEX[name]] = axis_angle
    return Motion(
        poses=poses.reshape(num_frames, 165),
        trans=np.broadcast_to(np.asarray(trans, np.float32), (num_frames, 3)).copy(),
        expressions=np.broadcast_to(np.asarray(units, np.float32), (num_frames, 100)).copy(),
        expression_basis=basis,
        betas=np.zeros(300, np.float32),
    )
