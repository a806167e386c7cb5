"""Krippendorff's alpha: how far raters agree beyond chance (1 = fully, 0 = as by chance)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, assert_never

import numpy as np
from jaxtyping import Float

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
