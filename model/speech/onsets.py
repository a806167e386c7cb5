"""When sounds begin: peaks of the spectral flux, with the settings of librosa's ``onset_detect``.

BeatAlign is defined by these onsets (512 samples a step), so a paper's numbers ask for the same:
the flux is the mean rise of 128 mel powers in dB from one step to the next (Boeck and Widmer,
DAFx 2013, without its filter), scaled to 0 to 1; a peak is the largest in its surroundings and
stands out of their mean.
"""

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy import fft

from model.speech.mel import mel_filters

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
