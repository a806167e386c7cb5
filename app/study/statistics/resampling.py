"""Bootstrap over participants: whole persons are drawn, with all that they answered."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy import stats

from app.study.statistics.preference import CONFIDENCE, Interval

RESAMPLES = 2000
SEED = 0
"""Fixed, so that the same answers give the same report."""


def participant_weights(num_participants: int) -> Float[np.ndarray, "B R"]:
    """How often each participant is drawn in each resample."""
    rng = np.random.default_rng(SEED)
    even = np.full(num_participants, 1 / num_participants)
    return rng.multinomial(num_participants, even, RESAMPLES).astype(float)


def percentile_intervals(
    samples: Float[np.ndarray, "B C"], num_participants: int
) -> Float[np.ndarray, "2 C"]:
    """Lower and upper limits from resampled estimates.

    Percentiles are expanded for few participants (Hesterberg 2015, "What teachers should know
    about the bootstrap", section 5.3): plain ones are too narrow by sqrt((R - 1) / R) and by what
    the normal quantile falls short of Student's.
    """
    if num_participants < 2:
        return np.stack([np.full(samples.shape[1:], -np.inf), np.full(samples.shape[1:], np.inf)])
    freedom = num_participants - 1
    student = stats.t.ppf((1 - CONFIDENCE) / 2, freedom)
    tail = stats.norm.cdf(np.sqrt(num_participants / freedom) * student)
    return np.quantile(samples, [tail, 1 - tail], axis=0)


def mean_intervals(values: Float[np.ndarray, "R K"]) -> list[Interval]:
    """An interval for the mean of each column over participants."""
    weights = participant_weights(len(values))
    low, high = percentile_intervals(weights @ values / len(values), len(values))
    return [Interval(float(a), float(b)) for a, b in zip(low, high, strict=True)]
