"""What is measured of one motion. Fields are called as the keys of ``diagnostics.json``, where
``docs/formats.md`` says what each is; what a clip is too short or too still for is NaN or None.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from jaxtyping import Float

from model.measures.attribution import JerkAttribution
from model.measures.joins.periods import Period
from model.measures.joins.seams import RecurringJerk
from model.measures.reference_error import ReferenceError

ByJoint = Float[np.ndarray, " 55"]
ByDepth = Float[np.ndarray, " 11"]
ByFingertip = Float[np.ndarray, " 10"]
BeatSpeeds = Literal["reference", "own", "emage"]
T = TypeVar("T")


@dataclass(frozen=True)
class Sides(Generic[T]):
    """One thing of the left and of the right side."""

    left: T
    right: T


@dataclass(frozen=True)
class Spectrum:
    """Bin by bin, summing to 1."""

    frequency_hz: Float[np.ndarray, " bins"]
    velocity_power: Float[np.ndarray, " bins"]


@dataclass(frozen=True)
class HeightRange:
    """5th and 95th percentile."""

    p5: float
    p95: float


@dataclass(frozen=True)
class Tilt:
    """Over all frames."""

    mean: float
    p95: float


@dataclass(frozen=True)
class PointMeasures:
    """Of the followed point."""

    tip_jerk_m_s3: float
    tip_acceleration_m_s2: float
    tip_path_m_s: float
    tip_velocity_power_above_5hz: float
    tip_spectrum: Spectrum | None
    tip_sparc: float
    tip_log_dimensionless_jerk: float
    tip_jerk_attribution: JerkAttribution


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


@dataclass(frozen=True)
class SeamMeasures:
    """Of the joins of windows, or of the period that was found where no windows are known."""

    seam_jerk_ratio: float
    jerk_by_window_phase_m_s3: Float[np.ndarray, " window_advance"]
    """Empty where there are neither windows nor a period."""
    recurring_jerk: RecurringJerk
    folded_on_frames: int | None = None
    """From one window, or period, to the next."""
    period: Period | None = None
    """Found in the raw motion, whether or not windows are known."""


@dataclass(frozen=True)
class PostureMeasures:
    """Of feet, spine, hands and place."""

    foot_slide_m_s: float
    foot_height_m: Sides[HeightRange]
    spine_tilt_deg: Tilt
    hand_speed_symmetry: float
    root_drift_m: float
    foot_contact_share: float
    foot_floating_share: float
    foot_sinking_share: float


@dataclass(frozen=True)
class RangeMeasures:
    """Of joints bent as no human joint is, as shares of all frames."""

    finger_angle_outside_share: float
    finger_angle_outside_by_joint: dict[str, float]
    elbow_backwards_share: Sides[float]


@dataclass(frozen=True)
class Diversity:
    """Of the poses of one motion."""

    l1_diversity_m: float


@dataclass(frozen=True)
class BeatMeasures:
    """BeatAlign in EMAGE's direction and its chance level, NaN where no onset counts; and what it
    rests on."""

    beat_align: float
    beat_align_chance: float
    beat_align_chance_highest: float
    """Of the shifts whose mean is the chance level."""
    beats_per_joint_s: float
    """Beats of motion per second, mean of the 13 joints."""
    beat_onsets: int
    """Onsets of the speech that count."""
    beat_speeds_of: BeatSpeeds
    """Whose mean speeds decide what is slow."""


@dataclass(frozen=True)
class Measures:
    """Everything of one motion; in files the fields of all groups stand side by side."""

    point: PointMeasures
    fingertips: FingertipMeasures
    positions: PositionMeasures
    rotations: RotationMeasures
    seams: SeamMeasures
    posture: PostureMeasures
    ranges: RangeMeasures
    diversity: Diversity
    errors: ReferenceError | None = None
    """None without a reference."""
    beats: BeatMeasures | None = None
    """None without speech."""

    def as_json(self) -> dict[str, Any]:
        """By the keys of ``diagnostics.json``."""
        groups = [vars(group) for group in vars(self).values() if group is not None]
        return {key: as_json(value) for group in groups for key, value in group.items()}


def as_json(value: Any) -> Any:
    """Plain lists and numbers. JSON knows no NaN: None says that there is no such number."""
    if is_dataclass(value):
        return as_json(vars(value))
    if isinstance(value, Mapping):
        return {key: as_json(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return as_json(value.tolist())
    if isinstance(value, list | tuple):
        return [as_json(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
