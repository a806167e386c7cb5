"""Measures of several systems and their samples, the highest against the lowest, as sentences.

The words come from the numbers, so that swapped numbers turn the sentence round.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import floor, isfinite, log, log10
from typing import TYPE_CHECKING

from conventions.joints import TIP_VERTICES
from conventions.names import SampleName

if TYPE_CHECKING:
    from conventions.names import Version
    from model.diagnostics import Diagnostics, Versions
    from model.measures.results import Measures

ALIKE = 1.05
"""Two numbers whose ratio lies within this factor of 1 are told as equal."""

Read = Callable[["Measures"], float]
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


def extremes(values: Mapping[str, Samples]) -> tuple[str, str]:
    """The systems with the highest and the lowest mean; of equal ones the first and the last."""
    order = sorted(values, key=lambda system: -mean(values[system]))
    return order[0], order[-1]


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


FEW_SAMPLES = 5
"""An interval over fewer samples is told to be rough."""


def comparison(
    diagnostics: Diagnostics, read: Read, noun: str, unit: str, scale: float = 1.0
) -> str:
    """Highest against lowest system as generated, the same two after the filter, the reference."""

    def told(value: float) -> str:
        return f"{plain(scale * value)} {unit}"

    raw = values_by_system(diagnostics, read, "raw")
    filtered = values_by_system(diagnostics, read, "savgol")
    if not raw:
        return ""
    reference = number_of(diagnostics.reference, read, "raw")
    ending = "" if reference is None else f" The reference has {told(reference)}."
    if len(raw) == 1:
        (system,) = raw
        own = f"{told(mean(raw[system]))}{_over_samples(raw[system])}"
        after = f", {told(mean(filtered[system]))} after the filter" if system in filtered else ""
        return f"On this clip {system} has a {noun} of {own}{after}.{ending}"
    high, low = extremes(raw)
    numbers = f"({plain(scale * mean(raw[high]))} against {told(mean(raw[low]))})"
    ratio = ratio_of(raw[high], raw[low])
    if ratio is None:
        return (
            f"On this clip the {noun} is highest with {high} and lowest with {low} {numbers}."
            f"{ending}"
        )
    picked = "" if len(raw) == 2 else f", the highest and the lowest of {len(raw)},"
    if ratio.is_alike:
        text = f"On this clip {high} and {low}{picked} have the same {noun} within 5 % {numbers}"
    else:
        text = f"On this clip {high} has {times(ratio.value)} the {noun} of {low}"
        text += f"{picked.rstrip(',')} {numbers}"
    text += _interval(ratio)
    if high in filtered and low in filtered:
        text += _after_filter(high, low, ratio, ratio_of(filtered[high], filtered[low]))
    return f"{text}.{ending} {_caveat(ratio, len(raw))}"


def _after_filter(high: str, low: str, raw: Ratio, filtered: Ratio | None) -> str:
    """What becomes of the two behind the filter."""
    if filtered is None:
        return ""
    if filtered.is_alike:
        return "; after the filter the two are the same within 5 %"
    if filtered.value < 1.0:
        return f"; after the filter {low} has {times(1.0 / filtered.value)} that of {high}"
    of_both = f"{high} has {times(filtered.value)} that of {low}"
    of_both = of_both if raw.is_alike else times(filtered.value)
    return f"; after the filter {of_both}{_interval(filtered)}"


def _interval(ratio: Ratio) -> str:
    if ratio.low is None or ratio.high is None:
        return ""
    samples = f"{ratio.num_samples} samples"
    return f", 95 % interval {plain(ratio.low)} to {plain(ratio.high)} over {samples}"


def _caveat(ratio: Ratio, num_systems: int) -> str:
    """What the comparison is worth."""
    if ratio.low is None:
        return "One sample each: of these motions, not of the systems."
    parts = []
    if ratio.is_open:
        parts.append("The interval holds 1: these samples do not tell the two apart.")
    if ratio.num_samples < FEW_SAMPLES:
        parts.append(f"From only {ratio.num_samples} samples the interval is rough.")
    if num_systems > 2:
        parts.append("The two were picked as extremes, so their interval is too favourable.")
    return " ".join([*parts, "One clip: nothing is said of other speech."])


def _over_samples(samples: Samples) -> str:
    return f" (mean of {len(samples)} samples)" if len(samples) > 1 else ""


def word(ratio: float, more: str, less: str, same: str) -> str:
    if abs(log(ratio)) < log(ALIKE):
        return same
    return more if ratio > 1.0 else less


def times(ratio: float) -> str:
    return f"{plain(ratio)} times"


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
