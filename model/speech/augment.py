"""Augmentation of speech waveforms: speed, room, noise, band limits and gain.

Pure functions of a 16 kHz mono waveform. `apply_recording_conditions` applies room, noise and
microphone in this order. Only `perturb_speed` changes the timing; after the others, the
motion still fits the speech.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32
from scipy.signal import butter, fftconvolve, resample_poly, sosfiltfilt

from conventions.rates import SAMPLE_RATE

Waveform = Float32[np.ndarray, " _"]

TELEPHONE_HZ = (300.0, 3400.0)
LAPTOP_HZ = (150.0, 6500.0)
REFLECTIONS_AFTER_S = 0.003  # a metre further than the direct sound


@dataclass(frozen=True)
class RecordingConditions:
    """Conditions of a recording; None leaves a step out."""

    rt60_s: float | None
    """Reverberation time in which the room's sound falls by 60 dB (s)."""
    direct_to_reverberant_db: float
    snr_db: float | None
    noise_slope_db: float
    """Slope of the noise (dB per octave): 0 is white, -3 pink, -6 brown."""
    band_hz: tuple[float, float] | None
    gain_db: float


def sample_recording_conditions(rng: np.random.Generator) -> RecordingConditions:
    """Sample conditions, from a good headset to a telephone in a bathroom; 1 in 16 is clean."""
    bands = (None, None, LAPTOP_HZ, TELEPHONE_HZ)
    has_room, has_noise = rng.random(2) < (0.5, 0.75)
    return RecordingConditions(
        rt60_s=rng.uniform(0.15, 0.7) if has_room else None,
        direct_to_reverberant_db=rng.uniform(0.0, 12.0),
        snr_db=rng.uniform(8.0, 35.0) if has_noise else None,
        noise_slope_db=rng.uniform(-6.0, 0.0),
        band_hz=bands[rng.integers(len(bands))],
        gain_db=rng.uniform(-20.0, 6.0),
    )


def apply_recording_conditions(
    waveform: Waveform, recording: RecordingConditions, rng: np.random.Generator
) -> Waveform:
    """Simulate room, noise, band and gain of a recording; the timing does not change."""
    if recording.rt60_s is not None:
        waveform = add_reverberation(
            waveform, recording.rt60_s, recording.direct_to_reverberant_db, rng
        )
    if recording.snr_db is not None:
        waveform = add_noise(waveform, recording.snr_db, recording.noise_slope_db, rng)
    if recording.band_hz is not None:
        waveform = band_pass(waveform, *recording.band_hz)
    return apply_gain(waveform, recording.gain_db)


def perturb_speed(waveform: Waveform, speed: float) -> Waveform:
    """Resample to play ``speed`` times as fast, and higher in pitch; ``speed`` in hundredths."""
    return resample_poly(waveform, 100, round(100 * speed)).astype(np.float32)


def apply_gain(waveform: Waveform, gain_db: float) -> Waveform:
    """Scale the waveform; what exceeds full scale is clipped, as in a microphone."""
    return np.clip(waveform * 10 ** (gain_db / 20), -1.0, 1.0).astype(np.float32)


def add_noise(
    waveform: Waveform, snr_db: float, slope_db: float, rng: np.random.Generator
) -> Waveform:
    """Add noise, ``slope_db`` per octave; the ratio is of the whole waveform's power to it."""
    size = len(waveform)
    spectrum = np.fft.rfft(rng.standard_normal(size))
    frequency = np.maximum(np.fft.rfftfreq(size, 1 / SAMPLE_RATE), 20.0)  # flat under 20 Hz
    noise = np.fft.irfft(spectrum * 10 ** (slope_db / 20 * np.log2(frequency / 1000.0)), size)
    wanted = _power(waveform) * 10 ** (-snr_db / 10)
    return (waveform + noise * math.sqrt(wanted / max(_power(noise), 1e-30))).astype(np.float32)


def impulse_response(
    rt60_s: float, direct_to_reverberant_db: float, rng: np.random.Generator
) -> Float[np.ndarray, " N"]:
    """Make a direct sound of 1 and exponentially decaying noise (Polack's model of a room)."""
    time_s = np.arange(round(rt60_s * SAMPLE_RATE)) / SAMPLE_RATE
    tail = rng.standard_normal(len(time_s)) * 10 ** (-3 * time_s / rt60_s)
    tail[time_s < REFLECTIONS_AFTER_S] = 0.0
    tail *= math.sqrt(10 ** (-direct_to_reverberant_db / 10) / np.square(tail).sum())
    tail[0] = 1.0
    return tail


def add_reverberation(
    waveform: Waveform, rt60_s: float, direct_to_reverberant_db: float, rng: np.random.Generator
) -> Waveform:
    """Convolve with a room's response; duration and the time of the direct sound are unchanged."""
    response = impulse_response(rt60_s, direct_to_reverberant_db, rng)
    return fftconvolve(waveform, response)[: len(waveform)].astype(np.float32)


def band_pass(waveform: Waveform, low_hz: float, high_hz: float) -> Waveform:
    """Filter with a zero-phase band-pass of fourth order, which causes no delay."""
    sections = butter(4, (low_hz, high_hz), "bandpass", fs=SAMPLE_RATE, output="sos")
    return sosfiltfilt(sections, waveform).astype(np.float32)


def _power(waveform: Float[np.ndarray, " N"]) -> float:
    return float(np.mean(np.square(waveform, dtype=np.float64)))
