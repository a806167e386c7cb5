"""The fundamental of each window of sound by YIN (de Cheveigne and Kawahara, JASA 2002).

A window is compared with itself, later by a lag; the least lag at which the difference is small
against its mean over all smaller lags (equation 8 there) is the period, refined by a parabola.
"""

import numpy as np
from jaxtyping import Float, Float32, Float64, Int
from scipy import fft

TROUGH = 0.1
"""Below this a dip of the normalised difference is a period; without one, the deepest is."""


def fundamentals(
    windows: Float32[np.ndarray, "N size"], sample_rate: int, lowest_hz: float, highest_hz: float
) -> Float64[np.ndarray, " N"]:
    """The fundamental of each window in Hz, whether there is one or not."""
    size = windows.shape[1]
    first = int(sample_rate / highest_hz)
    last = min(int(np.ceil(sample_rate / lowest_hz)), size - 1)
    difference = _normalised_difference(windows, last)[:, first - 1 :]
    period = _first_trough(difference)
    return sample_rate / (first + period + _parabola(difference, period))


def _normalised_difference(
    windows: Float32[np.ndarray, "N size"], last: int
) -> Float32[np.ndarray, "N last"]:
    """Of lags 1 to ``last``: the squared difference over its mean up to that lag.

    What slides out in front is taken off the energy; what is missing at the end is not, so that
    larger lags count as more different (librosa's choice, to which the bundled weights are used).
    """
    length = fft.next_fast_len(2 * windows.shape[1] - 1, real=True)
    spectrum = np.asarray(fft.rfft(windows, length, axis=1), np.complex64)
    power = spectrum.real**2 + spectrum.imag**2
    correlation = np.asarray(fft.irfft(power, length, axis=1))[:, : last + 1]
    slid_out = np.cumsum(windows[:, :last] ** 2, axis=1)
    difference = 2 * (correlation[:, :1] - correlation[:, 1:]) - slid_out
    mean = np.cumsum(difference, axis=1) / np.arange(1, last + 1, dtype=np.float32)
    return difference / (mean + np.finfo(np.float32).tiny)


def _first_trough(difference: Float[np.ndarray, "N lags"]) -> Int[np.ndarray, " N"]:
    """Index of the first dip below `TROUGH`, or of the least of all."""
    before = np.pad(difference, ((0, 0), (1, 0)), constant_values=np.inf)[:, :-1]
    after = np.pad(difference, ((0, 0), (0, 1)), mode="edge")[:, 1:]
    is_dip = (difference < before) & (difference <= after) & (difference < TROUGH)
    is_dip[:, 0] &= difference[:, 0] < after[:, 0]
    is_dip[:, -1] = False
    return np.where(is_dip.any(axis=1), is_dip.argmax(axis=1), difference.argmin(axis=1))


def _parabola(
    difference: Float[np.ndarray, "N lags"], index: Int[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """Where between its neighbours the dip lies, in lags; 0 at the ends and where it is no dip."""
    middle = np.clip(index, 1, difference.shape[1] - 2)
    rows = np.arange(len(difference))
    left, at, right = (difference[rows, middle + step] for step in (-1, 0, 1))
    bend = left + right - 2 * at
    slope = (right - left) / 2
    is_inside = (middle == index) & (np.abs(slope) < np.abs(bend))
    return np.where(is_inside, -slope / np.where(is_inside, bend, 1.0), 0.0)
