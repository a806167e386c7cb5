"""Triangular filters that are evenly spaced in mel: Slaney's scale, each filter of unit area.

The scale is linear up to 1 kHz (200/3 Hz a mel) and logarithmic above it (27 mels from 1 to 6.4
kHz), as in Slaney, *Auditory Toolbox*, 1998.
"""

import functools

import numpy as np
from jaxtyping import Float32, Float64

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
