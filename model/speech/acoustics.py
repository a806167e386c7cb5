"""What sound is made of: mel bands, pitch, and the moments at which sounds begin.

Mel: the scale is linear up to 1 kHz (200/3 Hz a mel) and logarithmic above it (27 mels from 1 to
6.4 kHz), as in Slaney, *Auditory Toolbox*, 1998.

Pitch is that of YIN (de Cheveigne and Kawahara, JASA 2002): a window is compared with itself, later
by a lag; the least lag at which the difference is small against its mean over all smaller lags
(equation 8 there) is the period, refined by a parabola.

Onsets are those of librosa's ``onset_detect``. BeatAlign is defined by them (512 samples a step),
so a paper's numbers ask for the same: the flux is the mean rise of 128 mel powers in dB from one
step to the next (Boeck and Widmer, DAFx 2013, without its filter), scaled to 0 to 1; a peak is the
largest in its surroundings and stands out of their mean.
"""

import functools

import numpy as np
from jaxtyping import Float, Float32, Float64, Int
from scipy import fft

_HZ_PER_MEL = 200.0 / 3.0
_CORNER_HZ = 1000.0
_CORNER_MEL = _CORNER_HZ / _HZ_PER_MEL
_LOG_STEP = np.log(6.4) / 27.0


@functools.cache
def mel_filters(
    sample_rate: int, fft_size: int, num_mels: int, lowest_hz: float
) -> Float32[np.ndarray, "mels bins"]:
    """Weights of the ``fft_size // 2 + 1`` powers of a spectrum in each mel power, up to half the
    sample rate."""
    mels = np.linspace(_to_mel(lowest_hz), _to_mel(sample_rate / 2), num_mels + 2)
    edges = _to_hz(mels)[:, None]
    bins = np.arange(fft_size // 2 + 1) * (sample_rate / fft_size)
    rising = (bins - edges[:-2]) / (edges[1:-1] - edges[:-2])
    falling = (edges[2:] - bins) / (edges[2:] - edges[1:-1])
    area = (edges[2:] - edges[:-2]) / 2
    return (np.clip(np.minimum(rising, falling), 0.0, None) / area).astype(np.float32)


def _to_mel(hz: float) -> float:
    if hz < _CORNER_HZ:
        return hz / _HZ_PER_MEL
    return _CORNER_MEL + np.log(hz / _CORNER_HZ) / _LOG_STEP


def _to_hz(mels: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    logarithmic = _CORNER_HZ * np.exp(_LOG_STEP * np.maximum(mels - _CORNER_MEL, 0.0))
    return np.where(mels < _CORNER_MEL, mels * _HZ_PER_MEL, logarithmic)


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


HOP = 512
FFT_SIZE = 2048
NUM_MELS = 128
DYNAMIC_DB = 80.0
STANDS_OUT = 0.07
BLOCK = 1000
"""Steps whose spectra are in memory at once."""


def onset_times(
    waveform: Float32[np.ndarray, " N"], sample_rate: int
) -> Float[np.ndarray, " onsets"]:
    """Times in seconds at which sounds begin; none in silence."""
    flux = _spectral_flux(waveform, sample_rate)
    flux = flux - flux.min()
    loudest = flux.max()
    if not (np.isfinite(loudest) and loudest > 0.0):
        return np.zeros(0)
    steps_per_s = sample_rate / HOP
    peaks = _peaks(
        flux / loudest,
        before=int(np.ceil(0.03 * sample_rate // HOP)),
        mean_before=int(np.ceil(0.10 * sample_rate // HOP)),
        mean_after=int(np.ceil(0.10 * sample_rate // HOP + 1)),
        pause=int(np.ceil(0.03 * sample_rate // HOP)),
    )
    return peaks / steps_per_s


def _spectral_flux(
    waveform: Float32[np.ndarray, " N"], sample_rate: int
) -> Float[np.ndarray, " steps"]:
    """Of each step, whose window of `FFT_SIZE` is told half a window later, when it is complete."""
    decibel = _mel_decibel(waveform, sample_rate)
    rise = np.maximum(np.diff(decibel, axis=0), 0.0).mean(axis=1)
    late = np.zeros(1 + FFT_SIZE // (2 * HOP), rise.dtype)
    return np.concatenate([late, rise])[: len(decibel)]


def _mel_decibel(
    waveform: Float32[np.ndarray, " N"], sample_rate: int
) -> Float32[np.ndarray, "steps mels"]:
    """Mel powers of windows centred on every step, silence outside; `DYNAMIC_DB` down at most."""
    padded = np.pad(waveform, FFT_SIZE // 2)
    windows = np.lib.stride_tricks.sliding_window_view(padded, FFT_SIZE)[::HOP]
    angle = 2 * np.pi * np.arange(FFT_SIZE) / FFT_SIZE
    taper = (0.5 - 0.5 * np.cos(angle)).astype(np.float32)
    filters = mel_filters(sample_rate, FFT_SIZE, NUM_MELS, 0.0)
    power = np.empty((len(windows), NUM_MELS), np.float32)
    for start in range(0, len(windows), BLOCK):
        seen = windows[start : start + BLOCK] * taper
        spectrum = np.asarray(fft.rfft(seen, axis=1), np.complex64)
        power[start : start + BLOCK] = (spectrum.real**2 + spectrum.imag**2) @ filters.T
    decibel = 10.0 * np.log10(np.maximum(power, 1e-10))
    return np.maximum(decibel, decibel.max() - DYNAMIC_DB)


def _peaks(
    flux: Float[np.ndarray, " steps"], before: int, mean_before: int, mean_after: int, pause: int
) -> Int[np.ndarray, " peaks"]:
    """Steps that no one of the ``before`` steps ahead of them exceeds and that stand out of the
    mean from ``mean_before`` ahead to ``mean_after - 1`` behind, with a pause after each."""
    ahead = np.pad(flux, (before, 0), constant_values=-np.inf)
    largest = np.lib.stride_tricks.sliding_window_view(ahead, before + 1).max(axis=1)
    sums = np.concatenate([[0.0], np.cumsum(flux, dtype=np.float64)])
    step = np.arange(len(flux))
    first, stop = np.maximum(step - mean_before, 0), np.minimum(step + mean_after, len(flux))
    mean = (sums[stop] - sums[first]) / (stop - first)
    found: list[int] = []
    for candidate in np.flatnonzero((flux >= largest) & (flux >= mean + STANDS_OUT)):
        if not found or candidate > found[-1] + pause:
            found.append(int(candidate))
    return np.array(found, dtype=int)
