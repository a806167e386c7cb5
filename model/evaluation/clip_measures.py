"""What is measured on one motion beside the recorded motion of the same clip."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from model.diagnostics.diagnostics import measures, track_points
from model.measures import hearing
from model.measures.diversity import l1_to_mean
from model.motion.motion import Motion
from model.motion.skeleton import RestSkeleton, open_body_skeleton

_ANKLES = [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
MOTION_MEASURES = (
    "tip_jerk_m_s3",
    "tip_path_m_s",
    "tip_velocity_power_above_5hz",
    "seam_jerk_ratio",
    "foot_slide_m_s",
)


@dataclass(frozen=True)
class ClipMeasures:
    """Numbers of one motion; a clip too short to have one lacks it."""

    numbers: dict[str, float]
    jerk_by_depth: list[float]


def clip_measures(motion: Motion, recorded: Motion, skeleton: RestSkeleton) -> ClipMeasures:
    """Smoothness (raw), wander, diversity within the clip, and the error of the face."""
    found = measures(motion, skeleton)
    numbers = {name: found[name] for name in MOTION_MEASURES if found[name] is not None}
    jerk = np.asarray(found["joint_jerk_m_s3"], float)
    numbers["ankle_jerk_m_s3"] = float(jerk[_ANKLES].mean())
    numbers["pelvis_wander_m"] = wander(motion)
    numbers["l1_to_mean_m"] = l1_to_mean(rooted_positions(motion))
    if motion is not recorded and motion.expression_basis == recorded.expression_basis:
        numbers["face_mse"] = face_error(motion, recorded)
    return ClipMeasures(numbers, found["jerk_by_depth_m_s3"])


def hearing_measures(motions: Sequence[Motion], elsewhere: Sequence[Motion]) -> dict[str, float]:
    """What speech and what noise decide, by part of the body (`model.measures.hearing`).

    Args:
        motions: of one speech, one for each noise seed.
        elsewhere: of another speech, with the same noise; none for recorded motion, of which these
            numbers are not known.
    """
    grid = {("own", seed): motion for seed, motion in enumerate(motions)}
    grid |= {("foreign", seed): motion for seed, motion in enumerate(elsewhere)}
    shortest = min(motion.num_frames for motion in grid.values())
    if len(motions) < 2 or len(elsewhere) < 2 or shortest < hearing.LEAST_FRAMES:
        return {}
    found: dict[str, float] = {}
    for part, told in hearing.decided(grid).items():
        found[f"{part}_by_speech"] = told.by_speech
        found[f"{part}_same_noise"] = told.same_noise
    return found | {"arm_rotations_same_noise": hearing.arm_rotations_same_noise(grid)}


def wander(motion: Motion) -> float:
    """Root mean square distance of the pelvis from its mean place on the floor, metres."""
    place = motion.trans[:, [0, 2]]
    return float(np.sqrt(np.square(place - place.mean(0)).sum(1).mean()))


def rooted_positions(motion: Motion) -> Float[np.ndarray, "T 55 3"]:
    """Joints in metres with the pelvis in place and its orientation kept, as in EMAGE's metrics."""
    joints = track_points(motion, open_body_skeleton()).joints
    return joints - joints[:, :1]


def mean_pairwise_l1(positions: Sequence[Float[np.ndarray, "_ J 3"]]) -> Float[np.ndarray, "n n"]:
    """Diversity between clips: L1 distance of every two, frame by frame over the shorter of them,
    summed over coordinates and averaged over frames, metres."""
    distances = np.zeros((len(positions), len(positions)))
    for i, a in enumerate(positions):
        for j, b in enumerate(positions[:i]):
            frames = min(len(a), len(b))
            distances[i, j] = np.abs(a[:frames] - b[:frames]).sum((1, 2)).mean()
    return distances + distances.T


def face_error(motion: Motion, recorded: Motion) -> float:
    """Mean squared error of the expression coefficients, over the frames that both have."""
    frames = min(motion.num_frames, recorded.num_frames)
    difference = motion.expressions[:frames] - recorded.expressions[:frames]
    used = np.abs(recorded.expressions).max(0) > 0  # the basis may fill fewer columns
    return float(np.square(difference[:, used]).mean()) if used.any() else 0.0
