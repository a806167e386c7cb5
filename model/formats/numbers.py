"""What all readers share: what the user says of a file, rotations of any form, frame rates."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import torch
from jaxtyping import Float, Float32
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from conventions.joints import FACE, NUM_JOINTS
from conventions.rates import FPS
from model.motion.altered import motion_at_speed
from model.motion.motion import NUM_BETAS, NUM_EXPRESSIONS, Motion, check_length
from model.motion.rotations import axis_angle_from_matrix, matrix_from_rot6d
from model.storage.npz import MotionError

Rotations = Literal["axis-angle", "6d", "quaternion-wxyz", "quaternion-xyzw", "matrix"]
ROTATIONS: tuple[Rotations, ...] = get_args(Rotations)
WIDTHS: dict[Rotations, int] = {
    "axis-angle": 3,
    "6d": 6,
    "quaternion-wxyz": 4,
    "quaternion-xyzw": 4,
    "matrix": 9,
}
SMPLH_JOINTS = NUM_JOINTS - len(FACE)
LOWEST_FPS, HIGHEST_FPS = 12.0, 240.0
MOST_RADIANS = 4 * np.pi
"""A turn of more than two full circles is a number of degrees."""


@dataclass(frozen=True)
class ReadOptions:
    """What the user says of a file, where the file does not say it."""

    fps: float | None = None
    rotations: Rotations | None = None


@dataclass(frozen=True)
class ReadMotion:
    """A motion, and what was done to the file's numbers to get it."""

    motion: Motion
    notes: tuple[str, ...]
    """Sentences for a person, each naming the file."""


def joint_rotations(
    array: np.ndarray, name: str, said: Rotations | None, notes: list[str]
) -> Float32[np.ndarray, "T 165"]:
    """Axis-angle of 55 joints out of rotations of 55 or 52 joints in any form.

    The form is taken from the width; a note says which. A batch axis of 1 is left out.

    Args:
        said: the form that the user names.

    Raises:
        MotionError: for any other shape, and where the named form does not fit it.
    """
    shape = array.shape
    if array.ndim > 2 and shape[0] == 1:
        array = array[0]
        notes.append(f"{name} has a batch axis; its one motion was taken (shape {shape}).")
    check_length(len(array), name)
    numbers = int(np.prod(array.shape[1:]))
    forms: list[tuple[Rotations, int]] = [
        (form, joints)
        for joints in (NUM_JOINTS, SMPLH_JOINTS)
        for form in ROTATIONS
        if numbers == joints * WIDTHS[form] and said in (None, form)
    ]
    if array.ndim not in (2, 3, 4) or not len(array) or not forms:
        wanted = f" of {said}" if said else ""
        raise MotionError(
            f"{name}: rotations must have the shape (frames, 165), (frames, 55, 3), or that of 52"
            f" or 55 joints of 6, 4 or 9 numbers{wanted}; found {shape}."
        )
    form, joints = forms[0]
    if array.ndim == 3 and form == "axis-angle":
        notes.append(f"{name} has one row for each joint ({shape}); they were laid side by side.")
    if form != "axis-angle" and said is None:
        told = {
            "6d": "6D, the first two rows of each matrix, as PyTorch3D has them",
            "quaternion-wxyz": "quaternions with w first (say --rotations quaternion-xyzw if last)",
        }.get(form, "rotation matrices")
        notes.append(f"{name} holds {WIDTHS[form]} numbers for each joint, taken as {told}.")
    poses = _axis_angle(array.reshape(len(array), joints, WIDTHS[form]), form, name)
    if form == "axis-angle" and np.linalg.norm(poses, axis=-1).max() > MOST_RADIANS:
        raise MotionError(
            f"{name} turns a joint by {np.linalg.norm(poses, axis=-1).max():.0f}; `poses` must be"
            " in radians, not degrees."
        )
    if joints == SMPLH_JOINTS:
        notes.append(
            f"{name} has the 52 joints of SMPL-H; jaw and eyes, which it lacks, stay at rest."
        )
        poses = np.insert(poses, [min(FACE)] * len(FACE), 0.0, axis=1)
    return poses.reshape(len(poses), -1).astype(np.float32)


def _axis_angle(
    array: Float[np.ndarray, "T J width"], form: Rotations, name: str
) -> Float[np.ndarray, "T J 3"]:
    if form == "axis-angle":
        return array
    if form.startswith("quaternion"):
        if np.abs(np.linalg.norm(array, axis=-1) - 1).max() > 0.1:
            raise MotionError(f"{name} holds no unit quaternions; name their form (--rotations).")
        xyzw = array if form == "quaternion-xyzw" else np.roll(array, -1, axis=-1)
        return Rotation.from_quat(xyzw.reshape(-1, 4)).as_rotvec().reshape(*array.shape[:2], 3)
    if form == "6d":
        rotmat = matrix_from_rot6d(torch.from_numpy(np.ascontiguousarray(array)).double())
    else:
        rotmat = torch.from_numpy(np.ascontiguousarray(array)).double().unflatten(-1, (3, 3))
        apart = rotmat @ rotmat.mT - torch.eye(3, dtype=rotmat.dtype)
        if float(apart.abs().max()) > 0.05:
            raise MotionError(f"{name} holds no rotation matrices; name their form (--rotations).")
    return axis_angle_from_matrix(rotmat).numpy()


def check_fps(fps: float, name: str) -> float:
    """Refuse rates that cannot be made 30 honestly.

    Raises:
        MotionError: naming the limits.
    """
    if not LOWEST_FPS <= fps <= HIGHEST_FPS:
        raise MotionError(
            f"{name} has {fps:g} frames per second; {LOWEST_FPS:g} to {HIGHEST_FPS:g} can be"
            f" resampled to {FPS}."
        )
    return fps


def at_30_fps(motion: Motion, fps: float, name: str, notes: list[str]) -> Motion:
    """The same motion at 30 frames per second; a note says so.

    More frames are thinned by slerp. Fewer are filled in along a cubic spline, which adds no kinks,
    and jitter that the file cannot have is not in it either.
    """
    if abs(fps - FPS) < 0.01:
        return motion
    if fps > FPS - 1.0:
        notes.append(f"{name} has {fps:g} frames per second and was resampled to {FPS}.")
        return motion_at_speed(motion, fps / FPS)
    notes.append(
        f"{name} has {fps:g} frames per second; frames between them were filled in to {FPS} along"
        f" a smooth curve. It cannot hold movement above {fps / 2:g} Hz: its jerk and high"
        " frequencies say nothing beside motion of 30."
    )
    at = np.arange(int((motion.num_frames - 1) * FPS / fps + 1e-6) + 1) * fps / FPS
    known = np.arange(motion.num_frames)
    rotmat = motion.local_rotations().double().numpy()[..., :2, :]
    rows = _along(rotmat.reshape(len(known), -1), known, at)
    turned = matrix_from_rot6d(torch.from_numpy(rows).unflatten(-1, (NUM_JOINTS, 6)))
    return replace(
        motion,
        poses=axis_angle_from_matrix(turned).flatten(1).float().numpy(),
        trans=_along(motion.trans, known, at).astype(np.float32),
        expressions=_along(motion.expressions, known, at).astype(np.float32),
    )


def _along(
    rows: Float[np.ndarray, "T C"], known: np.ndarray, at: np.ndarray
) -> Float[np.ndarray, "S C"]:
    if len(known) < 2:
        return np.repeat(rows, len(at), axis=0).astype(np.float64)
    return CubicSpline(known, rows.astype(np.float64), axis=0)(at)


def plain_motion(
    poses: Float32[np.ndarray, "T 165"],
    trans: Float32[np.ndarray, "T 3"] | None = None,
    expressions: Float32[np.ndarray, "T 100"] | None = None,
) -> Motion:
    """With zeros for what there is not."""
    frames = len(poses)
    if trans is None:
        trans = np.zeros((frames, 3), np.float32)
    if expressions is None:
        expressions = np.zeros((frames, NUM_EXPRESSIONS), np.float32)
    return Motion(poses, trans, expressions, "flame100", np.zeros(NUM_BETAS, np.float32))
