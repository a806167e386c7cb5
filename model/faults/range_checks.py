"""Detectors of too much or too little jerk, high frequencies, amplitude and speed.

With a reference, a level is compared with the reference's and reported if it differs more than
clips of recorded people, or cuts of one clip, do. Without one it is compared with the range of the
available recorded and procedural clips: two recorded clips of one speaker and 90 procedural ones,
whole (`LONG_FRAMES` and more) or in stretches of 10 s; the jerk of shorter clips with the recorded
ones in stretches of 2 s. That range is narrow, and the sentence names its source.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from conventions.joints import UPPER_BODY
from conventions.rates import FPS
from model.faults.analysis import AnalysedMotion, Finding, format_time, middle_of_worst_second
from model.metrics.posture import WRISTS
from model.metrics.smoothness import HIGH_FREQUENCY_HZ, derivative_magnitudes, velocity_spectrum

BRIEF_FRAMES, LEAST_FRAMES = 2 * FPS, 5 * FPS
"""Lengths between which only jerk is checked: a tremor shows in it at once."""
LONG_FRAMES = 30 * FPS
"""Length from which a clip is compared with whole clips."""
LONG, SHORT, BRIEF = "of 30 s and more", "of 5 to 30 s", "of 2 to 5 s"


@dataclass(frozen=True)
class NaturalRange:
    """Range of a level in clips of people of one length."""

    lowest: float
    highest: float
    max_ratio_between_clips: float
    """Largest ratio of this level between two clips."""
    low_limit: float
    high_limit: float
    """Limits of the level: the range with room around it."""
    clip_lengths: str
    """Lengths of the clips, in words."""


@dataclass(frozen=True)
class RangeCheck:
    """A level of motion with its detector."""

    kind: str
    title: str
    display_unit: str
    measure: Callable[[AnalysedMotion], float]
    long_clips: NaturalRange
    short_clips: NaturalRange
    low_message: str
    high_message: str
    very_short_clips: NaturalRange | None = None
    """Range for clips shorter than `LEAST_FRAMES`; None if they are not checked."""
    display_scale: float = 1.0
    """Factor from the unit of the metric to the displayed one."""

    def detect(self, analysed: AnalysedMotion) -> Iterator[Finding]:
        """Report the level if it is outside the range of people."""
        frames, reference = analysed.num_frames, analysed.reference
        people = self.long_clips if frames >= LONG_FRAMES else self.short_clips
        if frames < LEAST_FRAMES:
            people = self.very_short_clips if frames >= BRIEF_FRAMES else None
        if people is None or not np.isfinite(value := self.measure(analysed)):
            return
        if reference is None:
            is_low, max_ratio = value < people.low_limit, people.highest / people.lowest
            limit_ratio = (
                people.low_limit / max(value, 1e-9) if is_low else value / people.high_limit
            )
            lowest, highest = (
                self._format_value(each, False) for each in (people.lowest, people.highest)
            )
            clips = f"recorded and procedurally animated clips {people.clip_lengths}"
            usual = f"{clips}: {lowest} to {highest}"
            beside = ""
            numbers: dict[str, Any] = {
                "people": [self.display_scale * each for each in (people.lowest, people.highest)]
            }
        elif (recorded := self.measure(reference)) > 0.0:
            ratio = value / recorded
            is_low, max_ratio = ratio < 1.0, people.max_ratio_between_clips
            limit_ratio = max(ratio, 1 / max(ratio, 1e-9)) / people.max_ratio_between_clips
            beside = f", {_times(ratio)} the reference's {self._format_value(recorded, False)}"
            usual = (
                f"recorded clips differ by a factor of at most {people.max_ratio_between_clips:g}"
            )
            numbers = {
                "reference": self.display_scale * recorded,
                "ratio": ratio,
                "people": people.max_ratio_between_clips,
            }
        else:
            return
        if limit_ratio <= 1.0:
            return
        worst = _worst(self, analysed, is_low)
        where = f", worst at {format_time(worst)}" if worst is not None and not is_low else ""
        means = self.low_message if is_low else self.high_message
        yield Finding(
            f"{means}{where}: {self.title} {self._format_value(value)}{beside}.",
            {"unit": self.display_unit, "value": self.display_scale * value, **numbers},
            usual,
            limit_ratio=limit_ratio,
            max_ratio_between_clips=max_ratio,
            worst_frame=worst,
            frame_ranges=() if worst is None else ((max(0, worst - 15), worst + 15),),
        )

    def _format_value(self, value: float, has_unit: bool = True) -> str:
        text = f"{self.display_scale * value:.0f}"
        if self.display_scale * value < 100:
            text = np.format_float_positional(float(f"{self.display_scale * value:.2g}"), trim="-")
        return f"{text} {self.display_unit}".replace(" °", "°") if has_unit else text


def _times(ratio: float) -> str:
    return f"{ratio:.{0 if ratio >= 10 else 1}f} times" if ratio >= 0.1 else f"{ratio:.2g} times"


def _worst(level: RangeCheck, analysed: AnalysedMotion, is_low: bool) -> int | None:
    """Return the middle of the second with most jerk of the hands, or least or most turning."""
    if level.kind in ("jerk", "high_frequency"):
        track = derivative_magnitudes(analysed.tracks.fingertips, 3).mean(axis=1)
    else:
        track = analysed.angular_speed_deg_s[:, list(UPPER_BODY)].mean(axis=1)
    return middle_of_worst_second(track, is_lowest=is_low)


def mean_fingertip_jerk_m_s3(analysed: AnalysedMotion) -> float:
    """Return the mean jerk of the ten rigid fingertips (m/s^3)."""
    return float(analysed.metrics.fingertips.fingertips_jerk_m_s3.mean())


def wrist_high_frequency_share(analysed: AnalysedMotion) -> float:
    """Compute the share of the power of pelvis-aligned wrist velocities above 5 Hz."""
    wrists = analysed.tracks.joints[:, list(WRISTS)] - analysed.tracks.joints[:, :1]
    spectrum = velocity_spectrum(np.diff(wrists, axis=0) * FPS)
    if spectrum is None or not spectrum.velocity_power.any():
        return float("nan")
    return float(spectrum.power_above(HIGH_FREQUENCY_HZ).sum() / spectrum.velocity_power.sum())


def upper_body_angle_std_deg(analysed: AnalysedMotion) -> float:
    """Compute the root mean square distance of upper body angles from their mean (degrees)."""
    angles = analysed.motion.poses.reshape(-1, 55, 3)[:, list(UPPER_BODY)].astype(np.float64)
    off = angles - angles.mean(axis=0)
    return float(np.degrees(np.sqrt((off**2).sum(axis=-1).mean())))


def upper_body_angular_speed_deg_s(analysed: AnalysedMotion) -> float:
    """Return the mean angular speed of the upper body's local rotations (degrees/s)."""
    return float(analysed.metrics.rotations.joint_angular_speed_deg_s[list(UPPER_BODY)].mean())


JERK = RangeCheck(
    "jerk",
    "mean jerk of all ten fingertips",
    "m/s³",
    mean_fingertip_jerk_m_s3,
    long_clips=NaturalRange(65.0, 135.0, 2.0, 55.0, 175.0, LONG),
    short_clips=NaturalRange(43.0, 202.0, 2.4, 32.0, 235.0, SHORT),
    low_message="Hands smoother than in the recorded clips, as if low-pass filtered",
    high_message="Jittery hands",
    very_short_clips=NaturalRange(49.0, 241.0, 5.0, 0.0, 310.0, BRIEF),
)
HIGH_FREQUENCY = RangeCheck(
    "high_frequency",
    "share of the wrists' velocity power above 5 Hz",
    "%",
    wrist_high_frequency_share,
    long_clips=NaturalRange(0.0013, 0.011, 7.0, 0.0008, 0.015, LONG),
    short_clips=NaturalRange(0.0005, 0.025, 14.0, 0.00025, 0.035, SHORT),
    low_message="Hands smoother than in the recorded clips, as if low-pass filtered",
    high_message="High-frequency jitter on top of the movement",
    display_scale=100.0,
)
AMPLITUDE = RangeCheck(
    "amplitude",
    "RMS deviation of the upper body's joint angles from their mean",
    "°",
    upper_body_angle_std_deg,
    long_clips=NaturalRange(13.0, 20.0, 1.7, 10.5, 26.0, LONG),
    short_clips=NaturalRange(8.9, 22.0, 2.1, 7.0, 29.0, SHORT),
    low_message="Little variation of posture",
    high_message="Large variation of posture",
)
SPEED = RangeCheck(
    "speed",
    "mean angular speed of the upper body's joints",
    "°/s",
    upper_body_angular_speed_deg_s,
    long_clips=NaturalRange(19.0, 37.0, 1.9, 15.0, 46.0, LONG),
    short_clips=NaturalRange(16.0, 48.0, 1.9, 12.5, 58.0, SHORT),
    low_message="Little movement",
    high_message="Continuously fast movement",
)
