"""How far a motion is from the recorded motion of the same speech, joint by joint.

Position errors are measured with the pelvis in place, as in pose estimation (root-aligned): a body
that stands a step aside is not wrong at every joint.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from conventions.joints import LEFT_HAND, MIRROR_PERMUTATION, RIGHT_HAND, UPPER_BODY
from model.measures.smoothness import mean_by_depth
from model.motion.kinematics import mirror_local
from model.motion.rotations import geodesic_angle
from model.motion.tracks import Tracks

UPPER_BODY_AND_HANDS = (*UPPER_BODY, *LEFT_HAND, *RIGHT_HAND)

_CHUNK_FRAMES = 2048


@dataclass(frozen=True)
class ErrorBySides:
    """Mean local rotation error of upper body and hands, degrees."""

    as_is: float
    mirrored: float
    """Had the motion been mirrored, left to right."""
    swapped: float
    """Had left and right joints changed places only."""


@dataclass(frozen=True, eq=False)
class ReferenceError:
    """Means over all frames, by the names of ``diagnostics.json``."""

    position_error_m: Float[np.ndarray, " 55"]
    global_rotation_error_deg: Float[np.ndarray, " 55"]
    """Angle between the joint's rotations in the world."""
    local_rotation_error_deg: Float[np.ndarray, " 55"]
    """The same relative to the parent joint."""
    position_error_by_depth_m: Float[np.ndarray, " 11"]
    global_rotation_error_by_depth_deg: Float[np.ndarray, " 11"]
    local_rotation_error_by_depth_deg: Float[np.ndarray, " 11"]
    root_error_m: float
    """Distance of the two pelvises in the world."""
    rotation_error_by_sides_deg: ErrorBySides


def error_to_reference(tracks: Tracks, reference: Tracks) -> ReferenceError:
    """Errors of a motion of as many frames as the reference has."""
    rooted, rooted_reference = (t.joints - t.joints[:, :1] for t in (tracks, reference))
    position_m = np.linalg.norm(rooted - rooted_reference, axis=-1).mean(axis=0)
    global_deg = mean_angle_deg(tracks.global_rot, reference.global_rot)
    local_deg = mean_angle_deg(tracks.local_rot, reference.local_rot)
    swapped = tracks.local_rot[:, list(MIRROR_PERMUTATION)]
    by_sides = (
        local_deg,
        mean_angle_deg(_mirrored(tracks.local_rot), reference.local_rot),
        mean_angle_deg(swapped, reference.local_rot),
    )
    return ReferenceError(
        position_error_m=position_m,
        global_rotation_error_deg=global_deg,
        local_rotation_error_deg=local_deg,
        position_error_by_depth_m=mean_by_depth(position_m),
        global_rotation_error_by_depth_deg=mean_by_depth(global_deg),
        local_rotation_error_by_depth_deg=mean_by_depth(local_deg),
        root_error_m=float(
            np.linalg.norm(tracks.joints[:, 0] - reference.joints[:, 0], axis=-1).mean()
        ),
        rotation_error_by_sides_deg=ErrorBySides(
            *(float(error[list(UPPER_BODY_AND_HANDS)].mean()) for error in by_sides)
        ),
    )


def mean_angle_deg(
    a: Float[np.ndarray, "T J 3 3"], b: Float[np.ndarray, "T J 3 3"]
) -> Float[np.ndarray, " J"]:
    """Mean angle between two rotations of each joint."""
    total = np.zeros(a.shape[1])
    for start in range(0, len(a), _CHUNK_FRAMES):
        frames = slice(start, start + _CHUNK_FRAMES)
        parts = (torch.from_numpy(rotmat[frames]) for rotmat in (a, b))
        total += geodesic_angle(*parts).double().sum(0).numpy()
    return np.degrees(total / len(a))


def _mirrored(local_rot: Float[np.ndarray, "T 55 3 3"]) -> Float[np.ndarray, "T 55 3 3"]:
    return mirror_local(torch.from_numpy(local_rot)).numpy()
