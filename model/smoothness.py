"""Measures of smoothness of points over time, as pure functions of positions in metres at 30 fps.

A measure that a clip is too short to have, or that would be 0 / 0, is NaN.
"""

import numpy as np
from jaxtyping import Float
from scipy.signal import welch

from model.timing import FPS

WELCH_FRAMES = 128
MIN_SPECTRUM_FRAMES = 32
"""About a second: fewer frames cannot tell 5 Hz from what lies below it."""
GROUND_PERCENTILE = 5.0
STILL_M_S3 = 1e-6
"""Jerk of rounding errors: below it nothing moves, and a ratio means nothing."""
CONTACT_HEIGHT_M = 0.05


def derivative_magnitudes(
    positions: Float[np.ndarray, " T *points 3"], order: int
) -> Float[np.ndarray, " entries *points"]:
    """Length of the ``order``-th difference per unit time: m/s, m/s^2, m/s^3 for 1, 2, 3.

    Entry i comes from frames i to i + order. Shorter clips give no entries.
    """
    differences = np.diff(positions.astype(np.float64), n=order, axis=0) * float(FPS) ** order
    return np.linalg.norm(differences, axis=-1)


def mean_over_time(values: Float[np.ndarray, " T *points"]) -> Float[np.ndarray, " *points"]:
    """Mean of the first axis; NaN where there are no frames."""
    return np.asarray(values.mean(axis=0)) if len(values) else np.full(values.shape[1:], np.nan)


def velocity_power_above(positions: Float[np.ndarray, "T 3"], hertz: float) -> float:
    """Share, 0 to 1, of a point's velocity power that lies above ``hertz``.

    Welch's spectrum (Hann, 128 frames, half overlapping, mean removed), summed over the axes. NaN
    for fewer than 32 frames of velocity and for a point that does not move.
    """
    velocity = np.diff(positions.astype(np.float64), axis=0) * FPS
    if len(velocity) < MIN_SPECTRUM_FRAMES:
        return float("nan")
    frequency, power = welch(velocity, fs=FPS, nperseg=min(WELCH_FRAMES, len(velocity)), axis=0)
    total = power.sum()
    return float(power[frequency > hertz].sum() / total) if total > 0 else float("nan")


def joins_of(num_frames: int, window_advance: int) -> list[int]:
    """First frame of every window but the first; the frames that two windows share start there."""
    return list(range(window_advance, num_frames, window_advance))


def seam_jerk_ratio(
    positions: Float[np.ndarray, "T points 3"], window_advance: int, overlap: int
) -> float:
    """Peak jerk around the joins of windows over peak jerk of equally long stretches elsewhere.

    1 says that joins cannot be told from the rest. Peaks of the jerk averaged over points are
    compared, and a join's stretch holds every third difference that touches frames ``join - 1`` to
    ``join + overlap``: a pop shows wherever in the shared frames it sits. NaN without a whole join
    or without a stretch clear of joins.
    """
    jerk = derivative_magnitudes(positions, 3).mean(axis=1)  # entry i: frames i to i + 3
    stretch = overlap + 5
    is_interior = np.ones(len(jerk), dtype=bool)
    seam_peaks = []
    for join in joins_of(len(positions), window_advance):
        first = join - 4
        is_interior[max(0, first) : first + stretch] = False
        if first >= 0 and first + stretch <= len(jerk):
            seam_peaks.append(jerk[first : first + stretch].max())
    interior_peaks = [
        jerk[start : start + stretch].max()
        for start in range(len(jerk) - stretch + 1)
        if is_interior[start : start + stretch].all()
    ]
    if not seam_peaks or not interior_peaks or np.mean(interior_peaks) < STILL_M_S3:
        return float("nan")
    return float(np.mean(seam_peaks) / np.mean(interior_peaks))


def jerk_by_window_phase(
    positions: Float[np.ndarray, "T points 3"], window_advance: int
) -> Float[np.ndarray, " window_advance"]:
    """Mean jerk of all points at each place of a window, m/s^3; a pop at any offset stands out.

    A third difference over frames i to i + 3 is counted at frame i + 2, the first frame after its
    middle: a jump between frames f - 1 and f is highest at phase f. NaN where the clip has none.
    """
    jerk = derivative_magnitudes(positions, 3).mean(axis=1)
    phase = (np.arange(len(jerk)) + 2) % window_advance
    count = np.bincount(phase, minlength=window_advance)
    total = np.bincount(phase, weights=jerk, minlength=window_advance)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def foot_slide(feet: Float[np.ndarray, "T feet 3"]) -> float:
    """Mean horizontal speed in m/s of feet on the ground.

    The ground is the 5th percentile of the lowest foot's height, so that one bad frame does not
    move it; a foot is on it while it stays below 5 cm above it over both frames of a step. NaN for
    one frame, or when no foot stays down.
    """
    feet = feet.astype(np.float64)
    if len(feet) < 2:
        return float("nan")
    height = feet[..., 1] - np.percentile(feet[..., 1].min(axis=1), GROUND_PERCENTILE)
    is_down = (height[1:] < CONTACT_HEIGHT_M) & (height[:-1] < CONTACT_HEIGHT_M)
    speed = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1) * FPS
    return float(speed[is_down].mean()) if is_down.any() else float("nan")
