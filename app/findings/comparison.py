"""Numbers of several systems and their samples beside each other, in words."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import floor, isfinite, log, log10
from typing import TYPE_CHECKING

from conventions.joints import TIP_VERTICES
from conventions.names import VERSIONS, SampleName

if TYPE_CHECKING:
    from conventions.names import Version
    from model.diagnostics import Diagnostics, Versions
    from model.measures.results import Measures

ALIKE = 1.05
"""Two numbers whose ratio lies within this factor of 1 are told as equal."""

SMOOTHED = "After Savitzky-Golay smoothing"
"""Of `model.motion.altered`, as the official code does it."""

Read = Callable[["Measures"], float | None]
"""Takes one number out of the measures of a motion."""
Samples = dict[int, float]
"""Number of a sample, from 1, to its value."""


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


def values_by_system(diagnostics: Diagnostics, read: Read, kind: Version) -> dict[str, Samples]:
    """One number of each sample of each system; systems that have no such number are left
    out."""
    found: dict[str, Samples] = {}
    for system, samples in samples_by_system(diagnostics.systems).items():
        values = {
            number: number_of(diagnostics.systems[name], read, kind)
            for number, name in samples.items()
        }
        known = {number: value for number, value in values.items() if value is not None}
        if known:
            found[system] = known
    return found


def number_of(versions: Versions | None, read: Read, kind: Version) -> float | None:
    """One number, or None where it was not measured."""
    value = None if versions is None else read(versions.of(kind))
    return value if value is not None and isfinite(value) else None


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


def told_of(values: Mapping[str, Samples], reference: float | None) -> str:
    """Each system's mean: a 1, b 2; reference 3."""
    told = ", ".join(f"{system} {plain(mean(each))}" for system, each in values.items())
    return told if reference is None else f"{told}; reference {plain(reference)}"


def numbers_told(diagnostics: Diagnostics, read: Read, noun: str) -> str:
    """One number of each system and of the reference, as generated and smoothed; empty where none
    was measured."""
    lines: list[str] = []
    for kind, start in zip(VERSIONS, (noun, SMOOTHED), strict=True):
        if values := values_by_system(diagnostics, read, kind):
            reference = number_of(diagnostics.reference, read, kind)
            lines.append(f"{start}: {told_of(values, reference)}.")
    return " ".join(lines)


def plain(value: float) -> str:
    """Two significant digits, whole numbers from ten on, and no exponent."""
    rounded = float(f"{value:.2g}")
    if abs(rounded) >= 10.0 or rounded == 0.0:
        return f"{value:.0f}"
    return f"{rounded:.{1 - floor(log10(abs(rounded)))}f}"


def point_title(point: str) -> str:
    """A point's name for a person: ``right_middle`` is the 'Right middle fingertip'."""
    words = re.sub(r"(\d)$", r" joint \1", point).replace("_", " ").capitalize()
    if point not in TIP_VERTICES:
        return words
    return f"{words} tip" if point.endswith("thumb") else f"{words} fingertip"
