"""How much a clip's poses differ from each other."""

import numpy as np
from jaxtyping import Float


def l1_to_mean(positions: Float[np.ndarray, "T J 3"]) -> float:
    """EMAGE's diversity: L1 distance to the clip's mean pose, summed over coordinates, metres."""
    return float(np.abs(positions - positions.mean(0)).sum((1, 2)).mean())
