"""The same random turns on the local and on the global rotations of a motion."""

from dataclasses import replace

import torch

from conventions.joints import JOINT_INDEX
from model.motion.kinematics import global_from_local, local_from_global
from model.motion.motion import Motion
from model.motion.rotations import axis_angle_from_matrix, matrix_from_axis_angle

_LEFT_ALONE = [JOINT_INDEX[name] for name in ("jaw", "left_eye", "right_eye")]
"""Nothing hangs on them, and a face that trembles distracts."""


def noisy_motions(motion: Motion, noise_rad: float, seed: int = 0) -> tuple[Motion, Motion]:
    """The motion with turns of every joint in every frame, on local and on global rotations.

    Each turn has independent components of deviation ``noise_rad``, fresh in every frame, about the
    joint's own axes; both motions get the same ones (`model.measures.error_growth` says what
    follows from that).

    Returns:
        With noise on local rotations, and with noise on global ones.
    """
    generator = torch.Generator().manual_seed(seed)
    local_rot = motion.local_rotations().double()
    turn = noise_rad * torch.randn(local_rot.shape[:-1], generator=generator).double()
    turn[:, _LEFT_ALONE] = 0.0
    noise = matrix_from_axis_angle(turn)
    on_global = local_from_global(global_from_local(local_rot) @ noise)
    # The head's own turn is not handed on to what stays as it is in the head.
    on_global[:, _LEFT_ALONE] = local_rot[:, _LEFT_ALONE]
    return _with_rotations(motion, local_rot @ noise), _with_rotations(motion, on_global)


def _with_rotations(motion: Motion, local_rot: torch.Tensor) -> Motion:
    poses = axis_angle_from_matrix(local_rot).flatten(-2).float().numpy()
    return replace(motion, poses=poses)
