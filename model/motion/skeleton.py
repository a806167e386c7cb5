"""The rest skeleton of a body: where its joints are and how its bones lie."""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from conventions.joints import FINGERTIP_NAMES, NUM_JOINTS, PARENTS, chain_to_root

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
