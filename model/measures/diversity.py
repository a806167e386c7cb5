"""How much poses, and windows of motion, differ from each other."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.spatial.distance import pdist, squareform

from conventions.joints import NUM_JOINTS
from model.data.recordings import face_units
from model.motion.motion import Motion
from model.motion.rotations import axis_angle_from_matrix

BATCH_WINDOWS = 50
"""B of AsynFusion's eq. 17."""
WINDOW_FRAMES, EVERY_FRAMES = 60, 2
"""2 s at 15 frames per second, as the paper has them (34 frames at 15 per second)."""
GESTURE_DIM = 3 * NUM_JOINTS


@dataclass(frozen=True)
class Diversity:
    """Of the poses of one motion."""

    l1_diversity_m: float


def diversity(positions: Float[np.ndarray, "T J 3"]) -> Diversity:
    """Of joints about the first of them, in metres."""
    return Diversity(l1_to_mean(positions - positions[:, :1]))


def l1_to_mean(positions: Float[np.ndarray, "T J 3"]) -> float:
    """EMAGE's diversity: L1 distance to the clip's mean pose, summed over coordinates, metres."""
    return float(np.abs(positions - positions.mean(0)).sum((1, 2)).mean())


def windows_of(motion: Motion) -> Float32[np.ndarray, "W 30 dim"]:
    """The motion end to end in windows of 2 s, at 15 frames per second.

    Returns:
        Local rotations of 55 joints as axis times an angle up to pi (165 numbers, radians), then
        52 face units where the motion has those.
    """
    num_windows = motion.num_frames // WINDOW_FRAMES
    frames = slice(0, num_windows * WINDOW_FRAMES, EVERY_FRAMES)
    rotations = axis_angle_from_matrix(motion.local_rotations()[frames])
    parts = [rotations.flatten(1).numpy()]
    if motion.expression_basis == "arkit52":
        parts.append(face_units(motion)[frames])
    numbers = np.concatenate(parts, axis=1)
    return numbers.reshape(num_windows, WINDOW_FRAMES // EVERY_FRAMES, numbers.shape[1])


def batches(num_windows: int) -> Iterator[Int[np.ndarray, " B"]]:
    """Windows dealt at random, always in the same way, in batches of 50; what is left over makes
    the last one."""
    order = np.random.default_rng(0).permutation(num_windows)
    for start in range(0, num_windows, BATCH_WINDOWS):
        yield order[start : start + BATCH_WINDOWS]


def pair_distances(windows: Float[np.ndarray, "B T dim"]) -> Float[np.ndarray, "B B"]:
    """L1 distance of every two windows (the terms of AsynFusion's eq. 17), mean over their numbers
    so that it does not depend on how many they have."""
    flat = windows.reshape(len(windows), -1)
    return squareform(pdist(flat, "cityblock")) / flat.shape[1]
