"""The 8 frames that a clip of the authors' system starts from, which it cannot do without."""

import os
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from conventions.joints import JOINT_NAMES
from model.motion.kinematics import global_from_local
from model.motion.motion import Motion, load_motion
from model.motion.rotations import matrix_from_axis_angle, rot6d_from_matrix
from model.storage.npz import MotionError
from model.systems.official.files import SEED_VARIABLE
from model.systems.official.sizes import SEED_FRAMES

STANDING = {
    "left_shoulder": (0.0, -0.1, -1.0),
    "right_shoulder": (0.0, 0.1, 1.0),
    "left_elbow": (0.3, -0.45, 0.0),
    "right_elbow": (0.3, 0.45, 0.0),
}
"""Axis-angles, radians: arms that hang down; all other joints are as the body rests."""
PLACE_M = (0.0, 1.29, 0.0)
"""Of who stands there, as tall as BEAT2's speakers."""


def first_seed() -> Float[Tensor, "8 333"]:
    """The start of the motion file that ``OFFICIAL_SEED`` names, as the authors' script starts from
    that of the recording; else somebody who stands still with hanging arms.

    Raises:
        MotionError: if the file cannot be read, or is too short.
    """
    named = os.environ.get(SEED_VARIABLE)
    return seed_of(load_motion(Path(named))) if named else standing()


def seed_of(motion: Motion) -> Float[Tensor, "8 333"]:
    """The first frames of a motion as motion vectors.

    Raises:
        MotionError: if there are fewer.
    """
    if motion.num_frames < SEED_FRAMES:
        raise MotionError(
            f"The motion to start from has {motion.num_frames} frames; {SEED_FRAMES} are needed."
        )
    start = motion.part(slice(SEED_FRAMES))
    return _vectors(start.local_rotations(), torch.tensor(start.trans))


def standing() -> Float[Tensor, "8 333"]:
    """Somebody who stands still."""
    poses = torch.zeros(len(JOINT_NAMES), 3)
    for joint, turned in STANDING.items():
        poses[JOINT_NAMES.index(joint)] = torch.tensor(turned)
    local = matrix_from_axis_angle(poses).expand(SEED_FRAMES, -1, -1, -1)
    return _vectors(local, torch.tensor(PLACE_M).expand(SEED_FRAMES, -1))


def _vectors(
    local: Float[Tensor, "n 55 3 3"], place: Float[Tensor, "n 3"]
) -> Float[Tensor, "n 333"]:
    rows = rot6d_from_matrix(global_from_local(local.double())).float()
    return torch.cat([rows.flatten(-2), place], dim=-1)
