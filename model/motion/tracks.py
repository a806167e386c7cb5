"""Positions of every joint and fingertip of a motion, and joint rotations, frame by frame."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64

from conventions.joints import (
    FINGERTIP_JOINTS,
    FINGERTIP_NAMES,
    JOINT_INDEX,
    JOINT_NAMES,
    NUM_JOINTS,
    chain_to_root,
)
from model.motion.kinematics import RestSkeleton, fingertip_positions, forward_kinematics
from model.motion.motion import Motion
from model.motion.rotations import matrix_from_axis_angle

POINT_NAMES = (*FINGERTIP_NAMES, *JOINT_NAMES)
"""Names of the points that the ``tip_`` metrics can track."""
_CHUNK_FRAMES = 512


@dataclass(frozen=True, eq=False)
class Tracks:
    """Positions over time in world metres, and rotations."""

    joints: Float64[np.ndarray, "T 55 3"]
    fingertips: Float64[np.ndarray, "T 10 3"]
    """Positions (T, 10, 3) in the order of `FINGERTIP_NAMES`."""
    R_parent_joint: Float32[np.ndarray, "T 55 3 3"]
    """Parent-relative rotations (T, 55, 3, 3); single precision as in motion files saves memory."""
    R_world_joint: Float32[np.ndarray, "T 55 3 3"]

    def point(self, name: str) -> Float64[np.ndarray, "T 3"]:
        """Return the positions of a fingertip or joint, one of `POINT_NAMES`."""
        if name in FINGERTIP_NAMES:
            return self.fingertips[:, FINGERTIP_NAMES.index(name)]
        return self.joints[:, JOINT_INDEX[name]]


TipTrack = Callable[[Motion, Tracks], Float[np.ndarray, "T 3"]]
"""Function from a motion and its tracks to the positions (T, 3) of a point in metres."""


def track_points(motion: Motion, skeleton: RestSkeleton) -> Tracks:
    """Compute joints and rigid fingertips of every frame, in double precision."""
    count = motion.num_frames
    joints = np.empty((count, NUM_JOINTS, 3))
    tips = np.empty((count, len(FINGERTIP_NAMES), 3))
    local, world = (np.empty((count, NUM_JOINTS, 3, 3), np.float32) for _ in range(2))
    for start in range(0, count, _CHUNK_FRAMES):
        frames = slice(start, start + _CHUNK_FRAMES)
        poses = torch.tensor(motion.poses[frames], dtype=torch.float64)
        transl = torch.tensor(motion.trans[frames], dtype=torch.float64)
        R_parent_joint = matrix_from_axis_angle(poses.unflatten(-1, (NUM_JOINTS, 3)))
        R_world_joint, p_world_joint = forward_kinematics(R_parent_joint, skeleton, transl)
        joints[frames] = p_world_joint.numpy()
        tips[frames] = fingertip_positions(R_world_joint, p_world_joint, skeleton).numpy()
        local[frames], world[frames] = R_parent_joint.numpy(), R_world_joint.numpy()
    return Tracks(joints, tips, local, world)


def point_label(name: str) -> str:
    """Format a point's name as text: right middle fingertip, right middle joint 1, neck."""
    spaced = name.replace("_", " ")
    if name in FINGERTIP_NAMES:
        return f"{spaced} fingertip"
    is_finger = name[:-1] in FINGERTIP_NAMES
    return f"{spaced[:-1]} joint {spaced[-1]}" if is_finger else spaced


def kinematic_chain(point: str) -> tuple[int, ...]:
    """Return the joints that move a point by their rotation, from the pelvis outwards.

    A fingertip is moved by all joints up to the last of its finger, a joint by its ancestors only.
    """
    if point in FINGERTIP_NAMES:
        return chain_to_root(FINGERTIP_JOINTS[FINGERTIP_NAMES.index(point)])[::-1]
    return chain_to_root(JOINT_INDEX[point])[:0:-1]


CHEST_AXIS_SIGNS: dict[Literal["left", "right"], tuple[float, float, float]] = {
    "left": (1.0, 1.0, 1.0),
    "right": (-1.0, 1.0, 1.0),
}
"""Signs by which the chest's axes turn into outwards, up and forwards for each side."""


def wrist_positions_in_chest_frame(
    tracks: Tracks,
) -> dict[Literal["left", "right"], Float[np.ndarray, "T 3"]]:
    """Compute wrist positions in the chest's frame (m): outwards, up, forwards.

    x points to the hand's own side: it is mirrored for the right hand.
    """
    chest = JOINT_INDEX["spine3"]
    R_world_chest = tracks.R_world_joint[:, chest].astype(np.float64)
    p_chest_wrists = {}
    for side in CHEST_AXIS_SIGNS:
        offset_world = tracks.joints[:, JOINT_INDEX[f"{side}_wrist"]] - tracks.joints[:, chest]
        p_chest = np.einsum("tij,ti->tj", R_world_chest, offset_world)
        p_chest_wrists[side] = p_chest * np.array(CHEST_AXIS_SIGNS[side])
    return p_chest_wrists
