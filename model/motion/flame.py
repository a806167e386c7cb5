"""ARKit weights from FLAME's expression coefficients, by a matrix of BEAT2 that users provide."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from model.motion.motion import Motion
from model.storage.npz import MotionError

NUM_SHAPES, NUM_COEFFICIENTS = 51, 103
"""Shape of BEAT2's ``mat_final.npy``: ARKit's shapes by name without tongueOut; FLAME's 100
coefficients and the rotation of the jaw."""
_MAX_BYTES = 10**6
_JAW_SHAPES = slice(22, 26)
"""jawForward, jawLeft, jawOpen and jawRight, in whose place the jaw joint moves."""
_STEPS = 100


def read_flame_matrix(path: Path) -> Float[np.ndarray, "51 103"]:
    """Read BEAT2's ``mat_final.npy``; raises MotionError for a wrong shape or numbers."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise ValueError("too large")
        matrix = np.load(path, allow_pickle=False)
        is_good = matrix.shape == (NUM_SHAPES, NUM_COEFFICIENTS) and np.isfinite(matrix).all()
    except (OSError, TypeError, ValueError, EOFError):
        is_good = False
    if not is_good:
        raise MotionError(
            f"{path.name} is not BEAT2's mat_final.npy; a matrix of {NUM_SHAPES} x "
            f"{NUM_COEFFICIENTS} numbers is needed (from the dataset's page, under its licence)."
        )
    return matrix.astype(np.float64)


def flame_to_arkit(motion: Motion, matrix: Float[np.ndarray, "51 103"]) -> Motion:
    """Return a motion whose face has the ARKit weights nearest to its FLAME coefficients.

    They are the least squares solution within 0 to 1, found by projected gradients. A motion that
    has ARKit's weights is returned as it is.
    """
    if motion.expression_basis != "flame100":
        return motion
    jaw = 3 * JOINT_INDEX["jaw"]
    wanted = np.concatenate([motion.expressions, motion.poses[:, jaw : jaw + 3]], axis=1)
    gram, towards = matrix @ matrix.T, wanted.astype(np.float64) @ matrix.T
    step = 1 / max(float(np.linalg.norm(gram, 2)), 1e-12)
    weights = np.clip(wanted @ np.linalg.pinv(matrix), 0, 1)
    for _ in range(_STEPS):
        weights = np.clip(weights - step * (weights @ gram - towards), 0, 1)
    expressions = np.zeros_like(motion.expressions)
    expressions[:, :NUM_SHAPES] = weights
    expressions[:, _JAW_SHAPES] = 0
    return replace(motion, expressions=expressions, expression_basis="arkit52")
