"""The seconds of a run in which the followed point jerks most: where a person should look."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

NUM_SECONDS = 6


def worst_seconds(
    tracks: Mapping[str, np.ndarray], count: int = NUM_SECONDS
) -> list[dict[str, Any]]:
    """At most ``count`` seconds without overlap, the worst of all motions first.

    Args:
        tracks: by the name of a motion its point (T, 3), metres, 30 frames per second.

    Returns:
        For each ``start_s`` and ``end_s``, the ``name`` of the motion that jerks most then, and its
        mean ``jerk_m_s3``; a shorter clip is one stretch, and one under 4 frames is none.
    """
    from conventions.rates import FPS
    from model.measures.smoothness import derivative_magnitudes

    means = {name: _means(derivative_magnitudes(track, 3), FPS) for name, track in tracks.items()}
    lengths = {name: min(FPS, len(track)) for name, track in tracks.items()}
    found: list[dict[str, Any]] = []
    while len(found) < count:
        left = {name: mean for name, mean in means.items() if np.isfinite(mean).any()}
        if not left:
            break
        name = max(left, key=lambda each: np.nanmax(left[each]))
        start = int(np.nanargmax(means[name]))
        found.append(
            {
                "start_s": round(start / FPS, 4),
                "end_s": round((start + lengths[name]) / FPS, 4),
                "name": name,
                "jerk_m_s3": round(float(means[name][start]), 1),
            }
        )
        for mean in means.values():
            mean[max(0, start - FPS + 1) : start + FPS] = np.nan
    return found


def worst_of_both(
    first: list[dict[str, Any]], second: list[dict[str, Any]], count: int = NUM_SECONDS
) -> list[dict[str, Any]]:
    """The worst of two such lists, without overlap."""
    kept: list[dict[str, Any]] = []
    for each in sorted([*first, *second], key=lambda one: -one["jerk_m_s3"]):
        if all(each["start_s"] >= k["end_s"] or each["end_s"] <= k["start_s"] for k in kept):
            kept.append(each)
    return kept[:count]


def _means(jerk: np.ndarray, num_frames: int) -> np.ndarray:
    """Mean jerk of the stretch that begins at each frame, over what lies whole within it."""
    entries = min(num_frames - 3, len(jerk))
    if entries < 1:
        return np.empty(0)
    total = np.concatenate([[0.0], np.cumsum(jerk)])
    return (total[entries:] - total[:-entries]) / entries
