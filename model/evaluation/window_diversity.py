"""Div (AsynFusion eq. 17) of many clips, with its interval."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from model.evaluation.intervals import Interval, bootstrap_of
from model.measures.diversity import GESTURE_DIM, batches, pair_distances


def window_diversity(clips: Sequence[Float[np.ndarray, "_ T _"]]) -> dict[str, Interval]:
    """Distance of every two windows of a batch, over batches of 50 that are dealt from all clips.

    Args:
        clips: windows of each clip, see `model.measures.diversity.windows_of`.

    Returns:
        ``div_gesture``, and where all clips have face units ``div`` of body and face together;
        nothing if there are no two windows.
    """
    owner = np.repeat(np.arange(len(clips)), [len(windows) for windows in clips])
    if len(owner) < 2:
        return {}
    dim = min(windows.shape[2] for windows in clips)
    windows = np.concatenate([windows[..., :dim] for windows in clips])
    parts = {"div": windows} if dim > GESTURE_DIM else {}
    parts["div_gesture"] = windows[..., :GESTURE_DIM]
    return {name: _over_batches(part, owner, len(clips)) for name, part in parts.items()}


def _over_batches(
    windows: Float[np.ndarray, "W T dim"], owner: Int[np.ndarray, " W"], num_clips: int
) -> Interval:
    """The mean over pairs, and its interval over clips."""
    sums, pairs = np.zeros((2, num_clips, num_clips))
    for batch in batches(len(windows)):
        between = owner[batch][:, None], owner[batch]
        np.add.at(sums, between, pair_distances(windows[batch]))
        np.add.at(pairs, between, 1.0 - np.eye(len(batch)))

    def statistic(index: Int[np.ndarray, " n"]) -> float:
        """Pairs of windows of two clips or of one, not of a clip that was drawn twice."""
        chosen = np.ix_(index, index)
        counts = (index[:, None] != index) | np.eye(len(index), dtype=bool)
        total = pairs[chosen][counts].sum()
        return float(sums[chosen][counts].sum() / total) if total > 0 else 0.0

    return bootstrap_of(statistic, num_clips)
