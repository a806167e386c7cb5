"""The three figures, and how the others are fitted to the skeleton of the first.

All builds share one skeleton, one topology and one set of weights: a motion has the same joints
and fingertips on each, and a build is no more than an offset for each vertex.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from conventions.joints import FINGERS, JOINT_INDEX, NUM_JOINTS
from tools.bake.makehuman import Figure, MakeHuman
from tools.bake.skinning import dual_quaternion_blend, posed_joints
from tools.bake.zero_pose import finger_tips, joints_in_a_pose, rotations_to_zero_pose

_AVERAGE = Figure(
    gender=0.66,
    age=0.03,
    muscle=0.52,
    weight=0.47,
    height=0.40,
    proportions=0.6,
    cup=0.0,
    firmness=0.6,
)
FIGURES = {
    "average": _AVERAGE,
    "slender": replace(_AVERAGE, gender=0.0, muscle=0.35, weight=0.25, cup=0.5),
    "broad": replace(_AVERAGE, gender=1.0, age=0.3, muscle=0.8, weight=0.85),
}
"""By the names in ``renderer.body.look.BUILDS``; the skeleton is that of the first."""

LEG_LENGTH_M = 0.7845
"""Hip to ankle along the leg, as in SMPL-X's mean body."""
PELVIS_M = (0.0, -0.3514, 0.012)
"""Where SMPL-X's mean body has its pelvis."""

# The joint that each bone ends in, where one joint alone carries it on.
_BONE_END = {
    "spine1": "spine2",
    "spine2": "spine3",
    "spine3": "neck",
    **{
        f"{side}_{start}": f"{side}_{end}"
        for side in ("left", "right")
        for start, end in (
            *(("collar", "shoulder"), ("shoulder", "elbow"), ("elbow", "wrist")),
            *(("wrist", "middle1"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "foot")),
            *((f"{finger}{k}", f"{finger}{k + 1}") for finger in FINGERS for k in (1, 2)),
        )
    },
}
_FEET = [JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("ankle", "foot")]
_HEAD = ("head", "jaw", "left_eye", "right_eye")


@dataclass(frozen=True)
class Posed:
    """One figure in the zero pose, metres, its pelvis where SMPL-X has it."""

    vertices: Float[np.ndarray, "N 3"]
    joints: Float[np.ndarray, "J 3"]
    head_transform: Float[np.ndarray, "3 3"]
    """What turned and scaled the head."""


def in_zero_pose(source: MakeHuman, figure: Figure, weights: Float[np.ndarray, "N J"]) -> Posed:
    """The whole base mesh of ``figure``; ``weights`` as from ``joint_weights``."""
    vertices = source.shape(figure)
    joints = joints_in_a_pose(source, vertices)
    rotations = rotations_to_zero_pose(joints, finger_tips(source, vertices))
    posed = dual_quaternion_blend(vertices, weights, joints, rotations)
    rest = posed_joints(joints, rotations)
    hip, knee, ankle = (rest[JOINT_INDEX[f"left_{name}"]] for name in ("hip", "knee", "ankle"))
    scale = LEG_LENGTH_M / (np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))
    shift = PELVIS_M - scale * rest[JOINT_INDEX["pelvis"]]
    return Posed(
        posed * scale + shift, rest * scale + shift, rotations[JOINT_INDEX["head"]] * scale
    )


def on_skeleton(
    posed: Posed, first: Posed, weights: Float[np.ndarray, "N J"]
) -> Float[np.ndarray, "N 3"]:
    """The vertices of ``posed`` with its bones moved and stretched onto the joints of ``first``.

    The head keeps its shape: it is moved and scaled as a whole until its eyes are in place.
    The soles come to stand as high as those of ``first``.
    """
    target = first.joints
    stretch = np.tile(np.eye(3), (NUM_JOINTS, 1, 1))
    old_anchor, new_anchor = posed.joints.copy(), target.copy()
    for start, end in _BONE_END.items():
        bone, wanted = (
            joints[JOINT_INDEX[end]] - joints[JOINT_INDEX[start]]
            for joints in (posed.joints, target)
        )
        stretch[JOINT_INDEX[start]] += np.outer(wanted - bone, bone) / (bone @ bone)
    eyes = [JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]]
    apart = [np.linalg.norm(joints[eyes[0]] - joints[eyes[1]]) for joints in (posed.joints, target)]
    for name in _HEAD:
        stretch[JOINT_INDEX[name]] *= apart[1] / apart[0]
        old_anchor[JOINT_INDEX[name]] = posed.joints[eyes].mean(0)
        new_anchor[JOINT_INDEX[name]] = target[eyes].mean(0)
    shift = new_anchor - np.einsum("jab,jb->ja", stretch, old_anchor)
    blended = np.tensordot(weights, stretch, 1)
    moved = np.einsum("vab,vb->va", blended, posed.vertices) + weights @ shift
    foot_share = weights[:, _FEET].sum(1)
    is_foot = foot_share > 0.5
    moved[:, 1] += foot_share * (first.vertices[is_foot, 1].min() - moved[is_foot, 1].min())
    return moved
