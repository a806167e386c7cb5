"""Do the joins of generated windows show? Jerk folded on the window period."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from model.measures.seams.periods import (
    MIN_PERIODS,
    Period,
    by_phase,
    chance_of_pulses,
    part_jerk_by_phase,
)
from model.measures.smoothness import STILL_M_S3, derivative_magnitudes
from model.motion.tracks import Tracks


@dataclass(frozen=True)
class Windows:
    """How a system cuts time, in frames."""

    advance: int
    """From the start of one window to the start of the next."""
    overlap: int
    """Shared by two windows."""

    def __post_init__(self) -> None:
        if self.advance < 2 or not 0 <= self.overlap <= self.advance:
            raise ValueError(
                f"Windows must start at least 2 frames apart and share no more than that; got"
                f" {self.advance} and {self.overlap}."
            )


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
    return by_phase(derivative_magnitudes(positions, 3).mean(axis=1), window_advance)


@dataclass(frozen=True)
class RecurringJerk:
    """The frame of a window at which the body jerks most, window after window."""

    phase_frame: int | None
    """None where there are too few windows."""
    windows: int
    """Whole windows that the medians are over."""
    ratio: float
    """Median over windows of the jerk at that frame, over the median of all frames."""
    chance: float = 1.0
    """Probability that jerk without a period stands out so at some frame of the window."""


def recurring_jerk(
    positions: Float[np.ndarray, "T points 3"], window_advance: int
) -> RecurringJerk:
    """What `jerk_by_window_phase` peaks at, by medians, so that no single jump can do it.

    NaN under 4 whole windows, and where nothing moves.
    """
    jerk = derivative_magnitudes(positions, 3).mean(axis=1)
    chance = chance_of_pulses(jerk, window_advance)
    jerk = np.concatenate([np.full(2, np.nan), jerk])  # entry f: differences over f - 2 to f + 1
    num_windows = len(jerk) // window_advance
    if num_windows < MIN_PERIODS:
        return RecurringJerk(None, num_windows, float("nan"))
    windows = jerk[: num_windows * window_advance].reshape(num_windows, window_advance)
    medians = np.nanmedian(windows, axis=0)
    usual = float(np.median(medians))
    if usual < STILL_M_S3:
        return RecurringJerk(None, num_windows, float("nan"))
    phase = int(medians.argmax())
    return RecurringJerk(phase, num_windows, float(medians[phase] / usual), chance)


@dataclass(frozen=True)
class SeamMeasures:
    """Of the joins of windows, or of the period that was found where no windows are known."""

    seam_jerk_ratio: float
    jerk_by_window_phase_m_s3: Float[np.ndarray, " window_advance"]
    """Empty where there are neither windows nor a period."""
    recurring_jerk: RecurringJerk
    folded_on_frames: int | None = None
    """From one window, or period, to the next."""
    period: Period | None = None
    """Found in the raw motion, whether or not windows are known."""


def seam_measures(tracks: Tracks, windows: Windows | None, period: Period | None) -> SeamMeasures:
    """Folded on the windows, or else on the period; a period may start anywhere, so that joins are
    looked for in windows only."""
    if windows is not None:
        return SeamMeasures(
            seam_jerk_ratio(tracks.joints, windows.advance, windows.overlap),
            jerk_by_window_phase(tracks.joints, windows.advance),
            recurring_jerk(tracks.joints, windows.advance),
            windows.advance,
            period,
        )
    unknown = RecurringJerk(None, 0, math.nan)
    if period is None:
        return SeamMeasures(math.nan, np.empty(0), unknown)
    folded = part_jerk_by_phase(tracks, period.part, period.frames)
    return SeamMeasures(math.nan, folded, unknown, period.frames, period)
