"""Analytic inverse kinematics of two free bones, for arms."""

import numpy as np
from jaxtyping import Float

from model.motion.limb import hinge_frame, unit


def two_bone_ik(
    root: Float[np.ndarray, "T 3"],
    target: Float[np.ndarray, "T 3"],
    upper: Float[np.ndarray, " 3"],
    lower: Float[np.ndarray, " 3"],
    hinge: Float[np.ndarray, " 3"],
    pole: Float[np.ndarray, "T 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]:
    """Rotations of both bones that bring the lower bone's end to the target.

    A target near or past full stretch is approached softly, so that the middle joint never snaps.

    Args:
        root: where the upper bone begins.
        target: where the lower bone shall end.
        upper: the upper bone at rest.
        lower: the lower bone at rest.
        hinge: the middle joint's axis at rest.
        pole: the direction in which the middle joint lies off the line from root to target.

    Returns:
        The upper bone's rotation, the lower bone's rotation, the lower bone's unit direction.
    """
    a, b = np.linalg.norm(upper), np.linalg.norm(lower)
    reach = target - root
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    limit = 0.985 * (a + b)
    soft = limit - 0.06 * (a + b)
    bent = soft + (limit - soft) * (1 - np.exp(-(distance - soft) / (limit - soft)))
    distance = np.maximum(np.where(distance > soft, bent, distance), abs(a - b) + 0.05)
    towards = unit(reach)
    along = (a * a - b * b + distance**2) / (2 * distance)
    height = np.sqrt(np.maximum(a * a - along**2, 1e-8))
    aside = unit(pole - (pole * towards).sum(-1, keepdims=True) * towards)
    middle = towards * along + aside * height
    upper_direction = unit(middle)
    lower_direction = unit(towards * distance - middle)
    upper_rot, lower_rot = bone_rotations(upper_direction, lower_direction, upper, lower, hinge)
    return upper_rot, lower_rot, lower_direction


def bone_rotations(
    upper_direction: Float[np.ndarray, "T 3"],
    lower_direction: Float[np.ndarray, "T 3"],
    upper: Float[np.ndarray, " 3"],
    lower: Float[np.ndarray, " 3"],
    hinge: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
    """Rotations that turn two bones there and the hinge between them across both."""
    axis = unit(np.cross(upper_direction, lower_direction))
    upper_rest = hinge_frame(upper[None], hinge[None])[0]
    lower_rest = hinge_frame(lower[None], hinge[None])[0]
    upper_rot = hinge_frame(upper_direction, axis) @ upper_rest.T
    return upper_rot, hinge_frame(lower_direction, axis) @ lower_rest.T
