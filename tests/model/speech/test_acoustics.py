"""Mel bands, pitch and onsets, by what is known of them and as the bundled weights heard them."""

import numpy as np
import pytest

from model.speech.acoustics import fundamentals, mel_powers, onset_times
from model.speech.audio import load_speech
from model.speech.features import MelEncoder
from tests.helpers import ROOT

RATE = 16_000
HEARD = np.load(ROOT / "tests" / "model" / "speech" / "heard.npz")
"""Of seconds 3 to 5 of an example, by the code with which the bundled weights were trained."""


def voice(hz: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """Five partials over a gliding fundamental."""
    phase = 2 * np.pi * np.cumsum(hz) / RATE
    sound = sum(np.sin(k * phase + k) / k for k in range(1, 6))
    return sound + noise * np.random.default_rng(0).normal(size=len(hz))


def pitch(waveform: np.ndarray) -> np.ndarray:
    sound = waveform.astype(np.float32)
    return fundamentals(sound, RATE, window=1024, hop=160, range_hz=(60.0, 420.0))


def test_features_are_those_that_the_bundled_weights_were_trained_with():
    speech = load_speech(ROOT / "examples" / "three_reasons.wav")
    features = MelEncoder().encode(speech.waveform, speech.num_frames)
    np.testing.assert_allclose(features[90:150], HEARD["features"], atol=1e-4)
    np.testing.assert_allclose(onset_times(speech.waveform, RATE)[:40], HEARD["onsets_s"])


@pytest.mark.parametrize("hz", [300.0, 700.0, 1000.0, 2000.0, 5000.0])
def test_a_tone_is_loudest_in_the_band_of_its_mel(hz):
    """Linear up to 1 kHz (200 / 3 Hz a mel), then 27 mels from 1 to 6.4 kHz (Slaney 1998)."""
    tone = np.sin(2 * np.pi * hz * np.arange(RATE) / RATE).astype(np.float32)
    window = np.hanning(400).astype(np.float32)
    mels, power = mel_powers(
        tone, RATE, window=window, fft_size=2048, hop=160, num_mels=40, lowest_hz=0.0
    )
    mel = hz * 3 / 200 if hz <= 1000 else 15 + 27 * np.log(hz / 1000) / np.log(6.4)
    # 8 kHz are 45.2456 mels, so the middles of 40 bands are 1.10355 apart.
    assert abs(mels[20].argmax() - (mel / 1.10355 - 1)) < 0.6
    # Parseval, of half the spectrum: the energy of the windowed tone.
    at = 20 * 160 + (2048 - 400) // 2
    energy = np.square(tone[at : at + 400] * window).sum()
    assert power[20] == pytest.approx(2048 * energy / 2, rel=1e-3)


def test_a_steady_tone_and_a_glide_have_their_pitch_and_silence_a_number():
    for hz in (80.0, 100.0, 173.2, 250.0, 400.0):
        np.testing.assert_allclose(pitch(voice(np.full(4000, hz))), hz, rtol=5e-3)
    glide = np.linspace(80, 380, 32_000)
    found = pitch(voice(glide))
    assert np.median(np.abs(found / glide[512::160][: len(found)] - 1)) < 0.02
    with np.errstate(all="raise"):
        assert np.isfinite(pitch(np.zeros(3 * 1024))).all()


def test_sound_after_silence_is_an_onset_and_silence_has_none():
    waveform = np.zeros(32_000, np.float32)
    assert len(onset_times(waveform, RATE)) == 0
    waveform[16_000:] = np.random.default_rng(0).normal(0.0, 0.1, 16_000)
    assert abs(onset_times(waveform, RATE)[0] - 1.0) < 0.07
