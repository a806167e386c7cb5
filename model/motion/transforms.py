"""Changes to motions: noise, speed, exaggeration, and GlobalDiff's Savitzky-Golay filter."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32
from scipy.signal import butter, savgol_filter, sosfiltfilt
from torch import Tensor

from conventions.joints import FACE, NUM_JOINTS
from conventions.names import PostFilter
from conventions.rates import FPS
from conventions.views import CUTOFF_HZ, MAX_EXAGGERATED_RAD
from model.motion.kinematics import global_from_local, local_from_global
from model.motion.motion import Motion
from model.motion.rotations import (
    axis_angle_from_matrix,
    interpolate_rotations,
    matrix_from_axis_angle,
    matrix_from_rot6d,
    rot6d_from_matrix,
)


class NoisyMotions(NamedTuple):
    """A motion with the same noise on its local and on its global rotations."""

    on_local: Motion
    on_global: Motion


def with_local_and_global_noise(motion: Motion, noise_rad: float, seed: int = 0) -> NoisyMotions:
    """Return the motion with noise on its local, and with noise on its global rotations.

    The noise rotates each joint in every frame about its own axes, with independent components of
    standard deviation ``noise_rad``; both motions get the same noise (for its consequences see
    `model.metrics.error_growth`). The face has none.
    """
    generator = torch.Generator().manual_seed(seed)
    R_parent_joint = motion.local_rotations().double()
    turn = noise_rad * torch.randn(R_parent_joint.shape[:-1], generator=generator).double()
    turn[:, list(FACE)] = 0.0  # they have no children, and facial jitter distracts
    noise = matrix_from_axis_angle(turn)
    on_global = local_from_global(global_from_local(R_parent_joint) @ noise)
    # The head's noise does not change the face's local rotations.
    on_global[:, list(FACE)] = R_parent_joint[:, list(FACE)]
    return NoisyMotions(
        _with_rotations(motion, R_parent_joint @ noise), _with_rotations(motion, on_global)
    )


def _with_rotations(motion: Motion, R_parent_joint: Float[torch.Tensor, "T J 3 3"]) -> Motion:
    poses = axis_angle_from_matrix(R_parent_joint).flatten(-2).float().numpy()
    return replace(motion, poses=poses)


def change_motion_speed(motion: Motion, speed: float) -> Motion:
    """Resample the motion to play ``speed`` times as fast.

    New frame k is old frame ``k * speed``. Rotations are interpolated by slerp, everything else
    linearly. The last frame lies at most one new frame before the old last one.
    """
    num_frames = int((motion.num_frames - 1) / speed + 1e-6) + 1
    time = np.minimum(np.arange(num_frames) * speed, motion.num_frames - 1)  # in old frames
    before = np.minimum(time.astype(int), max(motion.num_frames - 2, 0))
    after = np.minimum(before + 1, motion.num_frames - 1)
    weight = (time - before).astype(np.float32)
    rotmat = motion.local_rotations()
    at_time = interpolate_rotations(
        rotmat[before], rotmat[after], torch.from_numpy(weight)[:, None]
    )

    def blend(rows: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "S C"]:
        return rows[before] + weight[:, None] * (rows[after] - rows[before])

    return replace(
        motion,
        poses=axis_angle_from_matrix(at_time).flatten(1).numpy(),
        trans=blend(motion.trans),
        expressions=blend(motion.expressions),
    )


_ORDER = 4
_PADDING_FRAMES = 15


def exaggerate_tremor(
    motion: Motion, factor: float | int, cutoff_hz: float | int = CUTOFF_HZ
) -> Motion:
    """Multiply all motion above a cutoff frequency by a factor.

    A local rotation R has a slow part L: its row-6D form after a Butterworth filter that runs
    forwards and backwards. The residual log(L^T R) is multiplied and applied to L. The translation
    is treated alike; jaw, eyes and expressions are unchanged. A factor of 1 returns the motion
    itself, and so does a clip under 4 frames.
    """
    if factor == 1 or motion.num_frames < 4:
        return motion
    poses = motion.poses.copy()
    for joint in range(NUM_JOINTS):  # one at a time: memory stays small for long clips
        if joint in FACE:  # speech and gaze are quick by nature
            continue
        columns = slice(3 * joint, 3 * joint + 3)
        rotmat = matrix_from_axis_angle(torch.tensor(motion.poses[:, columns], dtype=torch.float64))
        slow = _below_cutoff(rotmat, cutoff_hz)
        fast = factor * axis_angle_from_matrix(slow.transpose(-1, -2) @ rotmat)
        turn = fast.norm(dim=-1, keepdim=True)
        fast = fast * (MAX_EXAGGERATED_RAD / turn.clamp_min(MAX_EXAGGERATED_RAD))
        shown = slow @ matrix_from_axis_angle(fast)
        poses[:, columns] = axis_angle_from_matrix(shown).numpy()
    slow_trans = low_pass(motion.trans.astype(np.float64), cutoff_hz)
    trans = slow_trans + factor * (motion.trans - slow_trans)
    return replace(motion, poses=poses, trans=trans.astype(np.float32))


def _below_cutoff(
    rotmat: Float[torch.Tensor, "T 3 3"], cutoff_hz: float | int
) -> Float[torch.Tensor, "T 3 3"]:
    rows = low_pass(rot6d_from_matrix(rotmat).numpy(), cutoff_hz)
    return matrix_from_rot6d(torch.from_numpy(rows))


def low_pass(
    values: Float[np.ndarray, "T C"], cutoff_hz: float | int = CUTOFF_HZ
) -> Float[np.ndarray, "T C"]:
    """Filter values (T, C) with a zero-phase low-pass; the ends of a clip are mirrored."""
    sections = butter(_ORDER, cutoff_hz, fs=FPS, output="sos")
    padding = min(_PADDING_FRAMES, len(values) - 1)
    slow = sosfiltfilt(sections, values, axis=0, padlen=padding)
    return np.ascontiguousarray(slow)  # the backward pass leaves it reversed


SAVGOL_FRAMES = 7
SAVGOL_ORDER = 2


def smooth_over_time(
    values: Float[np.ndarray, " T *channels"],
) -> Float[np.ndarray, " T *channels"]:
    """Smooth with a Savitzky-Golay filter of 7 frames and order 2, in double precision.

    Under 5 frames nothing changes; under 7 frames the window is 5.
    """
    window = min(SAVGOL_FRAMES, len(values) - 1 + len(values) % 2)
    if window <= SAVGOL_ORDER + 1:
        return values.astype(np.float64)
    return np.asarray(savgol_filter(values.astype(np.float64), window, SAVGOL_ORDER, axis=0))


def smooth_rotations(rotmat: Float[Tensor, "T *joints 3 3"]) -> Float[Tensor, "T *joints 3 3"]:
    """Smooth rotations in row-6D form over time, and orthogonalise the result."""
    smooth = smooth_over_time(rot6d_from_matrix(rotmat).numpy())
    return matrix_from_rot6d(torch.from_numpy(smooth))


def apply_post_filter(motion: Motion, post_filter: PostFilter) -> Motion:
    """Return the motion after the chosen filter."""
    return smooth_motion(motion) if post_filter == "savgol" else motion


def smooth_motion(motion: Motion) -> Motion:
    """Smooth each local rotation, the translation and the expressions of a motion."""
    poses = np.empty_like(motion.poses)
    for joint in range(NUM_JOINTS):  # one at a time: memory stays small for long clips
        columns = slice(3 * joint, 3 * joint + 3)
        axis_angle = torch.tensor(motion.poses[:, columns], dtype=torch.float64)
        smooth = smooth_rotations(matrix_from_axis_angle(axis_angle))
        poses[:, columns] = axis_angle_from_matrix(smooth).numpy()

    def filtered(values: Float32[np.ndarray, "T C"]) -> Float32[np.ndarray, "T C"]:
        return smooth_over_time(values).astype(np.float32)

    return replace(
        motion, poses=poses, trans=filtered(motion.trans), expressions=filtered(motion.expressions)
    )
