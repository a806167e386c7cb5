"""Differences between motions: errors to the recorded motion, by body part, and between windows.

Position errors are pelvis-aligned, as in pose estimation (root-aligned): a body that stands a step
aside is not wrong at every joint.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from scipy.spatial.distance import pdist, squareform

from conventions import joints
from model.metrics.smoothness import mean_by_depth
from model.motion.kinematics import mirror_local
from model.motion.motion import Motion, arkit_weights_or_zeros, first_frames
from model.motion.rotations import axis_angle_from_matrix, geodesic_angle
from model.motion.tracks import Tracks

_FINGERS = "(thumb|index|middle|ring|pinky)"
PARTS = {
    "right arm": r"right_(collar|shoulder|elbow|wrist)",
    "right hand": f"right_{_FINGERS}",
    "left arm": r"left_(collar|shoulder|elbow|wrist)",
    "left hand": f"left_{_FINGERS}",
    "trunk": r"(pelvis|spine)",
    "head": r"(neck|head)",
    "legs": r".*_(hip|knee|ankle|foot)",
}
"""Regular expression for the start of each part's joint names; all others are of the face."""


def rotation_difference_by_part_deg(first: Motion, second: Motion) -> dict[str, float]:
    """Compute the mean angle of local rotations in each part (degrees), the largest first."""
    shortest = min(first.num_frames, second.num_frames)
    a, b = (first_frames(motion, shortest).local_rotations() for motion in (first, second))
    angles = geodesic_angle(a.double(), b.double()).rad2deg().mean(0)
    angles_by_part = {
        part: float(
            angles[[i for i, name in enumerate(joints.JOINT_NAMES) if re.match(begin, name)]].mean()
        )
        for part, begin in PARTS.items()
    }
    return dict(sorted(angles_by_part.items(), key=lambda item: -item[1]))


UPPER_BODY_AND_HANDS = (*joints.UPPER_BODY, *joints.LEFT_HAND, *joints.RIGHT_HAND)

_CHUNK_FRAMES = 2048


@dataclass(frozen=True)
class MirrorErrors:
    """Mean local rotation error of upper body and hands (degrees), as it is and mirrored."""

    as_is: float
    mirrored: float
    """Error after mirroring the motion, left to right (degrees)."""
    swapped: float
    """Error after exchanging left and right joints only (degrees)."""


@dataclass(frozen=True, eq=False)
class ErrorsToReference:
    """Mean errors over all frames; fields are named as in ``diagnostics.json``."""

    position_error_m: Float[np.ndarray, " 55"]
    """Distance between the joint's pelvis-aligned positions (m)."""
    global_rotation_error_deg: Float[np.ndarray, " 55"]
    """Angle between the joint's global rotations (degrees)."""
    local_rotation_error_deg: Float[np.ndarray, " 55"]
    """Angle between the joint's local rotations, relative to the parent joint (degrees)."""
    position_error_by_depth_m: Float[np.ndarray, " 11"]
    global_rotation_error_by_depth_deg: Float[np.ndarray, " 11"]
    local_rotation_error_by_depth_deg: Float[np.ndarray, " 11"]
    root_error_m: float
    """Distance between the two pelvises in world coordinates (m)."""
    rotation_error_by_sides_deg: MirrorErrors
    """Errors with and without mirroring or swapping of left and right."""


def error_to_reference(tracks: Tracks, reference: Tracks) -> ErrorsToReference:
    """Compute the errors of a motion that has as many frames as the reference."""
    rooted, rooted_reference = (t.joints - t.joints[:, :1] for t in (tracks, reference))
    position_m = np.linalg.norm(rooted - rooted_reference, axis=-1).mean(axis=0)
    global_deg = mean_angle_deg(tracks.R_world_joint, reference.R_world_joint)
    local_deg = mean_angle_deg(tracks.R_parent_joint, reference.R_parent_joint)
    swapped = tracks.R_parent_joint[:, list(joints.MIRROR_PERMUTATION)]
    mirrored = mirror_local(torch.from_numpy(tracks.R_parent_joint)).numpy()
    by_sides = (
        local_deg,
        mean_angle_deg(mirrored, reference.R_parent_joint),
        mean_angle_deg(swapped, reference.R_parent_joint),
    )
    return ErrorsToReference(
        position_error_m=position_m,
        global_rotation_error_deg=global_deg,
        local_rotation_error_deg=local_deg,
        position_error_by_depth_m=mean_by_depth(position_m),
        global_rotation_error_by_depth_deg=mean_by_depth(global_deg),
        local_rotation_error_by_depth_deg=mean_by_depth(local_deg),
        root_error_m=float(
            np.linalg.norm(tracks.joints[:, 0] - reference.joints[:, 0], axis=-1).mean()
        ),
        rotation_error_by_sides_deg=MirrorErrors(
            *(float(error[list(UPPER_BODY_AND_HANDS)].mean()) for error in by_sides)
        ),
    )


def mean_angle_deg(
    a: Float[np.ndarray, "T J 3 3"], b: Float[np.ndarray, "T J 3 3"]
) -> Float[np.ndarray, " J"]:
    """Compute each joint's mean angle between two sequences of rotations (degrees)."""
    total = np.zeros(a.shape[1])
    for start in range(0, len(a), _CHUNK_FRAMES):
        frames = slice(start, start + _CHUNK_FRAMES)
        parts = (torch.from_numpy(rotmat[frames]) for rotmat in (a, b))
        total += geodesic_angle(*parts).double().sum(0).numpy()
    return np.degrees(total / len(a))


BATCH_WINDOWS = 50
"""Batch size B of AsynFusion's eq. 17."""
WINDOW_FRAMES, EVERY_FRAMES = 60, 2
"""Window of 2 s at 15 frames per second; the paper's has 34 frames at 15 per second."""
GESTURE_DIM = 3 * joints.NUM_JOINTS


@dataclass(frozen=True)
class Diversity:
    """Diversity of the poses of one motion."""

    l1_diversity_m: float


def diversity(positions: Float[np.ndarray, "T J 3"]) -> Diversity:
    """Compute the L1 diversity of root-relative joint positions (m)."""
    return Diversity(l1_distance_to_mean(positions - positions[:, :1]))


def l1_distance_to_mean(positions: Float[np.ndarray, "T J 3"]) -> float:
    """Compute EMAGE's L1 diversity: distance to the mean pose, summed over coordinates (m)."""
    return float(np.abs(positions - positions.mean(0)).sum((1, 2)).mean())


def diversity_windows(motion: Motion) -> Float32[np.ndarray, "W 30 dim"]:
    """Cut the motion into consecutive windows of 2 s at 15 frames per second.

    They have local rotations of 55 joints as axis times an angle up to pi (165 numbers, radians),
    then 52 ARKit blendshapes if the motion has them.
    """
    num_windows = motion.num_frames // WINDOW_FRAMES
    frames = slice(0, num_windows * WINDOW_FRAMES, EVERY_FRAMES)
    rotations = axis_angle_from_matrix(motion.local_rotations()[frames])
    parts = [rotations.flatten(1).numpy()]
    if motion.expression_basis == "arkit52":
        parts.append(arkit_weights_or_zeros(motion)[frames])
    numbers = np.concatenate(parts, axis=1)
    return numbers.reshape(num_windows, WINDOW_FRAMES // EVERY_FRAMES, numbers.shape[1])


def shuffled_window_batches(num_windows: int) -> Iterator[Int[np.ndarray, " B"]]:
    """Yield batches of 50 shuffled window indices, always the same; the rest comes last."""
    order = np.random.default_rng(0).permutation(num_windows)
    for start in range(0, num_windows, BATCH_WINDOWS):
        yield order[start : start + BATCH_WINDOWS]


def pairwise_l1(windows: Float[np.ndarray, "B T dim"]) -> Float[np.ndarray, "B B"]:
    """Compute the mean L1 distances of all windows (terms of AsynFusion's eq. 17)."""
    flat = windows.reshape(len(windows), -1)
    return squareform(pdist(flat, "cityblock")) / flat.shape[1]
