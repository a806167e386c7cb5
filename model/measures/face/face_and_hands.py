"""Do face and hands move together? Brows and head with the strokes of the hands."""

import numpy as np
import torch
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.measures.face.face_measures import unit_columns
from model.measures.lagged_correlation import lagged_correlation
from model.motion.motion import Motion
from model.motion.rotations import axis_angle_from_matrix, matrix_from_axis_angle

SHIFT_S = 4.0
"""By which a track is shifted in a circle, to know what chance gives."""
_WRISTS = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]


def face_and_hands(motion: Motion, joints: Float[np.ndarray, "T 55 3"]) -> dict[str, float]:
    """``brow_with_hands`` and ``head_with_hands``: correlation of the inner brow's raise, and of
    the head's angular speed, with the speed of the wrists, less that of the same face 4 s later in
    a circle. Above 0: they move together more than chance has it. A motion in FLAME's coefficients
    has no brow, one of less than 8 s neither.

    Args:
        joints: in metres; the pelvis may be in place.
    """
    if motion.num_frames < 2 * SHIFT_S * FPS:
        return {}
    hands = wrist_speed(joints)
    found = {"head_with_hands": _beyond_chance(head_speed(motion), hands)}
    if motion.expression_basis == "arkit52":
        brow = motion.expressions[1:, unit_columns("browInnerUp")].mean(1)
        found["brow_with_hands"] = _beyond_chance(brow, hands)
    return found


def wrist_speed(joints: Float[np.ndarray, "T 55 3"]) -> Float[np.ndarray, " T1"]:
    """Of both wrists together, m/s, from each frame to the next."""
    return np.linalg.norm(np.diff(joints[:, _WRISTS], axis=0), axis=-1).sum(-1) * FPS


def head_speed(motion: Motion) -> Float[np.ndarray, " T1"]:
    """Angular speed of the head against the chest, rad/s, from each frame to the next."""
    poses = torch.from_numpy(motion.poses).unflatten(-1, (-1, 3))
    neck, head = (matrix_from_axis_angle(poses[:, JOINT_INDEX[n]]) for n in ("neck", "head"))
    turned = neck @ head
    steps = axis_angle_from_matrix(turned[:-1].mT @ turned[1:])
    return steps.norm(dim=-1).numpy() * FPS


def _beyond_chance(face: Float[np.ndarray, " N"], hands: Float[np.ndarray, " N"]) -> float:
    later = np.roll(face, round(SHIFT_S * FPS))
    return lagged_correlation(face, hands) - lagged_correlation(later, hands)
