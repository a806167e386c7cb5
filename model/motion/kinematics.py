"""Skeletons, forward kinematics of local and global joint rotations, and the left-right mirror.

Local rotations are composed along the chain, one batched product for each of the 11 depth levels
(GlobalDiff eqs. 1 and 3). Positions follow from *global* rotations in the additive form (GlobalDiff
eq. 5), which is linear in them: one product with a constant matrix of rest bones.

The mirror plane is the body's middle, x = 0.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from conventions.joints import (
    FINGERTIP_JOINTS,
    FINGERTIP_NAMES,
    JOINT_DEPTH,
    MIRROR_PERMUTATION,
    NUM_JOINTS,
    PARENTS,
    chain_to_root,
)

_SKELETON_FILE = Path(__file__).parents[1] / "assets" / "skeleton.npz"


@dataclass(frozen=True)
class RestSkeleton:
    """Joints of a body in its rest pose, in which every rotation is the identity; metres."""

    rest_joints: Float[Tensor, "55 3"]
    """Joint positions (55, 3) in the world; the pelvis need not be at the origin."""
    tip_offsets: Float[Tensor, "10 3"]
    """Offsets (10, 3) of fingertips from the last finger joints, ordered as `FINGERTIP_NAMES`."""

    @cached_property
    def rotations_to_positions(self) -> Float[Tensor, "55 3 55"]:
        """Linear map (55, 3, 55) from columns of rotation matrices to joint positions.

        Entry [j, :, k] is the sum of the bones that start in joint j between the pelvis and k.
        """
        with torch.inference_mode(False):
            bones = self.rest_joints[1:] - self.rest_joints[list(PARENTS[1:])]
            matrix = bones.new_zeros(NUM_JOINTS, 3, NUM_JOINTS)
            for joint in range(NUM_JOINTS):
                for child in chain_to_root(joint)[:-1]:
                    matrix[PARENTS[child], :, joint] += bones[child - 1]
            return matrix


@cache
def open_body_skeleton() -> RestSkeleton:
    """Load the rest skeleton of the open body that is part of this project."""
    with torch.inference_mode(False), np.load(_SKELETON_FILE, allow_pickle=False) as arrays:
        names = [str(name) for name in arrays["tip_names"]]
        order = [names.index(name) for name in FINGERTIP_NAMES]
        return RestSkeleton(
            rest_joints=torch.from_numpy(arrays["rest_joints"].astype(np.float32)),
            tip_offsets=torch.from_numpy(arrays["tip_offsets"][order].astype(np.float32)),
        )


@cache
def blendshape_names() -> tuple[str, ...]:
    """Return ARKit's face units in the order of the open body's ``expressions``."""
    with np.load(_SKELETON_FILE, allow_pickle=False) as arrays:
        return tuple(str(name) for name in arrays["expression_names"])


_LEVELS: tuple[tuple[int, ...], ...] = tuple(
    tuple(joint for joint in range(NUM_JOINTS) if JOINT_DEPTH[joint] == depth)
    for depth in range(max(JOINT_DEPTH) + 1)
)
_LEVEL_ORDER: tuple[int, ...] = sum(_LEVELS, ())
_PARENT_IN_LEVEL_ABOVE: tuple[tuple[int, ...], ...] = tuple(
    tuple(above.index(PARENTS[joint]) for joint in level) for above, level in pairwise(_LEVELS)
)
_PLACE_IN_LEVEL_ORDER: tuple[int, ...] = tuple(_LEVEL_ORDER.index(j) for j in range(NUM_JOINTS))


@cache
def _index(values: tuple[int, ...], device: torch.device) -> Int[Tensor, " n"]:
    # A cached tensor that was made in inference mode could not be used in training.
    with torch.inference_mode(False):
        return torch.tensor(values, dtype=torch.long, device=device)


def _take(joints: Float[Tensor, "*batch J 3 3"], index: tuple[int, ...]) -> Tensor:
    return joints.index_select(-3, _index(index, joints.device))


def _product(
    a: Float[Tensor, "*batch n 3 3"], b: Float[Tensor, "*batch n 3 3"]
) -> Float[Tensor, "*batch n 3 3"]:
    """Compute ``a @ b``, as sums if compiled: the compiler can fuse those, but not products."""
    if torch.compiler.is_compiling():
        return (a[..., :, :, None] * b[..., None, :, :]).sum(-2)
    return a @ b


def global_from_local(
    R_parent_joint: Float[Tensor, "*batch 55 3 3"],
) -> Float[Tensor, "*batch 55 3 3"]:
    """Compute rotations in the world, ``R_world[j] = R_world[parent(j)] @ R_parent[j]`` (eq. 1)."""
    levels = [_take(R_parent_joint, _LEVELS[0])]
    for level, parents in zip(_LEVELS[1:], _PARENT_IN_LEVEL_ABOVE, strict=True):
        levels.append(_product(_take(levels[-1], parents), _take(R_parent_joint, level)))
    return _take(torch.cat(levels, dim=-3), _PLACE_IN_LEVEL_ORDER)


def local_from_global(
    R_world_joint: Float[Tensor, "*batch 55 3 3"],
) -> Float[Tensor, "*batch 55 3 3"]:
    """Compute rotations in the parents, ``R_parent[j] = R_world[parent(j)].T @ R_world[j]``."""
    R_world_parent = _take(R_world_joint, PARENTS[1:])
    children = R_world_parent.transpose(-1, -2) @ R_world_joint[..., 1:, :, :]
    return torch.cat([R_world_joint[..., :1, :, :], children], dim=-3)


def joint_positions_from_global(
    R_world_joint: Float[Tensor, "*batch 55 3 3"],
    skeleton: RestSkeleton,
    transl: Float[Tensor, "*batch 3"] | None = None,
) -> Float[Tensor, "*batch 55 3"]:
    """Compute joint positions in metres: pelvis plus rotated rest bones (GlobalDiff eq. 5).

    The pelvis is at ``rest_joints[0] + transl``, as in SMPL-X. No joint moves by its own rotation.
    """
    # One large product: batches of 3 x 3 products are many times slower.
    rows = R_world_joint.transpose(-3, -2).flatten(-2)  # (*batch, 3, 165)
    moved = rows @ skeleton.rotations_to_positions.to(R_world_joint).flatten(
        0, 1
    )  # (*batch, 3, 55)
    p_world_joint = moved.transpose(-1, -2) + skeleton.rest_joints.to(R_world_joint)[0]
    return p_world_joint if transl is None else p_world_joint + transl[..., None, :]


def forward_kinematics(
    R_parent_joint: Float[Tensor, "*batch 55 3 3"],
    skeleton: RestSkeleton,
    transl: Float[Tensor, "*batch 3"] | None = None,
) -> tuple[Float[Tensor, "*batch 55 3 3"], Float[Tensor, "*batch 55 3"]]:
    """Compute global rotations and joint positions (metres) from parent-relative rotations."""
    R_world_joint = global_from_local(R_parent_joint)
    return R_world_joint, joint_positions_from_global(R_world_joint, skeleton, transl)


def fingertip_positions(
    R_world_joint: Float[Tensor, "*batch 55 3 3"],
    p_world_joint: Float[Tensor, "*batch 55 3"],
    skeleton: RestSkeleton,
) -> Float[Tensor, "*batch 10 3"]:
    """Compute positions of rigid fingertips in metres, in the order of `FINGERTIP_NAMES`.

    Each is the last finger joint plus its rotated rest offset.
    """
    offsets = skeleton.tip_offsets.to(R_world_joint)
    rotated = (_take(R_world_joint, FINGERTIP_JOINTS) @ offsets[..., None]).squeeze(-1)
    p_world = p_world_joint.index_select(-2, _index(FINGERTIP_JOINTS, p_world_joint.device))
    return p_world + rotated


def mirror_local(R_parent_joint: Float[Tensor, "*batch 55 3 3"]) -> Float[Tensor, "*batch 55 3 3"]:
    """Mirror rotations: ``R'[j] = M R[partner(j)] M`` with ``M = diag(-1, 1, 1)``, every joint.

    The rule is the same for global rotations.
    """
    mirrored = R_parent_joint.clone()
    mirrored[..., 0, 1:] *= -1
    mirrored[..., 1:, 0] *= -1
    return _take(mirrored, MIRROR_PERMUTATION)
