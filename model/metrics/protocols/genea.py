"""Protocols of GENEA's numerical evaluations: speed histograms and canonical correlation."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Num
from threadpoolctl import threadpool_limits

from conventions.joints import FACE
from conventions.rates import FPS
from model.metrics.protocols.clip import Clip, Sums

JOINTS = [joint for joint in range(1, 55) if joint not in FACE]
"""Joints of body and hands; the pelvis stays at the origin."""
SPEED_STEP_CM_S, MAX_SPEED_CM_S = 0.05, 49
_EDGES = np.arange(0, MAX_SPEED_CM_S + SPEED_STEP_CM_S, SPEED_STEP_CM_S)
CONSTANT_CM, RANK_CUTOFF = 1e-8, 1e6 * np.finfo(np.float64).eps
"""Least standard deviation of a coordinate, and least singular value against the largest, as in
scikit-learn's CCA, which GENEA uses."""


def _positions_cm(clip: Clip) -> Float[np.ndarray, "T J 3"]:
    return clip.pelvis_aligned[:, JOINTS] * 100


def speed_histogram_sums(clip: Clip) -> Sums:
    """Count the speeds of all joints of a clip and of its reference by steps of 0.05 cm/s."""
    assert clip.reference is not None
    return {
        name: np.histogram(
            np.linalg.norm(np.diff(_positions_cm(each), axis=0), axis=-1) * FPS, _EDGES
        )[0].astype(float)
        for name, each in (("generated", clip), ("recorded", clip.reference))
    }


def hellinger_distance(sums: Mapping[str, Num[np.ndarray, " ..."]]) -> dict[str, float]:
    """Compute the Hellinger distance of the two histograms; nothing if one is empty."""
    counts = sums["generated"], sums["recorded"]
    if not all(each.sum() for each in counts):
        return {}
    shares = [each / each.sum() for each in counts]
    return {"hellinger": float(np.sqrt(max(0.0, 1.0 - np.sqrt(shares[0] * shares[1]).sum())))}


@threadpool_limits.wrap(limits=1, user_api="blas")  # on matrices this small threads only wait
def canonical_correlation_sums(clip: Clip) -> Sums:
    """Compute the first canonical correlation of a clip with its reference.

    Empty for a clip that has fewer frames than coordinates, where it is always 1.
    """
    assert clip.reference is not None
    if len(clip.joints) < 2:
        return {}
    bases = [_basis(_positions_cm(each)) for each in (clip, clip.reference)]
    if sum(basis.shape[1] for basis in bases) >= len(clip.joints) or not all(
        basis.shape[1] for basis in bases
    ):
        return {}
    first = float(np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)[0])
    return {"count": np.array(1.0), "cca": np.array(first)}


def _basis(positions: Float[np.ndarray, "T J 3"]) -> Float[np.ndarray, "T rank"]:
    """Return an orthonormal basis of the standardised coordinates over time."""
    flat = positions.reshape(len(positions), -1)
    centred, spread = flat - flat.mean(axis=0), flat.std(axis=0, ddof=1)
    is_moving = spread > CONSTANT_CM
    left, values, _ = np.linalg.svd(centred[:, is_moving] / spread[is_moving], full_matrices=False)
    return left[:, values > RANK_CUTOFF * values.max(initial=0.0)]
