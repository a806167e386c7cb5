"""How far two tracks go together where one may come a little later than the other."""

import numpy as np
from jaxtyping import Float

from conventions.rates import FPS

MAX_LAG_S = 0.5
SMOOTHING_FRAMES = 9


def lagged_correlation(a: Float[np.ndarray, " N"], b: Float[np.ndarray, " M"]) -> float:
    """Correlation at the best lag within half a second, both smoothed over 0.3 s. The choice of the
    lag raises it above 0 for any two signals: compare with a shifted one."""
    frames = min(len(a), len(b))
    box = np.ones(SMOOTHING_FRAMES) / SMOOTHING_FRAMES
    a, b = (np.convolve(track[:frames], box, "valid") for track in (a, b))
    lags = range(-round(MAX_LAG_S * FPS), round(MAX_LAG_S * FPS) + 1)
    return max(_correlation(a, b, lag) for lag in lags)


def _correlation(a: np.ndarray, b: np.ndarray, lag: int) -> float:
    a, b = (a[lag:], b[: len(b) - lag]) if lag >= 0 else (a[:lag], b[-lag:])
    if len(a) < 2 or a.std() == 0 or b.std() == 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])
