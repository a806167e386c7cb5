"""Means with bootstrap intervals, over clips: what differs between clips is the uncertainty."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

DRAWS = 2000
PERCENTILES = (2.5, 97.5)


@dataclass(frozen=True)
class Interval:
    """A value over clips with its 95 % percentile interval."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:.3g} [{self.low:.3g}, {self.high:.3g}]"


def bootstrap_of(
    statistic: Callable[[Int[np.ndarray, " n"]], float], num_clips: int, draws: int = DRAWS
) -> Interval:
    """A statistic of clips, and its interval over clips drawn with replacement.

    Args:
        statistic: of the clips with these indices; called with all of them once for the value.
    """
    values = [statistic(index) for index in drawn_clips(num_clips, draws)]
    return interval_of(statistic(np.arange(num_clips)), values)


@lru_cache(maxsize=4)  # 16 MB each for 1,000 clips
def drawn_clips(num_clips: int, draws: int) -> Int[np.ndarray, "draws n"]:
    """Clips drawn with replacement, as many as there are; the same for all who ask."""
    rng = np.random.default_rng(0)
    drawn = np.stack([rng.integers(num_clips, size=num_clips) for _ in range(draws)])
    drawn.flags.writeable = False
    return drawn


def interval_of(value: float, drawn: Sequence[float] | Float[np.ndarray, " draws"]) -> Interval:
    """Of all clips, with the interval of what the draws gave."""
    low, high = np.percentile(drawn, PERCENTILES)
    return Interval(float(value), float(low), float(high))


def bootstrap(values: Sequence[float]) -> Interval:
    """Mean over clips."""
    array = np.asarray(values, float)
    drawn = array[drawn_clips(len(array), DRAWS)].mean(axis=1)
    return interval_of(float(array.mean()), drawn)


def bootstrap_ratio(values: Sequence[float], reference: Sequence[float]) -> Interval:
    """Mean over mean of the same clips; clips are drawn in pairs."""
    a, b = np.asarray(values, float), np.asarray(reference, float)
    index = drawn_clips(len(a), DRAWS)
    return interval_of(float(a.mean() / b.mean()), a[index].mean(axis=1) / b[index].mean(axis=1))


def bootstrap_difference(values: Sequence[float], reference: Sequence[float]) -> Interval:
    """Mean difference within clips."""
    return bootstrap([a - b for a, b in zip(values, reference, strict=True)])
