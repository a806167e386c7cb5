"""Input of the fault detectors, and their findings with sentence, numbers, severity and place."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from conventions.joints import FACE, HANDS, LOWER_BODY, UPPER_BODY
from conventions.rates import FPS
from model.metrics.posture import FEET
from model.metrics.results import MotionMetrics, as_json
from model.metrics.smoothness import angular_velocity
from model.motion.motion import Motion
from model.motion.runs import true_runs
from model.motion.tracks import Tracks

BODY = (*LOWER_BODY, *UPPER_BODY, *HANDS)
"""Indices of all joints but the face's."""
UPPER_AND_HANDS = (*UPPER_BODY, *HANDS)
assert not set(BODY) & set(FACE)


@dataclass(frozen=True, eq=False)
class AnalysedMotion:
    """Input of the detectors: one unfiltered motion with its metrics."""

    motion: Motion
    tracks: Tracks
    metrics: MotionMetrics
    point: str
    """Name of the tracked point, which the ``tip_`` metrics follow."""
    reference: AnalysedMotion | None = None
    """Recorded motion of the same speech, with as many frames; None without one."""

    @property
    def num_frames(self) -> int:
        return self.motion.num_frames

    @cached_property
    def angular_velocity_rad_s(self) -> Float[np.ndarray, "T1 55 3"]:
        """Angular velocity (rad/s) of each joint against its parent, frame to frame."""
        return angular_velocity(self.tracks.R_parent_joint)

    @cached_property
    def angular_speed_deg_s(self) -> Float[np.ndarray, "T1 55"]:
        """Angular speed of each joint against its parent (degrees/s)."""
        return np.degrees(np.linalg.norm(self.angular_velocity_rad_s, axis=-1))

    @cached_property
    def lower_foot_height_m(self) -> Float[np.ndarray, " T"]:
        """Height of the lower foot joint in world coordinates (m)."""
        return self.tracks.joints[:, list(FEET), 1].min(axis=1)

    @cached_property
    def median_lower_foot_height_m(self) -> float:
        """Median height of the lower foot (m), robust to frames with an impossible foot."""
        return float(np.median(self.lower_foot_height_m))


MAX_RANGES = 20
IMPOSSIBLE, VISIBLE, MEASURABLE = 3, 2, 1
"""Severities: no person moves like this; visible in positions; visible only in the angles between
neighbouring bones or in numbers, which counts half."""


@dataclass(frozen=True)
class Finding:
    """A fault in one motion."""

    message: str
    """One or two sentences for the user."""
    numbers: dict[str, Any]
    """Values behind the sentence, by name."""
    normal_range: str = ""
    """Normal range, appended in brackets, and only once for several motions."""
    limit_ratio: float = 1.0
    """Ratio of the value to its limit; 1 if there is no metric."""
    max_ratio_between_clips: float = 4.0
    """Largest ratio of this metric between two clips of people."""
    worst_frame: int | None = None
    """Frame at which the fault is worst; None if it is the same everywhere."""
    frame_ranges: tuple[tuple[int, int], ...] = ()
    """First and last frame of up to `MAX_RANGES` places of the fault, the longest first; empty
    if it is everywhere."""
    severity: int = VISIBLE
    kind: str = ""
    """Kind of fault, set by the table like the severity (`table.FAULTS`)."""

    @property
    def sentence(self) -> str:
        return (
            f"{self.message.removesuffix('.')} ({self.normal_range})."
            if self.normal_range
            else self.message
        )

    @property
    def worst_time_s(self) -> float | None:
        """Time of the worst frame from the start of the clip (s)."""
        return None if self.worst_frame is None else self.worst_frame / FPS

    @property
    def deviation(self) -> float:
        """Distance from what people do, in steps by which people differ."""
        steps = np.log(max(self.limit_ratio, 1.0)) / np.log(self.max_ratio_between_clips)
        return float(steps) * (0.5 if self.severity == MEASURABLE else 1.0)

    def as_json(self) -> dict[str, Any]:
        return {
            "kind": self.kind,
            **as_json(self.numbers),
            "severity": self.severity,
            "limit_ratio": as_json(float(self.limit_ratio)),
            "worst_frame": self.worst_frame,
            "worst_time_s": as_json(self.worst_time_s),
            "frames": [list(stretch) for stretch in self.frame_ranges],
            "sentence": self.sentence,
        }


def most_serious_first(findings: Iterable[Finding]) -> list[Finding]:
    """Sort findings: first impossible ones, then by their deviation from what people do."""
    return sorted(findings, key=_order)


def _order(finding: Finding) -> tuple[bool, float]:
    return finding.severity != IMPOSSIBLE, -finding.deviation


def rank_findings(findings: Mapping[str, Sequence[Finding]]) -> list[tuple[str, Finding]]:
    """Rank findings with the names of their motions: the most serious of each motion first.

    Motions with the worst findings in sum come first; then all other findings, by severity.
    """

    def badness(findings: Sequence[Finding]) -> tuple[int, float]:
        return sum(each.severity == IMPOSSIBLE for each in findings), sum(
            (each.deviation for each in findings), 0.0
        )

    order = sorted(findings, key=lambda name: badness(findings[name]), reverse=True)
    ordered = [(name, most_serious_first(findings[name])) for name in order]
    first = [(name, finding) for name, listed in ordered for finding in listed[:1]]
    others = [(name, finding) for name, listed in ordered for finding in listed[1:]]
    return first + sorted(others, key=lambda other: _order(other[1]))


def format_time(frame: int) -> str:
    """Format a frame's time in the clip as a player does: 1:05.3."""
    tenths = round(10 * frame / FPS)
    return f"{tenths // 600}:{tenths % 600 / 10:04.1f}"


def longest_true_ranges(mask: Bool[np.ndarray, " T"]) -> tuple[tuple[int, int], ...]:
    """Return first and last frame of the longest `MAX_RANGES` runs of true, longest first."""
    runs = sorted(true_runs(mask), key=lambda run: run[0] - run[1])
    return tuple((start, end - 1) for start, end in runs[:MAX_RANGES])


def middle_of_worst_second(values: Float[np.ndarray, " N"], is_lowest: bool = False) -> int | None:
    """Return the middle frame of the second with the highest, or the lowest, mean."""
    if len(values) < FPS:
        return None
    means = np.convolve(values, np.ones(FPS) / FPS, "valid")
    return int(means.argmin() if is_lowest else means.argmax()) + FPS // 2
