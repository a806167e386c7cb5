"""Between motion vectors and what they mean in the world, and the training terms on the latter."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from model.motion.kinematics import global_from_local, joint_positions_from_global
from model.motion.packing import AXIS_ANGLE_DIM, ROOT_DIM, ROTATION_DIM, pack, root_positions
from model.motion.rotations import matrix_from_axis_angle, matrix_from_rot6d, rot6d_from_matrix
from model.motion.skeleton import NUM_JOINTS, RestSkeleton
from model.networks.autoencoder import FrozenEncoder
from model.storage.settings import LossConfig, RootMotion, RotationSpace
from model.systems.globaldiff import constraints
from model.training import losses


def to_vectors(
    space: RotationSpace,
    poses: Float[Tensor, "B T 165"],
    transl: Float[Tensor, "B T 3"],
    root: RootMotion = "velocity",
) -> Float[Tensor, "B T C"]:
    """Motion vectors in a rotation space, not normalised, of local axis-angle poses."""
    if space == "axis-angle":
        return pack(poses.unflatten(-1, (-1, 3)), transl, root)
    rotmat = matrix_from_axis_angle(poses.unflatten(-1, (-1, 3)))
    if space == "global":
        rotmat = global_from_local(rotmat)
    return pack(rot6d_from_matrix(rotmat), transl, root)


@dataclass(frozen=True)
class Decoded:
    """What motion vectors mean in the world, with gradients."""

    global_rot: Float[Tensor, "B T 55 3 3"] | None
    """None where no term asks for rotations."""
    rooted: Float[Tensor, "B T 55 3"]
    """Joint positions in metres, the pelvis where the rest pose has it."""
    root: Float[Tensor, "B T 3"]
    """Way of the pelvis in metres; of velocities, from x = z = 0."""
    global_vectors: Float[Tensor, "B T 333"] | None
    """Motion vectors of the same motion in the global space; None where no term asks for them."""

    def to(self, device: torch.device) -> "Decoded":
        """The same on a device."""

        def moved(part: Tensor | None) -> Tensor | None:
            return None if part is None else part.to(device)

        return Decoded(
            global_rot=moved(self.global_rot),
            rooted=self.rooted.to(device),
            root=self.root.to(device),
            global_vectors=moved(self.global_vectors),
        )

    @property
    def positions(self) -> Float[Tensor, "B T 55 3"]:
        """Joint positions in the world, metres."""
        return self.rooted + self.root[..., None, :]


def rotations(
    vectors: Float[Tensor, "*batch T C"], space: RotationSpace
) -> Float[Tensor, "*batch T 55 3 3"]:
    """The rotations that motion vectors hold, in their own space; row-6D by Gram-Schmidt."""
    if space == "axis-angle":
        return matrix_from_axis_angle(vectors[..., :AXIS_ANGLE_DIM].unflatten(-1, (NUM_JOINTS, 3)))
    return matrix_from_rot6d(vectors[..., :ROTATION_DIM].unflatten(-1, (NUM_JOINTS, 6)))


def decode(
    vectors: Float[Tensor, "B T C"],
    space: RotationSpace,
    skeleton: RestSkeleton,
    root: RootMotion = "velocity",
) -> Decoded:
    """Rotations, and positions by forward kinematics."""
    rotmat = rotations(vectors, space)
    global_rot = rotmat if space == "global" else global_from_local(rotmat)
    return Decoded(
        global_rot=global_rot,
        rooted=joint_positions_from_global(global_rot, skeleton),
        root=root_positions(vectors[..., -ROOT_DIM:], root),
        global_vectors=torch.cat(
            [rot6d_from_matrix(global_rot).flatten(-2), vectors[..., -ROOT_DIM:]], dim=-1
        ),
    )


def geometric_terms(
    weights: LossConfig, predicted: Decoded, target: Decoded, encoder: FrozenEncoder | None
) -> dict[str, Float[Tensor, " B"]]:
    """The weighted terms on decoded motion, one value per sample; those of weight 0 are left out.

    Raises:
        ValueError: if L_m has a weight but there is no encoder.
    """
    world = predicted.positions, target.positions
    positions = (predicted.rooted, target.rooted) if weights.rooted else world
    terms = {
        "position": lambda: losses.position_loss(*positions),
        "velocity": lambda: losses.velocity_loss(*positions),
        "acceleration": lambda: losses.acceleration_loss(*positions),
        "joint": lambda: _joint_term(predicted, target),
        "skeleton": lambda: constraints.skeleton_structure_loss(*positions),
        "motion": lambda: _motion_term(predicted, target, encoder),
        "contact": lambda: losses.contact_loss(*world),
    }
    return {
        name: getattr(weights, name) * term()
        for name, term in terms.items()
        if getattr(weights, name) > 0
    }


def _joint_term(predicted: Decoded, target: Decoded) -> Float[Tensor, " B"]:
    if predicted.global_rot is None or target.global_rot is None:
        raise ValueError("L_j has a weight, but rotations were left out.")
    return constraints.joint_structure_loss(
        predicted.global_rot, target.global_rot, constraints.octahedron_anchors()
    )


def _motion_term(
    predicted: Decoded, target: Decoded, encoder: FrozenEncoder | None
) -> Float[Tensor, " B"]:
    if encoder is None:
        raise ValueError("L_m has a weight, but no motion encoder was given.")
    if predicted.global_vectors is None or target.global_vectors is None:
        raise ValueError("L_m has a weight, but rotations were left out.")
    with torch.no_grad():
        wanted = encoder.codes(target.global_vectors)
    return constraints.temporal_structure_loss(encoder.codes(predicted.global_vectors), wanted)
