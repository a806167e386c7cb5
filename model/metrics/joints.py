"""Speed and smoothness of joints and fingertips at 30 fps, and bends beyond the human range.

A joint's bend is the direction of its next bone relative to the bone before, against the rest pose
(flat hand, straight arm); a turn of the bone about itself is not part of it. Ranges are the normal
active motion of the American Academy of Orthopaedic Surgeons (*Joint Motion: Method of Measuring
and Recording*, 1965): metacarpophalangeal joints bend 90 degrees inwards and 45 outwards, proximal
interphalangeal 100 and 0, distal 80 to 90 and 0; the thumb's joints 70 (palmar abduction), 55 and
80. `TOLERANCE_DEG` is added to each.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64

from conventions.joints import (
    FINGERTIP_NAMES,
    HANDS,
    JOINT_INDEX,
    JOINT_NAMES,
    LEFT_HAND,
    RIGHT_HAND,
)
from conventions.rates import FPS
from model.metrics.smoothness import (
    ByDepth,
    ByFingertip,
    ByJoint,
    Sides,
    angular_velocity,
    derivative_magnitudes,
    mean_by_depth,
    mean_over_time,
)
from model.motion.kinematics import RestSkeleton
from model.motion.tracks import Tracks

FINGERS_STILL_DEG_S = 1.0
"""Angular speed (degrees/s) below which all finger joints of a hand stay while it is still."""
_THIRD_DIFFERENCE_VARIANCE = 20.0
"""Variance of the third difference of unit white noise: 1 + 9 + 9 + 1."""
_MEDIAN_LENGTH = 1.5382
"""Median length of a vector of three independent normals of deviation 1 (chi, 3 degrees)."""


@dataclass(frozen=True)
class FingertipMetrics:
    """Mean speed, acceleration and jerk of the ten rigid fingertips."""

    fingertips_speed_m_s: ByFingertip
    fingertips_acceleration_m_s2: ByFingertip
    fingertips_jerk_m_s3: ByFingertip


@dataclass(frozen=True)
class PositionMetrics:
    """Mean speed, acceleration and jerk of all joints, and their means by depth."""

    joint_speed_m_s: ByJoint
    joint_acceleration_m_s2: ByJoint
    joint_jerk_m_s3: ByJoint
    speed_by_depth_m_s: ByDepth
    acceleration_by_depth_m_s2: ByDepth
    jerk_by_depth_m_s3: ByDepth


@dataclass(frozen=True)
class RotationMetrics:
    """Mean angular speed, angular acceleration and rotation noise of all joints."""

    joint_angular_speed_deg_s: ByJoint
    joint_angular_acceleration_deg_s2: ByJoint
    angular_speed_by_depth_deg_s: ByDepth
    angular_acceleration_by_depth_deg_s2: ByDepth
    joint_rotation_noise_deg: ByJoint
    fingers_still_share: Sides[float]
    """Share of frames in which no finger joint of the hand moves."""


def fingertip_metrics(tracks: Tracks) -> FingertipMetrics:
    """Compute the metrics of the ten rigid fingertips."""
    return FingertipMetrics(
        *(mean_over_time(derivative_magnitudes(tracks.fingertips, order)) for order in (1, 2, 3))
    )


def position_metrics(tracks: Tracks) -> PositionMetrics:
    """Compute the metrics of all joint positions."""
    means = [mean_over_time(derivative_magnitudes(tracks.joints, order)) for order in (1, 2, 3)]
    return PositionMetrics(*means, *map(mean_by_depth, means))


def rotation_metrics(tracks: Tracks) -> RotationMetrics:
    """Compute the metrics of all local joint rotations."""
    velocity = angular_velocity(tracks.R_parent_joint)  # (T - 1, 55, 3)
    magnitude = np.degrees(np.linalg.norm(velocity, axis=-1))
    change = np.stack(  # joint by joint: all differences of a long clip are large
        [np.linalg.norm(np.diff(one, axis=0), axis=-1) for one in velocity.swapaxes(0, 1)], axis=1
    )
    change = np.degrees(change) * FPS
    speed, acceleration = mean_over_time(magnitude), mean_over_time(change)

    def still_share(joints: list[int]) -> float:
        is_still = magnitude[:, joints].max(axis=1) < FINGERS_STILL_DEG_S
        return float(mean_over_time(is_still.astype(np.float64)))

    return RotationMetrics(
        joint_angular_speed_deg_s=speed,
        joint_angular_acceleration_deg_s2=acceleration,
        angular_speed_by_depth_deg_s=mean_by_depth(speed),
        angular_acceleration_by_depth_deg_s2=mean_by_depth(acceleration),
        joint_rotation_noise_deg=np.degrees(estimate_rotation_noise_rad(velocity)),
        fingers_still_share=Sides(still_share(list(LEFT_HAND)), still_share(list(RIGHT_HAND))),
    )


def estimate_rotation_noise_rad(
    velocity: Float[np.ndarray, "steps *joints 3"],
) -> Float[np.ndarray, " *joints"]:
    """Estimate the white noise of rotations: its standard deviation about each axis (rad).

    From `angular_velocity` (rad/s). The estimate is the median length of the third difference of
    the rotation, which is insensitive to movement and to rare glitches: noise of deviation s gives
    sqrt(20) s on each axis. NaN under 4 frames.
    """
    third = np.linalg.norm(np.diff(velocity, n=2, axis=0), axis=-1) / FPS
    if not len(third):
        return np.full(third.shape[1:], np.nan)
    return np.median(third, axis=0) / (_MEDIAN_LENGTH * np.sqrt(_THIRD_DIFFERENCE_VARIANCE))


FLEXION_DEG = {1: (-45.0, 90.0), 2: (0.0, 100.0), 3: (0.0, 90.0)}
"""Range of a finger's first, second and third joint (degrees): outwards (negative) and inwards."""
THUMB_BEND_DEG = {1: 70.0, 2: 55.0, 3: 80.0}
"""Largest bend of the thumb's joints (degrees) in any direction, as its axes are oblique."""
SIDEWAYS_DEG = 40.0
"""Largest sideways bend (degrees): twice the spread of 20 degrees, because a little finger's rest
bone is at an angle to the plane in which it bends."""
TOLERANCE_DEG = 20.0
"""Tolerance (degrees) for errors of motion capture and of the rest pose. With it, less than 1 % of
the frames and finger joints of the recorded clips that were tried lie outside."""
ELBOW_BACKWARDS_DEG = 15.0
"""Backward bend of an elbow that counts (degrees); healthy elbows overextend by up to 10 to 15."""

FINGER_JOINT_NAMES = tuple(JOINT_NAMES[joint] for joint in HANDS)


class BendAngles(NamedTuple):
    """Angles of a joint's bend over time (degrees)."""

    flexion: Float64[np.ndarray, " T"]
    """Positive inwards."""
    sideways: Float64[np.ndarray, " T"]
    """Bend to the side, from -90 to 90."""
    whole: Float64[np.ndarray, " T"]


def bend_angles_deg(
    R_parent_joint: Float[np.ndarray, "T 3 3"],
    bone: Float[np.ndarray, " 3"],
    inwards: Float[np.ndarray, " 3"],
) -> BendAngles:
    """Compute flexion, sideways bend and whole bend (degrees).

    ``bone`` is the rest direction of the next bone, of any length; ``inwards`` the direction of
    flexion in the rest pose, for example a palm's normal.
    """
    along = bone / np.linalg.norm(bone)
    normal = inwards - (inwards @ along) * along
    normal /= np.linalg.norm(normal)
    frame = np.stack([along, normal, np.cross(along, normal)])
    forwards, flexed, sideways = frame @ (R_parent_joint.astype(np.float64) @ along).T
    whole = np.arctan2(np.hypot(flexed, sideways), forwards)
    flexion = np.arctan2(flexed, forwards)
    sideways_bend = np.arcsin(np.clip(sideways, -1, 1))
    return BendAngles(np.degrees(flexion), np.degrees(sideways_bend), np.degrees(whole))


def finger_outside_limits(
    R_parent_joint: Float[np.ndarray, "T 55 3 3"], skeleton: RestSkeleton
) -> Bool[np.ndarray, "T 30"]:
    """Check whether each finger joint is bent beyond the human range, in the order of `HANDS`."""
    palm = np.array([0.0, -1.0, 0.0])  # of both hands in the T-pose
    outside = []
    for joint in HANDS:
        name = JOINT_NAMES[joint]
        segment = int(name[-1])
        flexion, sideways, whole = bend_angles_deg(
            R_parent_joint[:, joint], _next_bone(joint, skeleton), palm
        )
        if "thumb" in name:
            outside.append(whole > THUMB_BEND_DEG[segment] + TOLERANCE_DEG)
            continue
        lowest, highest = FLEXION_DEG[segment]
        is_flexion_out = (flexion < lowest - TOLERANCE_DEG) | (flexion > highest + TOLERANCE_DEG)
        outside.append(is_flexion_out | (np.abs(sideways) > SIDEWAYS_DEG + TOLERANCE_DEG))
    return np.stack(outside, axis=1)


def elbow_backwards_share(
    R_parent_joint: Float[np.ndarray, "T 55 3 3"], skeleton: RestSkeleton, side: str
) -> float:
    """Compute the share of frames in which an elbow is bent backwards by more than 15 degrees."""
    elbow, wrist = (JOINT_INDEX[f"{side}_{name}"] for name in ("elbow", "wrist"))
    rest = skeleton.rest_joints.double().numpy()
    forwards = np.array([0.0, 0.0, 1.0])  # where a forearm goes in the T-pose
    bend = bend_angles_deg(R_parent_joint[:, elbow], rest[wrist] - rest[elbow], forwards)
    return float(np.mean(bend.flexion < -ELBOW_BACKWARDS_DEG))


def _next_bone(joint: int, skeleton: RestSkeleton) -> Float64[np.ndarray, " 3"]:
    """Return the vector from a finger joint to the next one, or to the tip, in the rest pose."""
    finger, segment = JOINT_NAMES[joint][:-1], int(JOINT_NAMES[joint][-1])
    if segment == 3:
        return skeleton.tip_offsets[FINGERTIP_NAMES.index(finger)].double().numpy()
    rest = skeleton.rest_joints.double().numpy()
    return rest[JOINT_INDEX[f"{finger}{segment + 1}"]] - rest[joint]


@dataclass(frozen=True)
class JointLimitMetrics:
    """Shares of all frames with joints beyond the human range."""

    finger_angle_outside_share: float
    finger_angle_outside_by_joint: dict[str, float]
    elbow_backwards_share: Sides[float]


def joint_limit_metrics(tracks: Tracks, skeleton: RestSkeleton) -> JointLimitMetrics:
    """Compute how often finger joints and elbows are bent beyond the human range."""
    share = finger_outside_limits(tracks.R_parent_joint, skeleton).mean(axis=0)
    left, right = (
        elbow_backwards_share(tracks.R_parent_joint, skeleton, s) for s in ("left", "right")
    )
    return JointLimitMetrics(
        finger_angle_outside_share=float(share.mean()),
        finger_angle_outside_by_joint=dict(zip(FINGER_JOINT_NAMES, share.tolist(), strict=True)),
        elbow_backwards_share=Sides(left, right),
    )
