"""All numbers of one motion, by the keys of ``diagnostics.json`` (``docs/formats.md``)."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from model.measures.attribution import attribute_jerk
from model.measures.diversity import l1_to_mean
from model.measures.joint_range import FINGER_JOINT_NAMES, elbow_backwards_share, finger_is_outside
from model.measures.posture import (
    FEET,
    HIGH_PERCENTILE,
    LOW_PERCENTILE,
    foot_slide,
    hand_speed_symmetry,
    height_above_ground,
    root_drift,
    spine_tilt_deg,
)
from model.measures.reference_error import error_to_reference
from model.measures.seams import jerk_by_window_phase, recurring_jerk, seam_jerk_ratio
from model.measures.smoothness import (
    angular_velocity,
    derivative_magnitudes,
    mean_over_movements,
    mean_over_time,
    rotation_noise,
)
from model.measures.spectrum import HIGH_FREQUENCY_HZ, velocity_spectrum
from model.motion.motion import Motion
from model.motion.skeleton import JOINT_DEPTH, LEFT_HAND, RIGHT_HAND, RestSkeleton
from model.motion.timing import FPS
from model.motion.tracks import Tracks, moving_chain, track_points

WINDOW_ADVANCE = 52
"""Frames from one generated window to the next: 60 less the 8 they share."""
WINDOW_OVERLAP = 8
TIP = "right_middle"
"""The fingertip of the paper's Figure 6."""
FINGERS_STILL_DEG_S = 1.0
"""A hand is still from one frame to the next if none of its finger joints turns faster."""
SIDES = {"left": 0, "right": 1}
_HAND = {"left": list(LEFT_HAND), "right": list(RIGHT_HAND)}

Measures = dict[str, Any]


def measures(
    motion: Motion,
    skeleton: RestSkeleton,
    tip: str = TIP,
    window_advance: int = WINDOW_ADVANCE,
    window_overlap: int = WINDOW_OVERLAP,
) -> Measures:
    """The numbers of one motion as it is; None where the clip is too short to have one.

    Args:
        tip: the fingertip or joint to follow, one of `model.motion.tracks.POINT_NAMES`.
        window_advance: frames from one generated window to the next, for the seams.
        window_overlap: frames that two windows share.
    """
    tracks = track_points(motion, skeleton)
    return measures_of_tracks(
        tracks, tracks.point(tip), tip, skeleton, window_advance, window_overlap
    )


def measures_of_tracks(
    tracks: Tracks,
    point: Float[np.ndarray, "T 3"],
    name: str,
    skeleton: RestSkeleton,
    window_advance: int,
    window_overlap: int,
) -> Measures:
    """What `measures` returns, where forward kinematics has been done.

    Args:
        point: positions of the followed point in metres, which is called ``name``.
    """
    numbers = {
        **_of_point(point, tracks, moving_chain(name)),
        **_of_fingertips(tracks),
        **_of_joint_positions(tracks),
        **_of_joint_rotations(tracks),
        "seam_jerk_ratio": seam_jerk_ratio(tracks.joints, window_advance, window_overlap),
        "jerk_by_window_phase_m_s3": jerk_by_window_phase(tracks.joints, window_advance),
        "recurring_jerk": vars(recurring_jerk(tracks.joints, window_advance)),
        **_of_posture(tracks),
        **_of_joint_ranges(tracks, skeleton),
        "l1_diversity_m": l1_to_mean(tracks.joints - tracks.joints[:, :1]),
    }
    return as_json(numbers)


def measures_to_reference(tracks: Tracks, reference: Tracks) -> Measures:
    """Errors of one motion to the recorded one, of as many frames."""
    error = error_to_reference(tracks, reference)
    by_joint = {
        "position_error_m": error.position_m,
        "global_rotation_error_deg": error.global_rotation_deg,
        "local_rotation_error_deg": error.local_rotation_deg,
    }
    return as_json(
        {
            **by_joint,
            "position_error_by_depth_m": mean_by_depth(error.position_m),
            "global_rotation_error_by_depth_deg": mean_by_depth(error.global_rotation_deg),
            "local_rotation_error_by_depth_deg": mean_by_depth(error.local_rotation_deg),
            "root_error_m": error.root_m,
            "rotation_error_by_sides_deg": error.by_sides_deg,
        }
    )


def mean_by_depth(by_joint: Float[np.ndarray, " 55"]) -> Float[np.ndarray, " 11"]:
    """Entry d is the mean over the joints that are d bones away from the pelvis."""
    depth = np.array(JOINT_DEPTH)
    return np.array([by_joint[depth == d].mean() for d in range(max(JOINT_DEPTH) + 1)])


def as_json(value: Any) -> Any:
    """Plain lists and numbers. JSON knows no NaN: None says that there is no such number."""
    if isinstance(value, Mapping):
        return {key: as_json(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return as_json(value.tolist())
    if isinstance(value, list | tuple):
        return [as_json(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _of_point(
    point: Float[np.ndarray, "T 3"], tracks: Tracks, chain: tuple[int, ...]
) -> dict[str, Any]:
    def mean(order: int) -> float:
        return float(mean_over_time(derivative_magnitudes(point, order)))

    arc_length, log_jerk = mean_over_movements(point)
    attribution = attribute_jerk(point, tracks, chain)
    return {
        "tip_jerk_m_s3": mean(3),
        "tip_acceleration_m_s2": mean(2),
        "tip_path_m_s": mean(1),
        **_spectrum_of_point(point),
        "tip_sparc": arc_length,
        "tip_log_dimensionless_jerk": log_jerk,
        "tip_jerk_attribution": {
            "joints": attribution.joints,
            "share": attribution.share,
            "translation_share": attribution.translation_share,
        },
    }


def _spectrum_of_point(point: Float[np.ndarray, "T 3"]) -> dict[str, Any]:
    spectrum = velocity_spectrum(np.diff(point, axis=0) * FPS)
    if spectrum is None or not spectrum.power.any():
        return {"tip_velocity_power_above_5hz": None, "tip_spectrum": None}
    return {
        "tip_velocity_power_above_5hz": float(spectrum.share_above(HIGH_FREQUENCY_HZ)),
        "tip_spectrum": {
            "frequency_hz": spectrum.frequency_hz,
            "velocity_power": spectrum.share(),
        },
    }


def _of_fingertips(tracks: Tracks) -> dict[str, Any]:
    names = ("fingertips_path_m_s", "fingertips_acceleration_m_s2", "fingertips_jerk_m_s3")
    return {
        name: mean_over_time(derivative_magnitudes(tracks.fingertips, order))
        for order, name in enumerate(names, start=1)
    }


def _of_joint_positions(tracks: Tracks) -> dict[str, Any]:
    speed, acceleration, jerk = (
        mean_over_time(derivative_magnitudes(tracks.joints, order)) for order in (1, 2, 3)
    )
    return {
        "joint_speed_m_s": speed,
        "joint_acceleration_m_s2": acceleration,
        "joint_jerk_m_s3": jerk,
        "speed_by_depth_m_s": mean_by_depth(speed),
        "acceleration_by_depth_m_s2": mean_by_depth(acceleration),
        "jerk_by_depth_m_s3": mean_by_depth(jerk),
    }


def _of_joint_rotations(tracks: Tracks) -> dict[str, Any]:
    velocity = angular_velocity(tracks.local_rot)  # (T - 1, 55, 3)
    magnitude = np.degrees(np.linalg.norm(velocity, axis=-1))
    change = np.stack(  # joint by joint: all differences of a long clip are large
        [np.linalg.norm(np.diff(one, axis=0), axis=-1) for one in velocity.swapaxes(0, 1)], axis=1
    )
    change = np.degrees(change) * FPS
    speed, acceleration = mean_over_time(magnitude), mean_over_time(change)
    return {
        "joint_angular_speed_deg_s": speed,
        "joint_angular_acceleration_deg_s2": acceleration,
        "angular_speed_by_depth_deg_s": mean_by_depth(speed),
        "angular_acceleration_by_depth_deg_s2": mean_by_depth(acceleration),
        "joint_rotation_noise_deg": np.degrees(rotation_noise(velocity)),
        "fingers_still_share": {
            side: mean_over_time(
                (magnitude[:, joints].max(axis=1) < FINGERS_STILL_DEG_S).astype(np.float64)
            )
            for side, joints in _HAND.items()
        },
    }


def _of_posture(tracks: Tracks) -> dict[str, Any]:
    feet = tracks.joints[:, list(FEET)]
    tilt = spine_tilt_deg(tracks.joints)
    height = height_above_ground(feet)
    return {
        "foot_slide_m_s": foot_slide(feet),
        "foot_height_m": {
            side: {
                "p5": float(np.percentile(height[:, column], LOW_PERCENTILE)),
                "p95": float(np.percentile(height[:, column], HIGH_PERCENTILE)),
            }
            for side, column in SIDES.items()
        },
        "spine_tilt_deg": {
            "mean": float(tilt.mean()),
            "p95": float(np.percentile(tilt, HIGH_PERCENTILE)),
        },
        "hand_speed_symmetry": hand_speed_symmetry(tracks.joints),
        "root_drift_m": root_drift(tracks.joints[:, 0]),
    }


def _of_joint_ranges(tracks: Tracks, skeleton: RestSkeleton) -> dict[str, Any]:
    share = finger_is_outside(tracks.local_rot, skeleton).mean(axis=0)
    return {
        "finger_angle_outside_share": float(share.mean()),
        "finger_angle_outside_by_joint": dict(zip(FINGER_JOINT_NAMES, share.tolist(), strict=True)),
        "elbow_backwards_share": {
            side: elbow_backwards_share(tracks.local_rot, skeleton, side) for side in SIDES
        },
    }
