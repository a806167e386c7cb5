"""How often a hand is inside the body, on the open body's measures.

Trunk and thighs are stacks of ellipses in the rest pose. A point is carried back into the rest
pose by the joint that moves that part of the stack.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from conventions.joints import JOINT_INDEX
from tools.corpus.people.rig import Rig
from tools.corpus.report.statistics import PosedClip


@dataclass(frozen=True)
class Part:
    """The part of a stack between two heights of the rest pose, and the joint that moves it."""

    joint: str
    bottom_m: float
    top_m: float
    stack: str


STACKS: dict[str, Float[np.ndarray, "E 5"]] = {
    # height, centre (x, z) and half axes (x, z) in metres, measured on the open body's mesh
    "trunk": np.array(
        [
            [-0.45, 0.0, 0.045, 0.178, 0.111],
            [-0.35, 0.0, 0.059, 0.164, 0.116],
            [-0.25, 0.0, 0.068, 0.148, 0.104],
            [-0.15, 0.0, 0.055, 0.148, 0.108],
            [-0.05, 0.0, 0.037, 0.179, 0.120],
            [0.00, 0.0, 0.026, 0.186, 0.117],
            [0.05, 0.0, 0.009, 0.162, 0.099],
            [0.10, 0.0, -0.001, 0.133, 0.075],
        ]
    ),
    "left thigh": np.array(
        [
            [-0.80, 0.128, 0.014, 0.066, 0.075],
            [-0.70, 0.116, 0.033, 0.077, 0.080],
            [-0.60, 0.106, 0.045, 0.089, 0.092],
            [-0.50, 0.094, 0.045, 0.095, 0.095],
        ]
    ),
}
STACKS["right thigh"] = STACKS["left thigh"] * np.array([1.0, -1.0, 1.0, 1.0, 1.0])

PARTS = (
    Part("pelvis", -0.45, -0.241, "trunk"),
    Part("spine1", -0.241, -0.111, "trunk"),
    Part("spine2", -0.111, -0.057, "trunk"),
    Part("spine3", -0.057, 0.10, "trunk"),
    Part("left_hip", -0.80, -0.45, "left thigh"),
    Part("right_hip", -0.80, -0.45, "right thigh"),
)
HAND_JOINTS = (
    JOINT_INDEX["left_wrist"],
    JOINT_INDEX["right_wrist"],
    *range(JOINT_INDEX["left_index1"], 55),
)


def hand_inside_share(clip: PosedClip, rig: Rig) -> float:
    """Share of frames in which a hand's joint or fingertip lies inside the trunk or a thigh.

    Joints lie about a centimetre under the skin, so a hand that rests on the body is not inside.
    """
    tip_joints = list(rig.tip_joints)
    reach = np.einsum("tjab,jb->tja", clip.global_rot[:, tip_joints], rig.tip_offsets)
    tips = clip.positions[:, tip_joints] + reach
    points = np.concatenate([clip.positions[:, HAND_JOINTS], tips], axis=1)
    inside = np.zeros(points.shape[:2], dtype=bool)
    for part in PARTS:
        joint = JOINT_INDEX[part.joint]
        offset = points - clip.positions[:, joint, None]
        at_rest = offset @ clip.global_rot[:, joint] + rig.rest_joints[joint]
        inside |= _in_part(at_rest, part)
    return float(inside.any(axis=1).mean())


def _in_part(points: Float[np.ndarray, "T P 3"], part: Part) -> Bool[np.ndarray, "T P"]:
    x, height, z = np.moveaxis(points, -1, 0)
    stack = STACKS[part.stack]
    centre_x, centre_z, half_x, half_z = (
        np.interp(height, stack[:, 0], column) for column in stack[:, 1:].T
    )
    in_ellipse = ((x - centre_x) / half_x) ** 2 + ((z - centre_z) / half_z) ** 2 < 1
    return in_ellipse & (height >= part.bottom_m) & (height < part.top_m)
