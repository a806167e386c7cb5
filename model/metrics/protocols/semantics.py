"""Semantic relevance of gestures (SRGR): joints near the recorded, weighted by BEAT's labels."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from conventions.rates import FPS
from model.metrics.protocols.clip import Clip, Sums
from model.storage.files import read_within_limit
from model.storage.npz import MotionError

MAX_BYTES, MAX_LABELS = 2**20, 5_000
MEAN_RELEVANCE = 0.165
"""Mean relevance over BEAT, by which the published code divides."""


def read_semantics(path: Path, num_frames: int) -> Float[np.ndarray, " T"]:
    """Read the relevance of each frame from a file of BEAT's folder ``sem``.

    Its lines have a name, start, end, duration (s), score and keywords, separated by tabs. A frame
    has the score of the first label that contains it, else 0. Raises MotionError for other files.
    """
    relevance, times = np.zeros(num_frames), np.arange(num_frames) / FPS
    is_labelled = np.zeros(num_frames, bool)
    lines = read_within_limit(path, MAX_BYTES, MotionError).decode("utf-8", "replace").splitlines()
    if len(lines) > MAX_LABELS:
        raise MotionError(
            f"{path.name} has {len(lines)} lines; a file of labels may have at most {MAX_LABELS}."
        )
    for number, line in enumerate(filter(str.strip, lines), 1):
        try:
            start, end, _, score = (float(cell) for cell in line.split("\t")[1:5])
            if not np.isfinite([start, end]).all() or not 0 <= score <= 1:
                raise ValueError
        except ValueError:
            raise MotionError(
                f"Line {number} of {path.name} is not a label in BEAT's format (name, start, end, "
                "duration and a score from 0 to 1, separated by tabs). Use a file from the "
                "`sem` folder of BEAT."
            ) from None
        inside = (start <= times) & (times <= end) & ~is_labelled
        relevance[inside], is_labelled = score, is_labelled | inside
    return relevance


@dataclass(frozen=True)
class SemanticRelevanceRecall:
    """Variant of SRGR; its call computes the sums of a clip."""

    threshold_m: float
    norm: Literal[1, 2]
    """Norm of the distance: of coordinates (1), or Euclidean (2)."""

    def __call__(self, clip: Clip) -> Sums:
        assert clip.reference is not None and clip.semantics is not None
        distance = np.linalg.norm(
            clip.pelvis_aligned - clip.reference.pelvis_aligned, ord=self.norm, axis=-1
        )
        near = (distance < self.threshold_m).mean(axis=1)
        score = (near * clip.semantics).sum() / MEAN_RELEVANCE
        return {"count": np.array(float(len(near))), "srgr": np.array(score)}
