"""Comparison of numbers of several systems and their samples, and its wording."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import floor, log, log10

from conventions.joints import FINGERTIP_VERTICES
from conventions.names import REFERENCE_NAME, SampleName, short_names

SIMILAR_RATIO = 1 / 0.95
"""Largest ratio that counts as equal: two numbers are alike if one is at most 5 % less."""

Samples = dict[int, float]
"""Value by number of the sample, or of the clip, from 1."""
Table = Mapping[str, Mapping[str, Samples]]
"""Values by key of the measure, then by system or reference."""


@dataclass(frozen=True)
class Ratio:
    """Ratio of two systems' means, with a 95 % interval where they share several samples."""

    value: float
    num_pairs: int = 1
    low: float | None = None
    high: float | None = None

    @property
    def is_similar(self) -> bool:
        return abs(log(self.value)) < log(SIMILAR_RATIO)

    @property
    def interval_includes_one(self) -> bool:
        """True if the interval contains 1: no significant difference. False without an interval."""
        return self.low is not None and self.high is not None and self.low <= 1.0 <= self.high


def sample_names_by_system(names: Iterable[str]) -> dict[str, dict[int, str]]:
    """Return sample names by system and number: ``a`` and ``a.s2`` are samples 1 and 2 of ``a``."""
    names = list(names)
    systems: dict[str, dict[int, str]] = {}
    for name in names:
        sample = SampleName.parse(name)
        if sample.system not in names:
            sample = SampleName(name)
        systems.setdefault(sample.system, {})[sample.number] = name
    return systems


def values_by_metric(clips: Iterable[Mapping[str, Mapping[str, float]]]) -> Table:
    """Return values by metric, system and number: of one clip each sample, else each clip's mean.

    ``clips`` has values by motion, then by key of the measure, for each clip.
    """
    clips = list(clips)
    table: dict[str, dict[str, Samples]] = {}
    for number, clip in enumerate(clips, 1):
        for system, samples in sample_names_by_system(clip).items():
            for key in dict.fromkeys(key for name in samples.values() for key in clip[name]):
                of = {n: clip[name][key] for n, name in samples.items() if key in clip[name]}
                of_clip = of if len(clips) == 1 else {number: mean(of)}
                table.setdefault(key, {}).setdefault(system, {}).update(of_clip)
    return table


def mean(samples: Samples) -> float:
    return sum(samples.values()) / len(samples)


def ratio_of_means(numerator: Samples, denominator: Samples) -> Ratio | None:
    """Compute the ratio of two means, paired by sample number; None if a value is not positive."""
    if min([*numerator.values(), *denominator.values()]) <= 0.0:
        return None
    shared = sorted(numerator.keys() & denominator.keys())
    if len(shared) < 2:
        return Ratio(mean(numerator) / mean(denominator))
    from model.evaluation.tables import bootstrap_ratio

    interval = bootstrap_ratio([numerator[n] for n in shared], [denominator[n] for n in shared])
    return Ratio(interval.mean, len(shared), interval.low, interval.high)


def format_means(values: Mapping[str, Samples]) -> str:
    """Format the mean of each system as one line, for example "a 1, b 2; reference 3"."""
    means = {name: format_two_digits(mean(each)) for name, each in values.items()}
    reference = means.pop(REFERENCE_NAME, None)
    listed = ", ".join(f"{label} {means[name]}" for name, label in short_names(means).items())
    return listed if reference is None else f"{listed}; {REFERENCE_NAME} {reference}"


KIND_TITLES = {
    "identical": "copy of the reference", "still": "no movement", "lifted": "feet above or below "
    "the reference",
    "time_shift": "lag", "pops": "single-frame pops", "snap": "sudden turns",
    "period": "periodic jerk", "stretched_rate": "interpolated frames",
    "foot_slide": "foot sliding", "floating": "floating feet", "through_floor": "feet below the "
    "floor",
    "high_frequency": "unusual power above 5 Hz", "amplitude": "unusual variation of posture",
    "speed": "unusual amount of movement", "finger_range": "finger joint-limit violations",
}  # fmt: skip
"""Titles of kinds of findings (`model.faults.table`) that their names do not tell."""


def format_finding_kinds(kinds: Iterable[str]) -> str:
    """Format kinds of findings as a list in words."""
    return ", ".join(KIND_TITLES.get(kind, kind.replace("_", " ")) for kind in kinds)


def format_two_digits(value: float) -> str:
    """Format a number with two significant digits, whole numbers from ten on, without exponent."""
    rounded = float(f"{value:.2g}")
    if abs(rounded) >= 10.0 or rounded == 0.0:
        return f"{value:.0f}"
    if 0.0 < rounded < 1e-3:
        return "under 0.001"
    return f"{rounded:.{1 - floor(log10(abs(rounded)))}f}"


def point_title(point: str) -> str:
    """Return the title of a point: 'Right middle fingertip' for ``right_middle``."""
    words = re.sub(r"(\d)$", r" joint \1", point).replace("_", " ").capitalize()
    if point not in FINGERTIP_VERTICES:
        return words
    return f"{words} tip" if point.endswith("thumb") else f"{words} fingertip"
