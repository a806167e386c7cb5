"""Measures one motion: every number of `model.measures.results.Measures`."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from model.measures.attribution import attribute_jerk
from model.measures.diversity import l1_to_mean
from model.measures.joins.periods import Period, find_period, part_jerk_by_phase
from model.measures.joins.seams import (
    RecurringJerk,
    Windows,
    jerk_by_window_phase,
    recurring_jerk,
    seam_jerk_ratio,
)
from model.measures.joint_range import FINGER_JOINT_NAMES, elbow_backwards_share, finger_is_outside
from model.measures.posture import (
    FEET,
    HIGH_PERCENTILE,
    LOW_PERCENTILE,
    foot_contact,
    foot_slide,
    hand_speed_symmetry,
    height_above_ground,
    root_drift,
    spine_tilt_deg,
)
from model.measures.results import (
    Diversity,
    FingertipMeasures,
    HeightRange,
    Measures,
    PointMeasures,
    PositionMeasures,
    PostureMeasures,
    RangeMeasures,
    RotationMeasures,
    SeamMeasures,
    Sides,
    Spectrum,
    Tilt,
)
from model.measures.smoothness import (
    angular_velocity,
    derivative_magnitudes,
    mean_by_depth,
    mean_over_movements,
    mean_over_time,
    rotation_noise,
)
from model.measures.spectrum import HIGH_FREQUENCY_HZ, velocity_spectrum
from model.motion.motion import Motion
from model.motion.skeleton import LEFT_HAND, RIGHT_HAND, RestSkeleton
from model.motion.timing import FPS
from model.motion.tracks import Tracks, moving_chain, track_points

OWN_WINDOWS = Windows(advance=52, overlap=8)
"""Of GlobalDiff's systems: 60 frames, of which two windows share 8."""
TIP = "right_middle"
"""The fingertip of the paper's Figure 6."""
FINGERS_STILL_DEG_S = 1.0
"""A hand is still from one frame to the next if none of its finger joints turns faster."""


def measure_motion(
    motion: Motion,
    skeleton: RestSkeleton,
    tip: str = TIP,
    windows: Windows | None = OWN_WINDOWS,
) -> Measures:
    """The numbers of one motion as it is.

    Args:
        tip: the fingertip or joint that the ``tip_`` measures follow.
        windows: how it was cut, if that is known.
    """
    tracks = track_points(motion, skeleton)
    period = find_period(tracks)
    return measure_tracks(tracks, tracks.point(tip), tip, skeleton, windows, period)


def measures(motion: Motion, skeleton: RestSkeleton, tip: str = TIP) -> dict[str, Any]:
    """What `measure_motion` finds, by the keys of ``diagnostics.json``."""
    return measure_motion(motion, skeleton, tip).as_json()


def measure_tracks(
    tracks: Tracks,
    point: Float[np.ndarray, "T 3"],
    name: str,
    skeleton: RestSkeleton,
    windows: Windows | None,
    period: Period | None,
) -> Measures:
    """What `measure_motion` returns, where forward kinematics has been done.

    Args:
        point: positions of the followed point in metres, which is called ``name``.
        period: what `find_period` finds in the motion as it is, before any filter.
    """
    return Measures(
        _of_point(point, tracks, moving_chain(name)),
        _of_fingertips(tracks),
        _of_joint_positions(tracks),
        _of_joint_rotations(tracks),
        _of_seams(tracks, windows, period),
        _of_posture(tracks),
        _of_joint_ranges(tracks, skeleton),
        Diversity(l1_to_mean(tracks.joints - tracks.joints[:, :1])),
    )


def _of_seams(tracks: Tracks, windows: Windows | None, period: Period | None) -> SeamMeasures:
    """Folded on the windows, or else on the period; a period may start anywhere, so that joins are
    looked for in windows only."""
    if windows is not None:
        return SeamMeasures(
            seam_jerk_ratio(tracks.joints, windows.advance, windows.overlap),
            jerk_by_window_phase(tracks.joints, windows.advance),
            recurring_jerk(tracks.joints, windows.advance),
            windows.advance,
            period,
        )
    unknown = RecurringJerk(None, 0, math.nan)
    if period is None:
        return SeamMeasures(math.nan, np.empty(0), unknown)
    by_phase = part_jerk_by_phase(tracks, period.part, period.frames)
    return SeamMeasures(math.nan, by_phase, unknown, period.frames, period)


def _of_point(
    point: Float[np.ndarray, "T 3"], tracks: Tracks, chain: tuple[int, ...]
) -> PointMeasures:
    def mean(order: int) -> float:
        return float(mean_over_time(derivative_magnitudes(point, order)))

    arc_length, log_jerk = mean_over_movements(point)
    above_5hz, shares = math.nan, None
    spectrum = velocity_spectrum(np.diff(point, axis=0) * FPS)
    if spectrum is not None and spectrum.power.any():
        above_5hz = float(spectrum.share_above(HIGH_FREQUENCY_HZ))
        shares = Spectrum(spectrum.frequency_hz, spectrum.share())
    return PointMeasures(
        tip_jerk_m_s3=mean(3),
        tip_acceleration_m_s2=mean(2),
        tip_path_m_s=mean(1),
        tip_velocity_power_above_5hz=above_5hz,
        tip_spectrum=shares,
        tip_sparc=arc_length,
        tip_log_dimensionless_jerk=log_jerk,
        tip_jerk_attribution=attribute_jerk(point, tracks, chain),
    )


def _of_fingertips(tracks: Tracks) -> FingertipMeasures:
    return FingertipMeasures(
        *(mean_over_time(derivative_magnitudes(tracks.fingertips, order)) for order in (1, 2, 3))
    )


def _of_joint_positions(tracks: Tracks) -> PositionMeasures:
    found = [mean_over_time(derivative_magnitudes(tracks.joints, order)) for order in (1, 2, 3)]
    return PositionMeasures(*found, *map(mean_by_depth, found))


def _of_joint_rotations(tracks: Tracks) -> RotationMeasures:
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


def _of_posture(tracks: Tracks) -> PostureMeasures:
    feet = tracks.joints[:, list(FEET)]
    tilt = spine_tilt_deg(tracks.joints)
    low, high = np.percentile(
        height_above_ground(feet), (LOW_PERCENTILE, HIGH_PERCENTILE), axis=0
    ).tolist()
    contact, floating, sinking = foot_contact(feet)
    return PostureMeasures(
        foot_slide_m_s=foot_slide(feet),
        foot_height_m=Sides(*map(HeightRange, low, high)),
        spine_tilt_deg=Tilt(float(tilt.mean()), float(np.percentile(tilt, HIGH_PERCENTILE))),
        hand_speed_symmetry=hand_speed_symmetry(tracks.joints),
        root_drift_m=root_drift(tracks.joints[:, 0]),
        foot_contact_share=contact,
        foot_floating_share=floating,
        foot_sinking_share=sinking,
    )


def _of_joint_ranges(tracks: Tracks, skeleton: RestSkeleton) -> RangeMeasures:
    share = finger_is_outside(tracks.local_rot, skeleton).mean(axis=0)
    left, right = (elbow_backwards_share(tracks.local_rot, skeleton, s) for s in ("left", "right"))
    return RangeMeasures(
        finger_angle_outside_share=float(share.mean()),
        finger_angle_outside_by_joint=dict(zip(FINGER_JOINT_NAMES, share.tolist(), strict=True)),
        elbow_backwards_share=Sides(left, right),
    )
