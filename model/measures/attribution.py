"""Which joint makes a point jerk? Each joint of its chain is smoothed alone, and the jerk taken
again.

Smoothing the local rotation of joint j from R to S leaves everything above j and the shape of the
chain below it as they are, so that forward kinematics of the changed chain comes down to a turn of
the point about the joint: ``p' = p_j + G_parent(j) S G_j^T (p - p_j)``, exact for any point that
moves rigidly with the last joint of the chain.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from conventions.joints import JOINT_NAMES, PARENTS
from model.measures.smoothness import STILL_M_S3, derivative_magnitudes, mean_over_time
from model.motion.filtering import smooth_over_time, smooth_rotations
from model.motion.tracks import Tracks


@dataclass(frozen=True)
class JerkAttribution:
    """How much less a point jerks when one thing alone is smoothed; 1 is all of its jerk.

    Shares need not add up to 1: errors of two joints can hide each other, and then a share is
    negative. NaN under 4 frames and where nothing moves.
    """

    joints: tuple[str, ...]
    """From the pelvis to the last joint that moves the point."""
    share: Float[np.ndarray, " chain"]
    translation_share: float
    """The same for the body's translation."""


def attribute_jerk(
    point: Float[np.ndarray, "T 3"], tracks: Tracks, chain: tuple[int, ...]
) -> JerkAttribution:
    """Relative drop of the mean jerk of ``point`` for each joint of its chain.

    Args:
        point: positions in metres.
        chain: the joints whose rotation moves the point, pelvis first (`tracks.moving_chain`).
    """
    whole = _mean_jerk(point)
    share = np.full(len(chain), np.nan)
    translation_share = np.nan
    if whole > STILL_M_S3:  # false for NaN too
        for index, joint in enumerate(chain):
            local_rot = torch.from_numpy(tracks.local_rot[:, joint]).double()
            turned = _turned_about(point, tracks, joint, smooth_rotations(local_rot).numpy())
            share[index] = 1 - _mean_jerk(turned) / whole
        pelvis = tracks.joints[:, 0]
        moved = point + smooth_over_time(pelvis) - pelvis
        translation_share = 1 - _mean_jerk(moved) / whole
    return JerkAttribution(
        tuple(JOINT_NAMES[joint] for joint in chain), share, float(translation_share)
    )


def _turned_about(
    point: Float[np.ndarray, "T 3"],
    tracks: Tracks,
    joint: int,
    local_rot: Float[np.ndarray, "T 3 3"],
) -> Float[np.ndarray, "T 3"]:
    """The point with other local rotations of one joint."""
    pivot = tracks.joints[:, joint]
    in_joint = np.einsum("tji,tj->ti", tracks.global_rot[:, joint], point - pivot)
    in_parent = np.einsum("tij,tj->ti", local_rot, in_joint)
    if PARENTS[joint] >= 0:
        in_parent = np.einsum("tij,tj->ti", tracks.global_rot[:, PARENTS[joint]], in_parent)
    return pivot + in_parent


def _mean_jerk(positions: Float[np.ndarray, "T 3"]) -> float:
    return float(mean_over_time(derivative_magnitudes(positions, 3)))
