"""The flat vector a motion network sees, and the numbers that normalise it.

A frame is 333 channels: 55 rotations as row-6D, joint-major, then the root motion
``(velocity x, height y, velocity z)`` in m/s, m, m/s. Horizontal positions are stored as
velocities, so a clip may start anywhere and a window does not depend on where it began.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from model.skeleton import FACE, HANDS, LOWER_BODY, NUM_JOINTS, UPPER_BODY
from model.timing import FPS

ROTATION_DIM = NUM_JOINTS * 6
ROOT_DIM = 3
MOTION_DIM = ROTATION_DIM + ROOT_DIM


def joint_channels(joints: tuple[int, ...]) -> list[int]:
    """Indices of the row-6D channels of ``joints`` in the motion vector."""
    return [6 * joint + k for joint in joints for k in range(6)]


ROOT_CHANNELS = list(range(ROTATION_DIM, MOTION_DIM))
HAND_CHANNELS = joint_channels(HANDS)
TORSO_CHANNELS = joint_channels(UPPER_BODY + LOWER_BODY + FACE) + ROOT_CHANNELS
"""The paper's two regions: hands (180 channels), and everything else (153 channels)."""

NORMALISATION_GROUPS: dict[str, list[int]] = {
    "hands": HAND_CHANNELS,
    "upper body": joint_channels(UPPER_BODY),
    "lower body": joint_channels(LOWER_BODY),
    "face joints": joint_channels(FACE),
    "root velocity": [ROOT_CHANNELS[0], ROOT_CHANNELS[2]],
    "root height": [ROOT_CHANNELS[1]],
}
"""Channels that share one standard deviation. One for each channel would blow up channels that
hardly move; none at all leaves the network with channels that are far smaller than the noise."""


def pack(
    rot6d: Float[Tensor, "*batch T J 6"], transl: Float[Tensor, "*batch T 3"]
) -> Float[Tensor, "*batch T 333"]:
    """Rotations and root positions as motion vectors.

    Args:
        rot6d: row-6D of each joint, in whichever frame the network works.
        transl: root position in metres, y up.
    """
    velocity = torch.zeros_like(transl)
    if transl.shape[-2] > 1:
        velocity[..., 1:, :] = (transl[..., 1:, :] - transl[..., :-1, :]) * FPS
        velocity[..., 0, :] = velocity[..., 1, :]
    root = torch.stack([velocity[..., 0], transl[..., 1], velocity[..., 2]], dim=-1)
    return torch.cat([rot6d.flatten(-2), root], dim=-1)


def unpack(
    vector: Float[Tensor, "*batch T 333"],
) -> tuple[Float[Tensor, "*batch T 55 6"], Float[Tensor, "*batch T 3"]]:
    """Row-6D rotations and root positions; the first frame stands at x = z = 0."""
    rot6d = vector[..., :ROTATION_DIM].unflatten(-1, (NUM_JOINTS, 6))
    return rot6d, root_positions(vector[..., ROTATION_DIM:])


def root_positions(root: Float[Tensor, "*batch T 3"]) -> Float[Tensor, "*batch T 3"]:
    """Positions in metres of root channels (velocity x, height, velocity z), from x = z = 0."""
    steps = root[..., [0, 2]] / FPS
    # The velocity of a frame leads to it from the frame before, so the first one leads nowhere.
    horizontal = torch.cumsum(steps, dim=-2) - steps[..., :1, :]
    return torch.stack([horizontal[..., 0], root[..., 1], horizontal[..., 1]], dim=-1)


@dataclass(frozen=True)
class Normaliser:
    """Mean of each channel and one standard deviation for each body-part group."""

    mean: Float[Tensor, "333"]
    std: Float[Tensor, "333"]

    @staticmethod
    def fit(vectors: Float[Tensor, "N 333"]) -> "Normaliser":
        """Statistics of ``vectors``: the group's std is the root of its mean channel variance."""
        mean = vectors.mean(0)
        variance = vectors.var(0)
        std = torch.ones(MOTION_DIM)
        for channels in NORMALISATION_GROUPS.values():
            std[channels] = variance[channels].mean().sqrt().clamp_min(1e-4)
        return Normaliser(mean, std)

    def to(self, device: torch.device) -> "Normaliser":
        """The same numbers on a device."""
        return Normaliser(self.mean.to(device), self.std.to(device))

    def normalise(self, vector: Float[Tensor, "*batch 333"]) -> Float[Tensor, "*batch 333"]:
        return (vector - self.mean) / self.std

    def restore(self, vector: Float[Tensor, "*batch 333"]) -> Float[Tensor, "*batch 333"]:
        return vector * self.std + self.mean
