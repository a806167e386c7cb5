"""Rankings and ratings: means, tests for paired samples, and how far raters agree.

The participant is the unit: their answers over clips are averaged first, because they are alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, assert_never

import numpy as np
from jaxtyping import Float
from scipy import stats

from app.study.statistics.preference import Interval, holm, mean_intervals
from app.study.statistics.votes import Values


@dataclass(frozen=True)
class PairedTest:
    """Two systems, each participant their own control."""

    first: int
    second: int
    difference: float
    """Mean of the first minus that of the second."""
    interval: Interval
    p: float
    """Wilcoxon's signed-rank test over participants, two-sided."""
    p_holm: float
    """Adjusted over the pairs of the question."""


@dataclass(frozen=True)
class MeanValues:
    """Means over participants of one question."""

    num_raters: int
    mean: Float[np.ndarray, " K"]
    intervals: tuple[Interval, ...]
    friedman_p: float | None
    """That all systems are alike; None with fewer than 3 systems or 2 participants."""
    pairs: tuple[PairedTest, ...]


def compare_means(values: Values, num_systems: int) -> MeanValues | None:
    """Means, intervals and tests; None if nobody judged every system."""
    means = values.rater_means(num_systems)
    if not len(means):
        return None
    tests = [(pair, _signed_rank_p(means, *pair)) for pair in combinations(range(num_systems), 2)]
    gaps = [means[:, first] - means[:, second] for (first, second), _ in tests]
    intervals = mean_intervals(np.stack(gaps, axis=1)) if gaps else []
    adjusted = holm([p for _, p in tests])
    return MeanValues(
        num_raters=len(means),
        mean=means.mean(0),
        intervals=tuple(mean_intervals(means)),
        friedman_p=_friedman_p(means),
        pairs=tuple(
            PairedTest(*pair, float(gap.mean()), interval, p, p_holm)
            for (pair, p), gap, interval, p_holm in zip(
                tests, gaps, intervals, adjusted, strict=True
            )
        ),
    )


def _signed_rank_p(means: Float[np.ndarray, "R K"], first: int, second: int) -> float:
    # Means of equal ranks may differ in their last bit, which must not count as a difference.
    gap = np.round(means[:, first] - means[:, second], 9)
    if not gap.any():
        return 1.0
    _, p = stats.wilcoxon(gap)
    return float(p)  # pyright: ignore[reportArgumentType]


def _friedman_p(means: Float[np.ndarray, "R K"]) -> float | None:
    if means.shape[1] < 3 or len(means) < 2:
        return None
    rounded = np.round(means, 9)
    if (rounded == rounded[:, :1]).all():
        return 1.0
    _, p = stats.friedmanchisquare(*rounded.T)
    return float(p)  # pyright: ignore[reportArgumentType]


Level = Literal["nominal", "ordinal", "interval"]


def krippendorff_alpha(units: Iterable[Sequence[float]], level: Level) -> float | None:
    """Alpha from coincidences (Krippendorff 2011, "Computing Krippendorff's Alpha-Reliability").

    Args:
        units: for each thing judged the values it got, in any order; raters may be missing.
        level: what the values are: names, an order, or numbers.

    Returns:
        None if no unit has two values, or all values are the same: then there is nothing to agree
        on.
    """
    pairable = [np.asarray(unit, dtype=float) for unit in units if len(unit) >= 2]
    if not pairable:
        return None
    values, codes = np.unique(np.concatenate(pairable), return_inverse=True)
    coincidences = np.zeros((len(values), len(values)))
    ends = np.cumsum([len(unit) for unit in pairable])
    for unit in np.split(codes, ends[:-1]):
        counts = np.bincount(unit, minlength=len(values)).astype(float)
        coincidences += (np.outer(counts, counts) - np.diag(counts)) / (len(unit) - 1)
    totals = coincidences.sum(1)
    difference = _squared_difference(values, totals, level)
    expected = totals @ difference @ totals
    if expected == 0:
        return None
    return float(1 - (totals.sum() - 1) * (coincidences * difference).sum() / expected)


def _squared_difference(
    values: Float[np.ndarray, " V"], totals: Float[np.ndarray, " V"], level: Level
) -> Float[np.ndarray, "V V"]:
    if level == "nominal":
        return 1 - np.eye(len(values))
    if level == "interval":
        return np.subtract.outer(values, values) ** 2
    if level == "ordinal":
        # Sum of the totals from one value to the other, both ends counted half.
        middle = np.cumsum(totals) - totals / 2
        return np.subtract.outer(middle, middle) ** 2
    assert_never(level)
