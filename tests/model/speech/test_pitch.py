import numpy as np
import pytest

from model.speech.acoustics import fundamentals

RATE, SIZE = 16_000, 1024
LOW, HIGH = 60.0, 420.0


def windows_of(waveform: np.ndarray) -> np.ndarray:
    return np.lib.stride_tricks.sliding_window_view(waveform.astype(np.float32), SIZE)[::160]


def voice(hz: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """Five partials over a gliding fundamental."""
    phase = 2 * np.pi * np.cumsum(hz) / RATE
    sound = sum(np.sin(k * phase + k) / k for k in range(1, 6))
    return sound + noise * np.random.default_rng(0).normal(size=len(hz))


@pytest.mark.parametrize("hz", [80.0, 100.0, 173.2, 250.0, 400.0])
def test_a_steady_tone_has_its_pitch(hz):
    found = fundamentals(windows_of(voice(np.full(8000, hz))), RATE, LOW, HIGH)
    np.testing.assert_allclose(found, hz, rtol=5e-3)


def test_silence_has_a_number_and_no_warning():
    with np.errstate(all="raise"):
        found = fundamentals(np.zeros((3, SIZE), np.float32), RATE, LOW, HIGH)
    assert np.isfinite(found).all()
