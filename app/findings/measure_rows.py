"""Which measures the page's table shows, how they are read from the diagnostics, and whose value is
nearest to the reference's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from model.measures.results import Measures


def mean(values: np.ndarray) -> float:
    """Over all joints; NaN where one has a gap."""
    return sum(values.tolist()) / len(values)


@dataclass(frozen=True)
class Measure:
    """One row of the table."""

    group: str
    title: str
    unit: str
    read: Callable[[Measures], float | None]
    """None or NaN where there is no such number."""
    scale: float = 1.0
    """From the unit of the file to that of the table."""
    has_target: bool = True
    """Whether nearness to the reference says something; not for chance or for errors."""


MEASURES = (
    Measure("Followed point", "Speed", "m/s", lambda m: m.point.tip_path_m_s),
    Measure("Followed point", "Acceleration", "m/s²", lambda m: m.point.tip_acceleration_m_s2),
    Measure("Followed point", "Jerk", "m/s³", lambda m: m.point.tip_jerk_m_s3),
    Measure("Followed point", "Power above 5 Hz", "%",
            lambda m: m.point.tip_velocity_power_above_5hz, 100),
    Measure("Followed point", "SPARC", "", lambda m: m.point.tip_sparc),
    Measure("Followed point", "Log dimensionless jerk", "",
            lambda m: m.point.tip_log_dimensionless_jerk),
    Measure("All joints", "Mean jerk", "m/s³", lambda m: mean(m.positions.joint_jerk_m_s3)),
    Measure("All joints", "Rotation noise", "°",
            lambda m: mean(m.rotations.joint_rotation_noise_deg)),
    Measure("All joints", "Peak jerk at joins", "times elsewhere",
            lambda m: m.seams.seam_jerk_ratio),
    Measure("Feet", "Slide on the ground", "cm/s", lambda m: m.posture.foot_slide_m_s, 100),
    Measure("Feet", "Height, left, 95 %", "cm", lambda m: m.posture.foot_height_m.left.p95, 100),
    Measure("Feet", "Height, right, 95 %", "cm", lambda m: m.posture.foot_height_m.right.p95, 100),
    Measure("Posture", "Spine tilt, mean", "°", lambda m: m.posture.spine_tilt_deg.mean),
    Measure("Posture", "Spine tilt, 95 %", "°", lambda m: m.posture.spine_tilt_deg.p95),
    Measure("Posture", "Drift of the pelvis", "cm", lambda m: m.posture.root_drift_m, 100),
    Measure("Hands", "Moving alike", "correlation", lambda m: m.posture.hand_speed_symmetry),
    Measure("Hands", "Fingers beyond range", "%",
            lambda m: m.ranges.finger_angle_outside_share, 100),
    Measure("Hands", "Left fingers still", "%",
            lambda m: m.rotations.fingers_still_share.left, 100),
    Measure("Hands", "Right fingers still", "%",
            lambda m: m.rotations.fingers_still_share.right, 100),
    Measure("Error against the reference", "Pelvis", "cm",
            lambda m: m.errors and m.errors.root_error_m, 100, False),
    Measure("Error against the reference", "Joints about the pelvis", "cm",
            lambda m: m.errors and mean(m.errors.position_error_m), 100, False),
    Measure("Error against the reference", "Global rotation", "°",
            lambda m: m.errors and mean(m.errors.global_rotation_error_deg), 1, False),
    Measure("Error against the reference", "Local rotation", "°",
            lambda m: m.errors and mean(m.errors.local_rotation_error_deg), 1, False),
    Measure("Beat alignment", "BeatAlign", "0 to 1", lambda m: m.beats and m.beats.beat_align),
    Measure("Beat alignment", "BeatAlign by chance", "0 to 1",
            lambda m: m.beats and m.beats.beat_align_chance, 1, False),
    Measure("Beat alignment", "Beats of each joint", "1/s",
            lambda m: m.beats and m.beats.beats_per_joint_s),
    Measure("Diversity", "L1 diversity", "m", lambda m: m.diversity.l1_diversity_m),
)  # fmt: skip


def nearest(values: Mapping[str, float | None], target: float | None) -> tuple[str, ...]:
    """The names whose value is nearest to ``target``; several where some are equally near.

    None where there is no target, or where no value is nearer than another.
    """
    known = {name: value for name, value in values.items() if value is not None}
    if target is None:
        return ()
    distances = {name: abs(value - target) for name, value in known.items()}
    if len(set(distances.values())) < 2:
        return ()
    return tuple(name for name in distances if distances[name] == min(distances.values()))


def written(value: float | None) -> str:
    """Three significant digits, no exponent where one can do without."""
    if value is None:
        return "n/a"
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        digits = f"{value:.3g}"
        return f"{float(digits):,.0f}" if "e" in digits else digits
    return f"{value:.1e}"
