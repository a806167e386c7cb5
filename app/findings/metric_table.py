"""Measures of the page's table, and which of their values are nearest to the reference."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, TypeVar

from conventions.names import FilterVersion
from model.metrics.protocols.table import GENEA_PIECE_FRAMES, PROTOCOLS, WORKBENCH

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

    from model.metrics.results import MotionMetrics


def mean_over_joints(values: Float[np.ndarray, " N"]) -> float:
    """Compute the mean over all joints; NaN if one has a gap."""
    return sum(values.tolist()) / len(values)


@dataclass(frozen=True)
class Metric:
    """One row of the page's table of measures."""

    key: str
    """Id of the metric in files, with the unit of its values."""
    group: str
    title: str
    unit: str
    description: str
    """Explanation for a reader who does not know the measure."""
    read_value: Callable[[MotionMetrics], float | None]
    """Function that reads the value; None or NaN where there is no such number."""
    scale: float = 1.0
    """Factor from the unit of the file to that of the table."""
    is_compared_with_reference: bool = True
    """True if nearness to the reference is meaningful; false for chance levels and errors."""
    is_primary: bool = False
    """True if the row is among the few that the table shows before it is expanded."""
    required_parts: tuple[str, ...] = ()
    """Parts (`model.formats.reading.Part`) that the measure requires; it is left out for a motion
    that lacks one. ``detail`` is missing in frames that were interpolated.
    """
    parts_that_must_match: tuple[str, ...] = ()
    """Parts that change the measure: values with and without them are not comparable."""
    partner_key: str = ""
    """Key of a measure that must be shown with this one: both are shown, or neither."""

    @property
    def is_reference_error(self) -> bool:
        """True for a distance to the reference."""
        return self.group == _ERROR

    @property
    def full_title(self) -> str:
        """Title with the group, for tables without group headings."""
        return f"{self.group}: {self.title}"


_POINT, _JOINTS, _FEET, _POSTURE = "Tracked point", "All joints", "Feet", "Posture"
_HANDS, _ERROR = "Hands", "Error relative to the reference"
_BEATS, _STEP, _DIVERSITY = "Beat alignment", "Synchrony with the speech", "Diversity"
_BEATS_KEY, _CHANCE_KEY = "beat_align", "beat_align_chance"
METRICS = (
    Metric("tracked_point_speed_m_s", _POINT, "Speed", "m/s",
            "Mean speed. Compare jerk only between motions of similar speed: a body that hardly "
            "moves is always smooth.",
            lambda m: m.point.tip_speed_m_s, is_primary=True),
    Metric("tracked_point_acceleration_m_s2", _POINT, "Acceleration", "m/s²",
            "Mean magnitude of the rate of change of velocity.",
            lambda m: m.point.tip_acceleration_m_s2, required_parts=("detail",)),
    Metric("tracked_point_jerk_m_s3", _POINT, "Jerk", "m/s³",
            "Mean magnitude of the rate of change of acceleration.",
            lambda m: m.point.tip_jerk_m_s3, is_primary=True, required_parts=("detail",),
            parts_that_must_match=("place",)),
    Metric("tracked_point_power_above_5hz_percent", _POINT, "Power above 5 Hz", "%",
            "Share of velocity power above 5 Hz. Power there is mostly jitter rather than gesture.",
            lambda m: m.point.tip_velocity_power_share_above_5hz, 100, required_parts=("detail",)),
    Metric("tracked_point_sparc", _POINT, "SPARC", "",
            "Spectral arc length of the speed. Closer to 0 is smoother.",
            lambda m: m.point.tip_sparc, required_parts=("detail",)),
    Metric("tracked_point_log_dimensionless_jerk", _POINT, "Log dimensionless jerk", "",
            "Jerk normalised by peak speed and duration, as a logarithm. Closer to 0 is smoother.",
            lambda m: m.point.tip_log_dimensionless_jerk, required_parts=("detail",),
            parts_that_must_match=("place",)),
    Metric("joint_jerk_m_s3", _JOINTS, "Mean jerk", "m/s³",
            "Mean jerk of the positions of all 55 joints.",
            lambda m: mean_over_joints(m.positions.joint_jerk_m_s3), is_primary=True,
            required_parts=("detail",), parts_that_must_match=("place",)),
    Metric("joint_rotation_noise_deg", _JOINTS, "Rotation noise", "°",
            "Estimated white noise in the joint rotations. For comparison: below 0.3° in two "
            "recorded clips.",
            lambda m: mean_over_joints(m.rotations.joint_rotation_noise_deg),
            required_parts=("detail",)),
    Metric("seam_jerk_ratio", _JOINTS, "Seam jerk ratio", "",
            "Peak jerk at window seams relative to the rest of the clip. 1 means that seams do not "
            "stand out.",
            lambda m: m.seams.seam_jerk_ratio, is_primary=True, required_parts=("detail",)),
    Metric("foot_sliding_cm_s", _FEET, "Foot sliding", "cm/s",
            "Mean horizontal speed of a foot while it is on the ground.",
            lambda m: m.posture.foot_slide_m_s, 100, is_primary=True,
            required_parts=("place", "legs")),
    Metric("left_foot_height_p95_cm", _FEET, "Height, left, 95th percentile", "cm",
            "Height above the ground that the foot does not exceed in 95 % of the frames.",
            lambda m: m.posture.foot_height_m.left.p95, 100, required_parts=("place", "legs")),
    Metric("right_foot_height_p95_cm", _FEET, "Height, right, 95th percentile", "cm",
            "Height above the ground that the foot does not exceed in 95 % of the frames.",
            lambda m: m.posture.foot_height_m.right.p95, 100, required_parts=("place", "legs")),
    Metric("spine_tilt_mean_deg", _POSTURE, "Spine tilt, mean", "°",
            "Mean angle between the vertical and the line from pelvis to neck.",
            lambda m: m.posture.spine_tilt_deg.mean),
    Metric("spine_tilt_p95_deg", _POSTURE, "Spine tilt, 95th percentile", "°",
            "Spine tilt that is not exceeded in 95 % of the frames.",
            lambda m: m.posture.spine_tilt_deg.p95),
    Metric("pelvis_drift_cm", _POSTURE, "Pelvis drift", "cm",
            "Distance between the mean pelvis positions in the first and in the last second.",
            lambda m: m.posture.root_drift_m, 100, required_parts=("place",)),
    Metric("hand_speed_correlation", _HANDS, "Correlation of hand speeds", "r",
            "Correlation between the speeds of the two wrists. 1 means that both always speed up "
            "and slow down together.",
            lambda m: m.posture.hand_speed_correlation),
    Metric("finger_limit_violations_percent", _HANDS, "Finger joint-limit violations", "%",
            "Share of finger-joint angles, over all frames, that are beyond the human range.",
            lambda m: m.joint_limits.finger_angle_outside_share, 100,
            required_parts=("finger_angles", "hands")),
    Metric("left_fingers_still_percent", _HANDS, "Left fingers still", "%",
            "Share of frames in which all finger joints of the hand rotate slower than 1°/s.",
            lambda m: m.rotations.fingers_still_share.left, 100, required_parts=("hands",)),
    Metric("right_fingers_still_percent", _HANDS, "Right fingers still", "%",
            "Share of frames in which all finger joints of the hand rotate slower than 1°/s.",
            lambda m: m.rotations.fingers_still_share.right, 100, required_parts=("hands",)),
    Metric("pelvis_error_cm", _ERROR, "Pelvis position", "cm",
            "Mean distance between the pelvis and that of the reference.",
            lambda m: m.errors and m.errors.root_error_m, 100, False),
    Metric("joint_position_error_cm", _ERROR, "Joint position, pelvis-aligned", "cm",
            "Mean distance between the joints and those of the reference, with the pelvis aligned.",
            lambda m: m.errors and mean_over_joints(m.errors.position_error_m), 100, False),
    Metric("global_rotation_error_deg", _ERROR, "Global rotation", "°",
            "Mean angle between the joint rotations of the motion and of the reference, in world "
            "coordinates.",
            lambda m: m.errors and mean_over_joints(m.errors.global_rotation_error_deg), 1, False),
    Metric("local_rotation_error_deg", _ERROR, "Local rotation", "°",
            "Mean angle between the joint rotations of the motion and of the reference, relative "
            "to the parent joint.",
            lambda m: m.errors and mean_over_joints(m.errors.local_rotation_error_deg), 1, False),
    Metric(_BEATS_KEY, _BEATS, "BeatAlign", "0 to 1",
            "How close speech onsets are to the nearest motion beats. Compare it with its chance "
            "level.",
            lambda m: m.beats and m.beats.beat_align, is_primary=True, partner_key=_CHANCE_KEY),
    Metric(_CHANCE_KEY, _BEATS, "BeatAlign, chance level", "0 to 1",
            "Mean BeatAlign of the same motion over many time shifts of the speech onsets.",
            lambda m: m.beats and m.beats.beat_align_chance, 1, False, is_primary=True,
            partner_key=_BEATS_KEY),
    Metric("beats_per_joint_s", _BEATS, "Motion beats per joint", "1/s",
            "How many times per second a joint's speed has a local minimum, mean over joints. "
            "These motion beats are not beat gestures.",
            lambda m: m.beats and m.beats.beats_per_joint_s),
    Metric("lag_s", _STEP, "Lag", "s",
            "Delay of the face behind the speech, or of the body if the face does not follow the "
            "speech. Empty if neither does.",
            lambda m: m.lag and m.lag.lag_s, 1, False, is_primary=True),
    Metric("lag_drift_s", _STEP, "Lag drift", "s",
            "Change of the lag from the start to the end of the clip.",
            lambda m: m.lag and m.lag.lag_drift_s, 1, False),
    Metric("l1_diversity_m", _DIVERSITY, "L1 diversity", "m",
            "L1 distance of the pelvis-aligned joint positions from the clip's mean pose, summed "
            "over joints and coordinates, mean over frames.",
            lambda m: m.diversity.l1_diversity_m),
)  # fmt: skip


JERK, SPEED = "tracked_point_jerk_m_s3", "tracked_point_speed_m_s"
POWER_ABOVE_5_HZ, SEAMS = "tracked_point_power_above_5hz_percent", "seam_jerk_ratio"
FGD, FGD_EMAGE = "fgd", "fgd_emage"
"""Keys of the distances of whole sets to the recorded one, by our encoder and by EMAGE's."""
FGD_GENEA = {length: f"fgd_genea_{length}" for length in GENEA_PIECE_FRAMES}
"""Keys of the FGD by GENEA's encoders, by window length (frames)."""
FGD_ENCODERS = {FGD: "this project's encoder", FGD_EMAGE: "EMAGE's encoder"} | {
    key: f"GENEA's encoder for {length}-frame windows" for length, key in FGD_GENEA.items()
}
"""Encoder of each FGD."""
TITLES = {row.key: row.full_title for row in METRICS} | {
    key: f"Distribution: FGD to the recorded set ({encoder})"
    for key, encoder in FGD_ENCODERS.items()
}
_ABOUT = {row.key: row.description for row in METRICS}


def metric_definition(key: str, protocol: str) -> str:
    """Return what a metric is, and the rule of its protocol; empty if both are unknown."""
    is_published = protocol != WORKBENCH and protocol in PROTOCOLS
    return f"{_ABOUT.get(key, '')} {PROTOCOLS[protocol].rule if is_published else ''}".strip()


KEYS_OF_OLD_TITLES = {
    "Followed point: Speed": "tracked_point_speed_m_s",
    "Followed point: Acceleration": "tracked_point_acceleration_m_s2",
    "Followed point: Jerk": "tracked_point_jerk_m_s3",
    "Followed point: Power above 5 Hz": "tracked_point_power_above_5hz_percent",
    "Followed point: SPARC": "tracked_point_sparc",
    "Followed point: Log dimensionless jerk": "tracked_point_log_dimensionless_jerk",
    "All joints: Mean jerk": "joint_jerk_m_s3",
    "All joints: Rotation noise": "joint_rotation_noise_deg",
    "All joints: Peak jerk at joins": "seam_jerk_ratio",
    "Feet: Slide on the ground": "foot_sliding_cm_s",
    "Feet: Height, left, 95 %": "left_foot_height_p95_cm",
    "Feet: Height, right, 95 %": "right_foot_height_p95_cm",
    "Posture: Spine tilt, mean": "spine_tilt_mean_deg",
    "Posture: Spine tilt, 95 %": "spine_tilt_p95_deg",
    "Posture: Drift of the pelvis": "pelvis_drift_cm",
    "Hands: Moving alike": "hand_speed_correlation",
    "Hands: Fingers beyond range": "finger_limit_violations_percent",
    "Hands: Left fingers still": "left_fingers_still_percent",
    "Hands: Right fingers still": "right_fingers_still_percent",
    "Error against the reference: Pelvis": "pelvis_error_cm",
    "Error against the reference: Joints about the pelvis": "joint_position_error_cm",
    "Error against the reference: Global rotation": "global_rotation_error_deg",
    "Error against the reference: Local rotation": "local_rotation_error_deg",
    "Beat alignment: BeatAlign": "beat_align",
    "Beat alignment: BeatAlign by chance": "beat_align_chance",
    "Beat alignment: Beats of each joint": "beats_per_joint_s",
    "In step with the speech: Lag": "lag_s",
    "In step with the speech: Drift": "lag_drift_s",
    "Diversity: L1 diversity": "l1_diversity_m",
}
"""Keys of the metrics by the titles that were keys in ``run.json`` of formats 1 and 2."""
Numbers = Mapping[FilterVersion, Mapping[str, float]]
"""Values of one motion by version (filter) and by key of the measure, as in ``run.json``."""


def parts_others_have(missing_parts: Mapping[str, Collection[str]]) -> dict[str, frozenset[str]]:
    """Return by motion the parts (`model.formats.reading.Part`) that it lacks and another has."""
    parts = list(map(frozenset, missing_parts.values()))
    everywhere = frozenset.intersection(*parts) if parts else frozenset()
    return {name: frozenset(own) - everywhere for name, own in missing_parts.items()}


def metric_values(
    metrics: MotionMetrics, missing_parts: Collection[str] = (), incomparable: Collection[str] = ()
) -> dict[str, float]:
    """Return values by the keys of `METRICS`, in their units, where measured and comparable.

    ``incomparable`` are parts that this motion lacks and others have (`parts_others_have`).
    """
    read = {
        each.key: (each.read_value(metrics), each.scale)
        for each in METRICS
        if not set(each.required_parts) & {*missing_parts, *incomparable}
        and not set(each.parts_that_must_match) & set(incomparable)
    }
    return drop_unpaired(
        {
            key: scale * float(value)
            for key, (value, scale) in read.items()
            if value is not None and isfinite(value)
        }
    )


PARTNERS = {row.key: row.partner_key for row in METRICS if row.partner_key}
T = TypeVar("T")


def old_titles_to_keys(values_by_title: Mapping[str, T]) -> dict[str, T]:
    """Return the values of an earlier format, which had titles as keys, by the keys of metrics."""
    return {KEYS_OF_OLD_TITLES.get(title, title): value for title, value in values_by_title.items()}


def drop_unpaired(values: Mapping[str, T]) -> dict[str, T]:
    """Leave out measures without their partner, such as BeatAlign without its chance level."""
    return {key: of for key, of in values.items() if PARTNERS.get(key, key) in values}


def nearest_names(values: Mapping[str, float | None], target: float | None) -> tuple[str, ...]:
    """Return the names with values nearest to ``target``; empty without target or difference."""
    finite = {name: value for name, value in values.items() if value is not None}
    if target is None or len({format_three_digits(value) for value in finite.values()}) < 2:
        return ()
    distances = {name: abs(value - target) for name, value in finite.items()}
    best = {name for name in distances if distances[name] == min(distances.values())}
    shown = {format_three_digits(finite[name]) for name in best}
    near = tuple(
        name
        for name, value in finite.items()
        if format_three_digits(value) in shown or name in best
    )
    return near if len(near) < len(finite) else ()


def format_three_digits(value: float | None) -> str:
    """Format a number with three significant digits, with an exponent only if necessary."""
    if value is None:
        return "n/a"
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        digits = f"{value:.3g}"
        return f"{float(digits):,.0f}" if "e" in digits else digits
    return f"{value:.1e}"


def format_mean_with_interval(
    mean: float, low: float, high: float, write: Callable[[float], str] = format_three_digits
) -> str:
    """Format a mean with its interval, or the mean alone where the interval is a point."""
    return write(mean) if low == high else f"{write(mean)} [{write(low)}, {write(high)}]"


def format_difference(value: float | None) -> str:
    """Format a difference with its sign, and three significant digits."""
    if value is None:
        return "n/a"
    sign = "+" if value > 0 else "\N{MINUS SIGN}" if value < 0 else ""
    return sign + format_three_digits(abs(value))
