"""Rankings and ratings: one mean for each participant and system, then tests for paired samples.

The participant is the unit: their answers over clips are averaged first, because they are alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy import stats

from app.study.statistics.preference import Interval, holm
from app.study.statistics.resampling import mean_intervals
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
