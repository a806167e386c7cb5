"""How far a motion is from the recorded motion of the same speech, joint by joint.

Position errors are measured with the pelvis in place, as in pose estimation (root-aligned): a body
that stands a step aside is not wrong at every joint.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from model.motion.kinematics import mirror_local
from model.motion.rotations import geodesic_angle
from model.motion.skeleton import LEFT_HAND, MIRROR_PERMUTATION, RIGHT_HAND, UPPER_BODY
from model.motion.tracks import Tracks

UPPER_BODY_AND_HANDS = (*UPPER_BODY, *LEFT_HAND, *RIGHT_HAND)

_CHUNK_FRAMES = 2048


@dataclass(frozen=True, eq=False)
class ReferenceError:
    """Means over all frames."""

    position_m: Float[np.ndarray, " 55"]
    global_rotation_deg: Float[np.ndarray, " 55"]
    """Angle between the joint's rotations in the world."""
    local_rotation_deg: Float[np.ndarray, " 55"]
    """The same relative to the parent joint."""
    root_m: float
    """Distance of the two pelvises in the world."""
    by_sides_deg: dict[str, float]
    """Mean local rotation error of upper body and hands ``as_is``; ``mirrored``: had the motion
    been mirrored, left to right; ``swapped``: had left and right joints changed places only."""


def error_to_reference(tracks: Tracks, reference: Tracks) -> ReferenceError:
    """Errors of a motion of as many frames as the reference has."""
    rooted, rooted_reference = (t.joints - t.joints[:, :1] for t in (tracks, reference))
    local_rotation_deg = mean_angle_deg(tracks.local_rot, reference.local_rot)
    by_sides = {
        "as_is": local_rotation_deg,
        "mirrored": mean_angle_deg(_mirrored(tracks.local_rot), reference.local_rot),
        "swapped": mean_angle_deg(
            tracks.local_rot[:, list(MIRROR_PERMUTATION)], reference.local_rot
        ),
    }
    return ReferenceError(
        position_m=np.linalg.norm(rooted - rooted_reference, axis=-1).mean(axis=0),
        global_rotation_deg=mean_angle_deg(tracks.global_rot, reference.global_rot),
        local_rotation_deg=local_rotation_deg,
        root_m=float(np.linalg.norm(tracks.joints[:, 0] - reference.joints[:, 0], axis=-1).mean()),
        by_sides_deg={
            name: float(error[list(UPPER_BODY_AND_HANDS)].mean())
            for name, error in by_sides.items()
        },
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
