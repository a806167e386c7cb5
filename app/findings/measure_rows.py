"""Which measures the page's table shows, how they are read from the diagnostics, and whose value is
nearest to the reference's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

Values = Mapping[str, Any]
"""The measures of one motion, raw or filtered, as in ``diagnostics.json``."""


def at(*path: str) -> Callable[[Values], float | None]:
    """Reads the number that lies at a path of keys; None where there is none."""

    def read(values: Values) -> float | None:
        value: Any = values
        for key in path:
            value = value.get(key) if isinstance(value, Mapping) else None
        return value if _is_number(value) else None

    return read


def mean_of(key: str) -> Callable[[Values], float | None]:
    """Reads the mean of a list; None where it is missing or has a gap."""

    def read(values: Values) -> float | None:
        numbers = values.get(key)
        if not isinstance(numbers, list) or not numbers or not all(map(_is_number, numbers)):
            return None
        return sum(numbers) / len(numbers)

    return read


@dataclass(frozen=True)
class Measure:
    """One row of the table."""

    group: str
    title: str
    unit: str
    read: Callable[[Values], float | None]
    scale: float = 1.0
    """From the unit of the file to that of the table."""
    has_target: bool = True
    """Whether nearness to the reference says something; not for chance or for errors."""


MEASURES = (
    Measure("Followed point", "Speed", "m/s", at("tip_path_m_s")),
    Measure("Followed point", "Acceleration", "m/s²", at("tip_acceleration_m_s2")),
    Measure("Followed point", "Jerk", "m/s³", at("tip_jerk_m_s3")),
    Measure("Followed point", "Power above 5 Hz", "%", at("tip_velocity_power_above_5hz"), 100),
    Measure("Followed point", "SPARC", "", at("tip_sparc")),
    Measure("Followed point", "Log dimensionless jerk", "", at("tip_log_dimensionless_jerk")),
    Measure("All joints", "Mean jerk", "m/s³", mean_of("joint_jerk_m_s3")),
    Measure("All joints", "Rotation noise", "°", mean_of("joint_rotation_noise_deg")),
    Measure("All joints", "Peak jerk at joins", "times elsewhere", at("seam_jerk_ratio")),
    Measure("Feet", "Slide on the ground", "cm/s", at("foot_slide_m_s"), 100),
    Measure("Feet", "Height, left, 95 %", "cm", at("foot_height_m", "left", "p95"), 100),
    Measure("Feet", "Height, right, 95 %", "cm", at("foot_height_m", "right", "p95"), 100),
    Measure("Posture", "Spine tilt, mean", "°", at("spine_tilt_deg", "mean")),
    Measure("Posture", "Spine tilt, 95 %", "°", at("spine_tilt_deg", "p95")),
    Measure("Posture", "Drift of the pelvis", "cm", at("root_drift_m"), 100),
    Measure("Hands", "Moving alike", "correlation", at("hand_speed_symmetry")),
    Measure("Hands", "Fingers beyond range", "%", at("finger_angle_outside_share"), 100),
    Measure("Hands", "Left fingers still", "%", at("fingers_still_share", "left"), 100),
    Measure("Hands", "Right fingers still", "%", at("fingers_still_share", "right"), 100),
    Measure("Error against the reference", "Pelvis", "cm", at("root_error_m"), 100, False),
    Measure("Error against the reference", "Joints about the pelvis", "cm",
            mean_of("position_error_m"), 100, False),
    Measure("Error against the reference", "Global rotation", "°",
            mean_of("global_rotation_error_deg"), 1, False),
    Measure("Error against the reference", "Local rotation", "°",
            mean_of("local_rotation_error_deg"), 1, False),
    Measure("Beat alignment", "BeatAlign", "0 to 1", at("beat_align")),
    Measure("Beat alignment", "BeatAlign by chance", "0 to 1", at("beat_align_chance"), 1, False),
    Measure("Diversity", "L1 diversity", "m", at("l1_diversity_m")),
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


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
