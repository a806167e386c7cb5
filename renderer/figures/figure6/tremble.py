"""What trembles: how far a point is off its own slow path.

A path of 30 cm hides a tremble of 2 mm; on a scale of its own one sees which motion has more.
"""

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

CUT_OFF_HZ = 5.0
ORDER = 4
MIN_FRAMES = 32
"""About a second; fewer frames cannot tell 5 Hz from what lies below it."""


def has_tremble(num_frames: int, fps: float) -> bool:
    """Whether so short or slow a track can show any."""
    return num_frames >= MIN_FRAMES and fps > 2.0 * CUT_OFF_HZ


def off_the_slow_path(positions: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, "T 3"]:
    """Positions less those below 5 Hz (Butterworth of order 4, forwards and backwards), in
    millimetres for metres."""
    low = butter(ORDER, CUT_OFF_HZ, fs=fps, output="sos")
    exact = np.asarray(positions, np.float64)
    return 1000.0 * (exact - sosfiltfilt(low, exact, axis=0))
