"""Motion vectors of the networks: packing, normalisation, and decoding to world coordinates.

A frame is 333 channels: 55 rotations as row-6D, joint-major, then the root motion ``(velocity x,
height y, velocity z)`` in m/s, m, m/s. With velocities a clip may start anywhere and a window does
not depend on where it began. The other root motion, "place", is the position in metres relative to
the body's home position.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Shaped
from torch import Tensor

from conventions.joints import FACE, HANDS, LOWER_BODY, NUM_JOINTS, UPPER_BODY
from conventions.rates import FPS
from model.motion import spaces
from model.motion.kinematics import RestSkeleton, global_from_local, joint_positions_from_global
from model.motion.rotations import matrix_from_axis_angle, matrix_from_rot6d, rot6d_from_matrix
from model.motion.spaces import RootFormat, RotationSpace, VectorScaling

ROTATION_DIM = NUM_JOINTS * 6
MOTION_DIM = ROTATION_DIM + spaces.ROOT_DIM
AXIS_ANGLE_DIM = spaces.AXIS_ANGLE_MOTION_DIM - spaces.ROOT_DIM


def joint_channels(joints: Iterable[int], width: int = 6) -> list[int]:
    """Return the channels of ``joints``, ``width`` each: 6 as row-6D, 3 as axis-angle."""
    return [width * joint + k for joint in joints for k in range(width)]


ROOT_CHANNELS = list(range(ROTATION_DIM, MOTION_DIM))
HAND_CHANNELS = joint_channels(HANDS)
NON_HAND_CHANNELS = joint_channels(UPPER_BODY + LOWER_BODY + FACE) + ROOT_CHANNELS
"""Channels of the paper's two regions: hands (180), and everything else (153)."""


def _groups(width: int) -> list[list[int]]:
    """Return the groups of channels that share one standard deviation.

    These are hands, upper body, lower body, face, the root's horizontal motion, and its height. A
    deviation per channel would amplify channels that hardly move; none at all leaves channels that
    are far smaller than the noise.
    """
    root = width * NUM_JOINTS
    joints = (HANDS, UPPER_BODY, LOWER_BODY, FACE)
    return [*(joint_channels(each, width) for each in joints), [root, root + 2], [root + 1]]


NORMALISATION_GROUPS, AXIS_ANGLE_GROUPS = _groups(6), _groups(3)
"""Groups of the channels in row-6D and in axis-angle vectors."""


def pack(
    rotations: Float[Tensor, "*batch T J d"],
    transl: Float[Tensor, "*batch T 3"],
    root_format: RootFormat = "velocity",
) -> Float[Tensor, "*batch T C"]:
    """Pack rotations and root positions into motion vectors.

    The rotations of each joint (row-6D, or axis-angle) are in the network's rotation space;
    ``transl`` is the root position in metres, y up; as "place", relative to the body's home.
    """
    if root_format == "place":
        return join_channels(rotations, transl)
    velocity = torch.zeros_like(transl)
    if transl.shape[-2] > 1:
        velocity[..., 1:, :] = (transl[..., 1:, :] - transl[..., :-1, :]) * FPS
        velocity[..., 0, :] = velocity[..., 1, :]
    root = torch.stack([velocity[..., 0], transl[..., 1], velocity[..., 2]], dim=-1)
    return join_channels(rotations, root)


def join_channels(
    rotations: Float[Tensor, "*batch T J d"], root: Float[Tensor, "*batch T 3"]
) -> Float[Tensor, "*batch T C"]:
    """Concatenate the values of all joints and the root channels to motion vectors."""
    return torch.cat([rotations.flatten(-2), root], dim=-1)


def root_positions(
    root: Float[Tensor, "*batch T 3"], root_format: RootFormat = "velocity"
) -> Float[Tensor, "*batch T 3"]:
    """Compute root positions in metres from root channels.

    The channels are (velocity x, height, velocity z), integrated from x = z = 0, or the position.
    """
    if root_format == "place":
        return root
    steps = root[..., [0, 2]] / FPS
    # A frame's velocity is that of the step to it, so the first one is not integrated.
    horizontal = torch.cumsum(steps, dim=-2) - steps[..., :1, :]
    return torch.stack([horizontal[..., 0], root[..., 1], horizontal[..., 1]], dim=-1)


@dataclass(frozen=True)
class Normaliser:
    """Affine map between motion vectors and the normalised vectors of a network.

    It has the mean and standard deviation of each channel (motion shares one per body-part group)
    and, for systems with a prior, a matrix to nearly independent components.
    """

    mean: Float[Tensor, " C"]
    std: Float[Tensor, " C"]
    mix: Float[Tensor, "C C"] | None = None
    """Matrix from channels to components; in the terms of ICA, the unmixing matrix."""
    unmix: Float[Tensor, "C C"] | None = None
    """Matrix from components to channels."""

    @staticmethod
    def of_tensors(tensors: Mapping[str, Shaped[Tensor, " ..."]]) -> "Normaliser":
        """Make the normaliser saved with trained weights; raises KeyError if there is none."""
        mix, unmix = (tensors.get(f"normaliser.{name}") for name in ("mix", "unmix"))
        return Normaliser(tensors["normaliser.mean"], tensors["normaliser.std"], mix, unmix)

    def tensors(self) -> dict[str, Tensor]:
        """Return the tensors to save with trained weights; the inverse of `of_tensors`."""
        parts = {"mean": self.mean, "std": self.std, "mix": self.mix, "unmix": self.unmix}
        return {f"normaliser.{k}": part for k, part in parts.items() if part is not None}

    @staticmethod
    def fit(
        vectors: Float[Tensor, "N C"],
        representation: VectorScaling = "normalised",
        groups: Sequence[Sequence[int]] | None = None,
    ) -> "Normaliser":
        """Fit the statistics of ``vectors``; a group's std is the root of its mean variance.

        The representation ``raw`` does not scale row-6D rotations (mean 0, std 1). Each of the
        groups of channels shares one std; by default those of row-6D vectors.
        """
        mean = vectors.mean(0)
        variance = vectors.var(0)
        std = torch.ones(vectors.shape[1])
        for channels in groups or NORMALISATION_GROUPS:
            std[list(channels)] = variance[list(channels)].mean().sqrt().clamp_min(1e-4)
        if representation == "raw":
            mean[:ROTATION_DIM] = 0.0
            std[:ROTATION_DIM] = 1.0
        return Normaliser(mean, std)

    def to(self, device: torch.device) -> "Normaliser":
        """Return a copy on a device."""
        mix, unmix = (None if m is None else m.to(device) for m in (self.mix, self.unmix))
        return Normaliser(self.mean.to(device), self.std.to(device), mix, unmix)

    def standardise(self, vector: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """Scale channels to mean 0 and (by group) unit variance, without mixing."""
        return (vector - self.mean) / self.std

    def normalise(self, vector: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        scaled = self.standardise(vector)
        return scaled if self.mix is None else scaled @ self.mix

    def restore(self, vector: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        scaled = vector if self.unmix is None else vector @ self.unmix
        return scaled * self.std + self.mean


def poses_to_vectors(
    space: RotationSpace,
    poses: Float[Tensor, "B T 165"],
    transl: Float[Tensor, "B T 3"],
    root_format: RootFormat = "velocity",
) -> Float[Tensor, "B T C"]:
    """Convert local axis-angle poses to motion vectors in a rotation space, not normalised."""
    if space == "axis-angle":
        return pack(poses.unflatten(-1, (-1, 3)), transl, root_format)
    rotmat = matrix_from_axis_angle(poses.unflatten(-1, (-1, 3)))
    if space == "global":
        rotmat = global_from_local(rotmat)
    return pack(rot6d_from_matrix(rotmat), transl, root_format)


@dataclass(frozen=True)
class DecodedMotion:
    """World-space rotations and positions of motion vectors, with gradients."""

    R_world_joint: Float[Tensor, "B T 55 3 3"] | None
    """World rotations (B, T, 55, 3, 3); None if no loss term needs them."""
    untranslated_positions: Float[Tensor, "B T 55 3"]
    """Joint positions (B, T, 55, 3) in metres, with the pelvis at its place in the rest pose."""
    translation: Float[Tensor, "B T 3"]
    """SMPL-X translation (B, T, 3) in metres; from velocities it starts at x = z = 0."""
    global_vectors: Float[Tensor, "B T 333"] | None
    """Motion vectors (B, T, 333) in the global space; None if no loss term needs them."""

    def to(self, device: torch.device) -> "DecodedMotion":
        """Return a copy on a device."""
        parts = {name: part.to(device) for name, part in vars(self).items() if part is not None}
        return replace(self, **parts)

    @property
    def positions(self) -> Float[Tensor, "B T 55 3"]:
        """Joint positions (B, T, 55, 3) in the world, metres."""
        return self.untranslated_positions + self.translation[..., None, :]


def rotations(
    vectors: Float[Tensor, "*batch T C"], space: RotationSpace
) -> Float[Tensor, "*batch T 55 3 3"]:
    """Extract the rotations of motion vectors, in their rotation space; row-6D by Gram-Schmidt."""
    if space == "axis-angle":
        return matrix_from_axis_angle(vectors[..., :AXIS_ANGLE_DIM].unflatten(-1, (NUM_JOINTS, 3)))
    return matrix_from_rot6d(vectors[..., :ROTATION_DIM].unflatten(-1, (NUM_JOINTS, 6)))


def decode(
    vectors: Float[Tensor, "B T C"],
    space: RotationSpace,
    skeleton: RestSkeleton,
    root_format: RootFormat = "velocity",
) -> DecodedMotion:
    """Decode motion vectors to rotations, and to positions by forward kinematics."""
    rotmat = rotations(vectors, space)
    R_world_joint = rotmat if space == "global" else global_from_local(rotmat)
    return DecodedMotion(
        R_world_joint=R_world_joint,
        untranslated_positions=joint_positions_from_global(R_world_joint, skeleton),
        translation=root_positions(vectors[..., -spaces.ROOT_DIM :], root_format),
        global_vectors=torch.cat(
            [rot6d_from_matrix(R_world_joint).flatten(-2), vectors[..., -spaces.ROOT_DIM :]], dim=-1
        ),
    )
