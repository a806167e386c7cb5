"""Means with bootstrap intervals, over clips: what differs between clips is the uncertainty."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

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


def drawn_clips(num_clips: int, draws: int) -> Iterator[Int[np.ndarray, " n"]]:
    """Clips drawn with replacement, as many as there are; the same for all who ask."""
    rng = np.random.default_rng(0)
    for _ in range(draws):
        yield rng.integers(num_clips, size=num_clips)


def interval_of(value: float, drawn: Sequence[float]) -> Interval:
    """Of all clips, with the interval of what the draws gave."""
    low, high = np.percentile(drawn, PERCENTILES)
    return Interval(float(value), float(low), float(high))


def bootstrap(values: Sequence[float]) -> Interval:
    """Mean over clips."""
    array = np.asarray(values, float)
    return bootstrap_of(lambda index: float(array[index].mean()), len(array))


def bootstrap_ratio(values: Sequence[float], reference: Sequence[float]) -> Interval:
    """Mean over mean of the same clips; clips are drawn in pairs."""
    a, b = np.asarray(values, float), np.asarray(reference, float)
    return bootstrap_of(lambda index: float(a[index].mean() / b[index].mean()), len(a))


def bootstrap_difference(values: Sequence[float], reference: Sequence[float]) -> Interval:
    """Mean difference within clips."""
    return bootstrap([a - b for a, b in zip(values, reference, strict=True)])
