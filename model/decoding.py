"""Between motion vectors and what they mean in the world, and the training terms on the latter."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from model import constraints, losses
from model.autoencoder import FrozenEncoder
from model.config import LossConfig, RotationSpace
from model.kinematics import global_from_local, joint_positions_from_global
from model.packing import ROTATION_DIM, pack, unpack
from model.rotations import matrix_from_axis_angle, matrix_from_rot6d, rot6d_from_matrix
from model.skeleton import RestSkeleton


def to_vectors(
    space: RotationSpace, poses: Float[Tensor, "B T 165"], transl: Float[Tensor, "B T 3"]
) -> Float[Tensor, "B T 333"]:
    """Motion vectors in a rotation space, not normalised, of local axis-angle poses."""
    rotmat = matrix_from_axis_angle(poses.unflatten(-1, (-1, 3)))
    if space == "global":
        rotmat = global_from_local(rotmat)
    return pack(rot6d_from_matrix(rotmat), transl)


@dataclass(frozen=True)
class Decoded:
    """What motion vectors mean in the world, with gradients."""

    global_rot: Float[Tensor, "B T 55 3 3"]
    positions: Float[Tensor, "B T 55 3"]
    global_vectors: Float[Tensor, "B T 333"]
    """Motion vectors of the same motion in the global space."""


def decode(
    vectors: Float[Tensor, "B T 333"], space: RotationSpace, skeleton: RestSkeleton
) -> Decoded:
    """Rotations by Gram-Schmidt, positions by forward kinematics."""
    rot6d, transl = unpack(vectors)
    rotmat = matrix_from_rot6d(rot6d)
    global_rot = global_from_local(rotmat) if space == "local" else rotmat
    return Decoded(
        global_rot=global_rot,
        positions=joint_positions_from_global(global_rot, skeleton, transl),
        global_vectors=torch.cat(
            [rot6d_from_matrix(global_rot).flatten(-2), vectors[..., ROTATION_DIM:]], dim=-1
        ),
    )


def geometric_terms(
    weights: LossConfig, predicted: Decoded, target: Decoded, encoder: FrozenEncoder | None
) -> dict[str, Float[Tensor, " B"]]:
    """The weighted terms on decoded motion, one value per sample; those of weight 0 are left out.

    Raises:
        ValueError: if L_m has a weight but there is no encoder.
    """
    positions = predicted.positions, target.positions
    terms = {
        "position": lambda: losses.position_loss(*positions),
        "velocity": lambda: losses.velocity_loss(*positions),
        "acceleration": lambda: losses.acceleration_loss(*positions),
        "joint": lambda: constraints.joint_structure_loss(
            predicted.global_rot, target.global_rot, constraints.octahedron_anchors()
        ),
        "skeleton": lambda: constraints.skeleton_structure_loss(*positions),
        "motion": lambda: _motion_term(predicted, target, encoder),
    }
    return {
        name: getattr(weights, name) * term()
        for name, term in terms.items()
        if getattr(weights, name) > 0
    }


def _motion_term(
    predicted: Decoded, target: Decoded, encoder: FrozenEncoder | None
) -> Float[Tensor, " B"]:
    if encoder is None:
        raise ValueError("L_m has a weight, but no motion encoder was given.")
    with torch.no_grad():
        wanted = encoder.codes(target.global_vectors)
    return constraints.temporal_structure_loss(encoder.codes(predicted.global_vectors), wanted)
