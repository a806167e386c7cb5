"""The 55 SMPL-X joints: names, parents, groups, mirror pairs and the rest skeleton.

Every index in the project is computed from a joint *name* here.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

JOINT_NAMES: tuple[str, ...] = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2",
    "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar",
    "right_collar", "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "jaw", "left_eye", "right_eye",
    *(
        f"{side}_{finger}{segment}"
        for side in ("left", "right")
        for finger in ("index", "middle", "pinky", "ring", "thumb")
        for segment in (1, 2, 3)
    ),
)  # fmt: skip
"""Names in SMPL-X order."""

NUM_JOINTS = len(JOINT_NAMES)
JOINT_INDEX: dict[str, int] = {name: index for index, name in enumerate(JOINT_NAMES)}

_PARENT_NAME: dict[str, str] = {
    "left_hip": "pelvis", "right_hip": "pelvis", "spine1": "pelvis",
    "left_knee": "left_hip", "right_knee": "right_hip", "spine2": "spine1",
    "left_ankle": "left_knee", "right_ankle": "right_knee", "spine3": "spine2",
    "left_foot": "left_ankle", "right_foot": "right_ankle",
    "neck": "spine3", "left_collar": "spine3", "right_collar": "spine3", "head": "neck",
    "left_shoulder": "left_collar", "right_shoulder": "right_collar",
    "left_elbow": "left_shoulder", "right_elbow": "right_shoulder",
    "left_wrist": "left_elbow", "right_wrist": "right_elbow",
    "jaw": "head", "left_eye": "head", "right_eye": "head",
}  # fmt: skip


def _parent_name(name: str) -> str:
    if name in _PARENT_NAME:
        return _PARENT_NAME[name]
    segment = int(name[-1])  # a finger joint such as left_index2
    return f"{name[:-1]}{segment - 1}" if segment > 1 else f"{name.split('_')[0]}_wrist"


PARENTS: tuple[int, ...] = (-1, *(JOINT_INDEX[_parent_name(name)] for name in JOINT_NAMES[1:]))
"""Parent index of each joint, -1 for the pelvis. A parent precedes its children."""


def chain_to_root(joint: int) -> tuple[int, ...]:
    """The joint, its parent, and so on up to the pelvis."""
    chain = [joint]
    while PARENTS[chain[-1]] >= 0:
        chain.append(PARENTS[chain[-1]])
    return tuple(chain)


JOINT_DEPTH: tuple[int, ...] = tuple(len(chain_to_root(joint)) - 1 for joint in range(NUM_JOINTS))
"""Number of bones between each joint and the pelvis (0 to 10)."""


def _indices(*names: str) -> tuple[int, ...]:
    return tuple(JOINT_INDEX[name] for name in names)


def _hand(side: str) -> tuple[int, ...]:
    return tuple(
        index
        for name, index in JOINT_INDEX.items()
        if name.startswith(f"{side}_") and name[-1].isdigit()
    )


LEFT_HAND = _hand("left")
RIGHT_HAND = _hand("right")
HANDS = LEFT_HAND + RIGHT_HAND
UPPER_BODY = _indices(
    "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
LOWER_BODY = _indices(
    "pelvis", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_foot", "right_foot",
)  # fmt: skip
FACE = _indices("jaw", "left_eye", "right_eye")


def _mirrored_name(name: str) -> str:
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)


MIRROR_PERMUTATION: tuple[int, ...] = tuple(
    JOINT_INDEX[_mirrored_name(name)] for name in JOINT_NAMES
)
"""Index of each joint's left-right partner; a central joint is its own."""

FINGERTIP_NAMES: tuple[str, ...] = tuple(
    f"{side}_{finger}"
    for side in ("left", "right")
    for finger in ("index", "middle", "pinky", "ring", "thumb")
)
FINGERTIP_JOINTS: tuple[int, ...] = tuple(JOINT_INDEX[f"{name}3"] for name in FINGERTIP_NAMES)
"""The last finger joint before each fingertip, in the order of `FINGERTIP_NAMES`."""

_SKELETON_FILE = Path(__file__).parents[1] / "assets" / "skeleton.npz"


@dataclass(frozen=True)
class RestSkeleton:
    """A body's joints in its rest pose, where every rotation is the identity. Metres."""

    rest_joints: Float[Tensor, "55 3"]
    """Joint positions in the world; the pelvis need not be at the origin."""
    tip_offsets: Float[Tensor, "10 3"]
    """From the last finger joint to the fingertip, in the order of `FINGERTIP_NAMES`."""

    def bone_offsets(self) -> Float[Tensor, "54 3"]:
        """From each joint's parent to the joint, for joints 1 to 54."""
        return self.rest_joints[1:] - self.rest_joints[list(PARENTS[1:])]

    @cached_property
    def bones_to_joints(self) -> Float[Tensor, "55 3 55"]:
        """How far joint [k] moves with each column of joint [j]'s rotation matrix: the bones that
        start in j and lie between the pelvis and k, summed."""
        with torch.inference_mode(False):
            bones = self.bone_offsets()
            matrix = bones.new_zeros(NUM_JOINTS, 3, NUM_JOINTS)
            for joint in range(NUM_JOINTS):
                for child in chain_to_root(joint)[:-1]:
                    matrix[PARENTS[child], :, joint] += bones[child - 1]
            return matrix


@cache
def open_body_skeleton() -> RestSkeleton:
    """The rest skeleton of the open body that comes with this project."""
    with torch.inference_mode(False), np.load(_SKELETON_FILE, allow_pickle=False) as arrays:
        names = [str(name) for name in arrays["tip_names"]]
        order = [names.index(name) for name in FINGERTIP_NAMES]
        return RestSkeleton(
            rest_joints=torch.from_numpy(arrays["rest_joints"].astype(np.float32)),
            tip_offsets=torch.from_numpy(arrays["tip_offsets"][order].astype(np.float32)),
        )


@cache
def face_unit_names() -> tuple[str, ...]:
    """ARKit's face units in the order of the open body's ``expressions``."""
    with np.load(_SKELETON_FILE, allow_pickle=False) as arrays:
        return tuple(str(name) for name in arrays["expression_names"])
