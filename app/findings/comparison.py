"""Numbers of several systems and their samples beside each other, in words."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import floor, log, log10

from conventions.joints import TIP_VERTICES
from conventions.names import REFERENCE_NAME, SampleName, short_names

ALIKE = 1 / 0.95
"""Two numbers whose ratio lies within this factor of 1 are told as equal: 5 % less or, seen from
the other one, as much more."""

Samples = dict[int, float]
"""Number of a sample, or of a clip, from 1, to its value."""
Table = Mapping[str, Mapping[str, Samples]]
"""By the key of a measure, what each system has, and the reference."""


@dataclass(frozen=True)
class Ratio:
    """One system's mean over another's, with a 95 % interval where they share several samples."""

    value: float
    num_samples: int = 1
    low: float | None = None
    high: float | None = None

    @property
    def is_alike(self) -> bool:
        return abs(log(self.value)) < log(ALIKE)

    @property
    def is_open(self) -> bool:
        """Whether the interval holds 1: the samples do not tell the two systems apart."""
        return self.low is not None and self.high is not None and self.low <= 1.0 <= self.high


def samples_by_system(names: Iterable[str]) -> dict[str, dict[int, str]]:
    """The names of each system's samples: ``a`` and ``a.s2`` are samples 1 and 2 of ``a``."""
    names = list(names)
    systems: dict[str, dict[int, str]] = {}
    for name in names:
        sample = SampleName.parse(name)
        if sample.system not in names:
            sample = SampleName(name)
        systems.setdefault(sample.system, {})[sample.number] = name
    return systems


def by_measure(clips: Iterable[Mapping[str, Mapping[str, float]]]) -> Table:
    """Each measure of the samples of one clip; of several clips a value of each, the mean of its
    samples.

    Args:
        clips: by motion and the key of a measure.
    """
    clips = list(clips)
    found: dict[str, dict[str, Samples]] = {}
    for number, clip in enumerate(clips, 1):
        for system, samples in samples_by_system(clip).items():
            for key in dict.fromkeys(key for name in samples.values() for key in clip[name]):
                of = {n: clip[name][key] for n, name in samples.items() if key in clip[name]}
                of_clip = of if len(clips) == 1 else {number: mean(of)}
                found.setdefault(key, {}).setdefault(system, {}).update(of_clip)
    return found


def mean(samples: Samples) -> float:
    return sum(samples.values()) / len(samples)


def ratio_of(above: Samples, below: Samples) -> Ratio | None:
    """Mean over mean; samples with the same number had the same noise and are drawn in pairs.

    None where a value is not positive, so that there is no ratio.
    """
    if min([*above.values(), *below.values()]) <= 0.0:
        return None
    shared = sorted(above.keys() & below.keys())
    if len(shared) < 2:
        return Ratio(mean(above) / mean(below))
    from model.evaluation.tables import bootstrap_ratio

    interval = bootstrap_ratio([above[n] for n in shared], [below[n] for n in shared])
    return Ratio(interval.mean, len(shared), interval.low, interval.high)


def told_of(values: Mapping[str, Samples]) -> str:
    """Each system's mean: a 1, b 2; reference 3."""
    means = {name: plain(mean(each)) for name, each in values.items()}
    reference = means.pop(REFERENCE_NAME, None)
    told = ", ".join(f"{label} {means[name]}" for name, label in short_names(means).items())
    return told if reference is None else f"{told}; {REFERENCE_NAME} {reference}"


def kinds_told(kinds: Iterable[str]) -> str:
    """Kinds of findings, in words."""
    return ", ".join(kinds).replace("_", " ")


def plain(value: float) -> str:
    """Two significant digits, whole numbers from ten on, and no exponent."""
    rounded = float(f"{value:.2g}")
    if abs(rounded) >= 10.0 or rounded == 0.0:
        return f"{value:.0f}"
    if 0.0 < rounded < 1e-3:
        return "under 0.001"
    return f"{rounded:.{1 - floor(log10(abs(rounded)))}f}"


def point_title(point: str) -> str:
    """A point's name for a person: ``right_middle`` is the 'Right middle fingertip'."""
    words = re.sub(r"(\d)$", r" joint \1", point).replace("_", " ").capitalize()
    if point not in TIP_VERTICES:
        return words
    return f"{words} tip" if point.endswith("thumb") else f"{words} fingertip"
