"""How fast and how smoothly all joints and fingertips move and turn, at 30 fps."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from conventions.joints import LEFT_HAND, RIGHT_HAND
from conventions.rates import FPS
from model.measures.shapes import ByDepth, ByFingertip, ByJoint, Sides
from model.measures.smoothness import (
    angular_velocity,
    derivative_magnitudes,
    mean_by_depth,
    mean_over_time,
)
from model.motion.tracks import Tracks

FINGERS_STILL_DEG_S = 1.0
"""A hand is still from one frame to the next if none of its finger joints turns faster."""
_THIRD_DIFFERENCE_VARIANCE = 20.0
"""Of unit white noise: 1 + 9 + 9 + 1."""
_MEDIAN_LENGTH = 1.5382
"""Median length of a vector of three independent normals of deviation 1 (chi, 3 degrees)."""


@dataclass(frozen=True)
class FingertipMeasures:
    """Of the ten rigid fingertips."""

    fingertips_path_m_s: ByFingertip
    fingertips_acceleration_m_s2: ByFingertip
    fingertips_jerk_m_s3: ByFingertip


@dataclass(frozen=True)
class PositionMeasures:
    """Of all joints' positions."""

    joint_speed_m_s: ByJoint
    joint_acceleration_m_s2: ByJoint
    joint_jerk_m_s3: ByJoint
    speed_by_depth_m_s: ByDepth
    acceleration_by_depth_m_s2: ByDepth
    jerk_by_depth_m_s3: ByDepth


@dataclass(frozen=True)
class RotationMeasures:
    """Of all joints' rotations."""

    joint_angular_speed_deg_s: ByJoint
    joint_angular_acceleration_deg_s2: ByJoint
    angular_speed_by_depth_deg_s: ByDepth
    angular_acceleration_by_depth_deg_s2: ByDepth
    joint_rotation_noise_deg: ByJoint
    fingers_still_share: Sides[float]


def fingertip_measures(tracks: Tracks) -> FingertipMeasures:
    """Of the ten rigid fingertips."""
    return FingertipMeasures(
        *(mean_over_time(derivative_magnitudes(tracks.fingertips, order)) for order in (1, 2, 3))
    )


def position_measures(tracks: Tracks) -> PositionMeasures:
    """Of all joints' positions."""
    found = [mean_over_time(derivative_magnitudes(tracks.joints, order)) for order in (1, 2, 3)]
    return PositionMeasures(*found, *map(mean_by_depth, found))


def rotation_measures(tracks: Tracks) -> RotationMeasures:
    """Of all joints' rotations."""
    velocity = angular_velocity(tracks.local_rot)  # (T - 1, 55, 3)
    magnitude = np.degrees(np.linalg.norm(velocity, axis=-1))
    change = np.stack(  # joint by joint: all differences of a long clip are large
        [np.linalg.norm(np.diff(one, axis=0), axis=-1) for one in velocity.swapaxes(0, 1)], axis=1
    )
    change = np.degrees(change) * FPS
    speed, acceleration = mean_over_time(magnitude), mean_over_time(change)

    def still_share(joints: list[int]) -> float:
        is_still = magnitude[:, joints].max(axis=1) < FINGERS_STILL_DEG_S
        return float(mean_over_time(is_still.astype(np.float64)))

    return RotationMeasures(
        joint_angular_speed_deg_s=speed,
        joint_angular_acceleration_deg_s2=acceleration,
        angular_speed_by_depth_deg_s=mean_by_depth(speed),
        angular_acceleration_by_depth_deg_s2=mean_by_depth(acceleration),
        joint_rotation_noise_deg=np.degrees(rotation_noise(velocity)),
        fingers_still_share=Sides(still_share(list(LEFT_HAND)), still_share(list(RIGHT_HAND))),
    )


def rotation_noise(
    velocity: Float[np.ndarray, "steps *joints 3"],
) -> Float[np.ndarray, " *joints"]:
    """Deviation, in radians about each axis, of the white noise that rotations seem to hold.

    From the median length of the third difference of the turning, which hardly sees movement and
    no rare glitch: noise of deviation s gives sqrt(20) s on each axis. NaN under 4 frames.

    Args:
        velocity: from `angular_velocity`, rad/s.
    """
    third = np.linalg.norm(np.diff(velocity, n=2, axis=0), axis=-1) / FPS
    if not len(third):
        return np.full(third.shape[1:], np.nan)
    return np.median(third, axis=0) / (_MEDIAN_LENGTH * np.sqrt(_THIRD_DIFFERENCE_VARIANCE))
