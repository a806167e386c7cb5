"""Runs of equal values in an array over time."""

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Shaped


def equal_runs(values: Shaped[np.ndarray, " T"]) -> list[tuple[int, int]]:
    """Return the start and end (exclusive) of each run of equal values."""
    edges = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    return list(pairwise(edges))


def true_runs(mask: Bool[np.ndarray, " T"]) -> list[tuple[int, int]]:
    """Return the start and end (exclusive) of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
