"""Skeleton of the corpus: the open body's rest joints in numpy, without torch (2 s to load)."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX, PARENTS
from renderer.body.skinning import global_transforms

ASSET = Path(__file__).resolve().parents[3] / "model" / "assets" / "skeleton.npz"
SIDES = ("left", "right")
SIDE_SIGN = {"left": 1.0, "right": -1.0}  # the body's left is +x
SOLE_BELOW_FOOT_M = 0.0255  # the open body's soles lie this far under its foot joints


@dataclass(frozen=True)
class Rig:
    """Rest positions (55, 3) in metres, offsets from the parent, and the face-unit names."""

    rest_joints: Float[np.ndarray, "55 3"]
    offsets: Float[np.ndarray, "55 3"]
    tip_offsets: Float[np.ndarray, "10 3"]
    tip_joints: tuple[int, ...]
    expression_names: tuple[str, ...]

    @property
    def floor_m(self) -> float:
        """Height of the floor under the body in its rest pose (m)."""
        return float(self.rest_joints[JOINT_INDEX["left_foot"], 1]) - SOLE_BELOW_FOOT_M


@lru_cache(maxsize=1)
def open_body_rig() -> Rig:
    """Load the rig of the open body, once per process."""
    with np.load(ASSET, allow_pickle=False) as data:
        rest = data["rest_joints"].astype(np.float64)
        tips = data["tip_offsets"].astype(np.float64)
        joints = tuple(int(j) for j in data["tip_joints"])
        names = tuple(str(name) for name in data["expression_names"])
    offsets = rest.copy()
    offsets[1:] -= rest[list(PARENTS[1:])]
    return Rig(rest, offsets, tips, joints, names)


def matrices(axis_angle: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Convert axis-angle vectors (rad) to rotation matrices."""
    flat = Rotation.from_rotvec(axis_angle.reshape(-1, 3)).as_matrix()
    return flat.reshape(*axis_angle.shape[:-1], 3, 3)


def axis_angles(rotmat: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Convert rotation matrices to axis-angle vectors (rad)."""
    flat = Rotation.from_matrix(rotmat.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*rotmat.shape[:-2], 3)


def euler_matrices(
    order: str, degrees: Float[np.ndarray, "*batch A"]
) -> Float[np.ndarray, "*batch 3 3"]:
    """Convert intrinsic Euler angles to matrices, e.g. ``"YXZ"`` for yaw, pitch, roll."""
    flat = Rotation.from_euler(order, degrees.reshape(-1, len(order)), degrees=True).as_matrix()
    return flat.reshape(*degrees.shape[:-1], 3, 3)


def forward_kinematics(
    rig: Rig, R_parent_joint: Float[np.ndarray, "T 55 3 3"], trans: Float[np.ndarray, "T 3"]
) -> tuple[Float[np.ndarray, "T 55 3 3"], Float[np.ndarray, "T 55 3"]]:
    """Compute global rotations and positions of every joint, with the pelvis at rest plus trans."""
    rest = np.broadcast_to(rig.rest_joints, R_parent_joint.shape[:-1])
    R_world_joint, positions = global_transforms(R_parent_joint, rest)
    return R_world_joint, positions + trans[:, None]
