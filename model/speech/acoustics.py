"""What sound is made of, as librosa hears it: mel bands, pitch, and when sounds begin."""

import functools

import numpy as np
from jaxtyping import Float, Float32, Float64

from model.speech.prepared_librosa import librosa

ONSET_HOP = 512
"""Samples a step, by which BeatAlign is defined."""


@functools.cache
def mel_filters(
    sample_rate: int, fft_size: int, num_mels: int, lowest_hz: float
) -> Float32[np.ndarray, "mels bins"]:
    """Weights of the ``fft_size // 2 + 1`` powers of a spectrum in each mel power."""
    return librosa().filters.mel(sr=sample_rate, n_fft=fft_size, n_mels=num_mels, fmin=lowest_hz)


def mel_powers(
    waveform: Float32[np.ndarray, " N"],
    sample_rate: int,
    *,
    window: Float32[np.ndarray, " window"],
    fft_size: int,
    hop: int,
    num_mels: int,
    lowest_hz: float,
) -> tuple[Float32[np.ndarray, "hops mels"], Float32[np.ndarray, " hops"]]:
    """Power in mel bands (Slaney's scale), and in all of the spectrum, of windows that lie in the
    middle of ``fft_size`` samples, the first of which begin with the waveform."""
    library = librosa()
    spectrum = library.stft(
        waveform,
        n_fft=fft_size,
        hop_length=hop,
        win_length=len(window),
        window=window,
        center=False,
    )
    power = np.abs(spectrum) ** 2
    mels = library.feature.melspectrogram(
        S=power, sr=sample_rate, n_fft=fft_size, n_mels=num_mels, fmin=lowest_hz
    )
    return mels.T, power.sum(axis=0)


def fundamentals(
    waveform: Float32[np.ndarray, " N"],
    sample_rate: int,
    *,
    window: int,
    hop: int,
    range_hz: tuple[float, float],
) -> Float64[np.ndarray, " hops"]:
    """The fundamental in Hz of each window, whether there is one or not (YIN, de Cheveigne and
    Kawahara, JASA 2002)."""
    low, high = range_hz
    return librosa().yin(
        waveform, fmin=low, fmax=high, sr=sample_rate,
        frame_length=window, hop_length=hop, center=False,
    )  # fmt: skip


def onset_times(
    waveform: Float32[np.ndarray, " N"], sample_rate: int
) -> Float[np.ndarray, " onsets"]:
    """Times in seconds at which sounds begin; none in silence."""
    return librosa().onset.onset_detect(
        y=waveform, sr=sample_rate, hop_length=ONSET_HOP, units="time"
    )
