"""Between motion vectors and what they mean in the world."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from conventions.joints import NUM_JOINTS
from model.motion.kinematics import global_from_local, joint_positions_from_global
from model.motion.packing import AXIS_ANGLE_DIM, ROTATION_DIM, pack, root_positions
from model.motion.rotations import matrix_from_axis_angle, matrix_from_rot6d, rot6d_from_matrix
from model.motion.skeleton import RestSkeleton
from model.motion.spaces import ROOT_DIM, RootMotion, RotationSpace


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
