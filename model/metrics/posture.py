"""Metrics of posture: spine tilt, feet, symmetry of the hands, and root drift.

Positions are in metres, y up, 30 fps. A metric that a clip cannot have is NaN.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.metrics.smoothness import Sides, derivative_magnitudes
from model.motion.tracks import Tracks

GROUND_PERCENTILE = 5.0
CONTACT_HEIGHT_M = 0.05
FLOATING_M, SINKING_M = 0.08, 0.06
"""Height of the lower foot above and below its median (m) that counts as floating and sinking;
recorded clips: 0.041 up and 0.044 down at most."""
FEET = (JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"])
WRISTS = (JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"])
LOW_PERCENTILE, HIGH_PERCENTILE = 5, 95


def spine_tilt_deg(joints: Float[np.ndarray, "T 55 3"]) -> Float[np.ndarray, " T"]:
    """Compute the angle between vertical and the line from pelvis to neck (degrees)."""
    spine = joints[:, JOINT_INDEX["neck"]] - joints[:, JOINT_INDEX["pelvis"]]
    return np.degrees(np.arctan2(np.hypot(spine[:, 0], spine[:, 2]), spine[:, 1]))


def height_above_ground(feet: Float[np.ndarray, "T feet 3"]) -> Float[np.ndarray, "T feet"]:
    """Compute heights (m) above the ground: the 5th percentile of the lowest foot's height."""
    return feet[..., 1] - np.percentile(feet[..., 1].min(axis=1), GROUND_PERCENTILE)


def foot_slide(feet: Float[np.ndarray, "T feet 3"]) -> float:
    """Compute the mean horizontal speed of feet in ground contact (m/s).

    A foot is in contact while it stays below 5 cm above the ground over both frames of a step. NaN
    for one frame, or if no foot stays down.
    """
    feet = feet.astype(np.float64)
    if len(feet) < 2:
        return float("nan")
    height = height_above_ground(feet)
    is_down = (height[1:] < CONTACT_HEIGHT_M) & (height[:-1] < CONTACT_HEIGHT_M)
    speed = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1) * FPS
    return float(speed[is_down].mean()) if is_down.any() else float("nan")


class FootShares(NamedTuple):
    """Shares of frames, 0 to 1."""

    contact: float
    floating: float
    sinking: float


def foot_shares(feet: Float[np.ndarray, "T feet 3"]) -> FootShares:
    """Compute the shares of frames with ground contact, with floating and with sinking feet.

    Contact: a foot is within 5 cm of the ground. Floating, sinking: the lower foot is 8 cm or more
    above, 6 cm or more below its median height.
    """
    lower = feet[..., 1].min(axis=1)
    off = lower - np.median(lower)
    contact = (height_above_ground(feet).min(axis=1) < CONTACT_HEIGHT_M).mean()
    floating, sinking = (off > FLOATING_M).mean(), (off < -SINKING_M).mean()
    return FootShares(float(contact), float(floating), float(sinking))


def hand_speed_correlation(joints: Float[np.ndarray, "T 55 3"]) -> float:
    """Correlate the wrists' root-relative speeds (Pearson); NaN under 3 frames or if constant."""
    wrists = joints[:, list(WRISTS)] - joints[:, :1]
    left, right = derivative_magnitudes(wrists, 1).T
    if len(left) < 2 or np.ptp(left) < 1e-9 or np.ptp(right) < 1e-9:
        return float("nan")
    return float(np.corrcoef(left, right)[0, 1])


def root_drift(pelvis: Float[np.ndarray, "T 3"]) -> float:
    """Compute the horizontal drift of the pelvis, first to last second (m); NaN under 2 s."""
    if len(pelvis) < 2 * FPS:
        return float("nan")
    apart = pelvis[-FPS:].mean(axis=0) - pelvis[:FPS].mean(axis=0)
    return float(np.hypot(apart[0], apart[2]))


@dataclass(frozen=True)
class HeightRange:
    """5th and 95th percentile of a foot's height above the ground (m)."""

    p5: float
    p95: float


@dataclass(frozen=True)
class Tilt:
    """Mean and 95th percentile of the spine tilt over all frames (degrees)."""

    mean: float
    p95: float


@dataclass(frozen=True)
class PostureMetrics:
    """Metrics of feet, spine, hands and root."""

    foot_slide_m_s: float
    foot_height_m: Sides[HeightRange]
    spine_tilt_deg: Tilt
    hand_speed_correlation: float
    root_drift_m: float
    foot_contact_share: float
    foot_floating_share: float
    foot_sinking_share: float


def posture_metrics(tracks: Tracks) -> PostureMetrics:
    """Compute the metrics of feet, spine, hands and root."""
    feet = tracks.joints[:, list(FEET)]
    tilt = spine_tilt_deg(tracks.joints)
    low, high = np.percentile(
        height_above_ground(feet), (LOW_PERCENTILE, HIGH_PERCENTILE), axis=0
    ).tolist()
    contact, floating, sinking = foot_shares(feet)
    return PostureMetrics(
        foot_slide_m_s=foot_slide(feet),
        foot_height_m=Sides(*map(HeightRange, low, high)),
        spine_tilt_deg=Tilt(float(tilt.mean()), float(np.percentile(tilt, HIGH_PERCENTILE))),
        hand_speed_correlation=hand_speed_correlation(tracks.joints),
        root_drift_m=root_drift(tracks.joints[:, 0]),
        foot_contact_share=contact,
        foot_floating_share=floating,
        foot_sinking_share=sinking,
    )
