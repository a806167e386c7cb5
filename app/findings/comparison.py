"""One measure of several systems as one sentence: the highest against the lowest.

The words come from the numbers, so that swapped numbers turn the sentence round.
"""

from __future__ import annotations

from math import floor, log, log10
from typing import TYPE_CHECKING

from app.findings.samples import (
    ALIKE,
    Ratio,
    Read,
    Samples,
    extremes,
    mean,
    number_of,
    ratio_of,
    values_by_system,
)

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics

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
        return "One sample each: an example, no comparison."
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
