"""Mel filters, pitch and onsets: by what is known of them, and against librosa."""

from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest

from model.speech.acoustics import fundamentals, mel_filters, onset_times
from model.speech.audio import load_speech
from tests.helpers import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.wav"))
RATE, SIZE = 16_000, 1024
LOW, HIGH = 60.0, 420.0


def windows_of(waveform: np.ndarray) -> np.ndarray:
    return np.lib.stride_tricks.sliding_window_view(waveform.astype(np.float32), SIZE)[::160]


def voice(hz: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """Five partials over a gliding fundamental."""
    phase = 2 * np.pi * np.cumsum(hz) / RATE
    sound = sum(np.sin(k * phase + k) / k for k in range(1, 6))
    return sound + noise * np.random.default_rng(0).normal(size=len(hz))


def test_a_filter_peaks_at_its_mel_and_has_unit_area():
    filters = mel_filters(16_000, 16_384, 40, 0.0)
    hz_per_bin = 16_000 / 16_384
    np.testing.assert_allclose(filters.sum(1) * hz_per_bin, 1.0, atol=2e-3)
    # 8 kHz are 15 + 27 ln(8) / ln(6.4) = 45.2456 mels, so a filter is 1.10355 mels from the next.
    assert abs(filters[0].argmax() * hz_per_bin - 1.10355 * 200 / 3) < hz_per_bin
    # The highest ends where the 41st mel after it would: 8 kHz; it peaks one filter below.
    peak = 1000 * 6.4 ** ((40 * 1.10355 - 15) / 27)
    assert abs(filters[39].argmax() * hz_per_bin - peak) < 2 * hz_per_bin


def test_a_steady_tone_and_a_glide_have_their_pitch_and_silence_a_number():
    for hz in (80.0, 100.0, 173.2, 250.0, 400.0):
        found = fundamentals(windows_of(voice(np.full(4000, hz))), RATE, LOW, HIGH)
        np.testing.assert_allclose(found, hz, rtol=5e-3)
    glide = np.linspace(80, 380, 32_000)
    found = fundamentals(windows_of(voice(glide)), RATE, LOW, HIGH)
    middles = windows_of(glide)[:, SIZE // 2]
    assert np.median(np.abs(found / middles - 1)) < 0.02
    with np.errstate(all="raise"):
        found = fundamentals(np.zeros((3, SIZE), np.float32), RATE, LOW, HIGH)
    assert np.isfinite(found).all()


def test_sound_after_silence_is_an_onset_and_silence_has_none():
    waveform = np.zeros(32_000, np.float32)
    assert len(onset_times(waveform, RATE)) == 0
    waveform[16_000:] = np.random.default_rng(0).normal(0.0, 0.1, 16_000)
    assert abs(onset_times(waveform, RATE)[0] - 1.0) < 0.07


@pytest.fixture(scope="module")
def librosa(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The library, with the code that it compiles in a folder of this process alone: tests run
    side by side, and its own folder is not for several processes that begin at once."""
    from numba.core import config

    before = config.CACHE_DIR
    config.CACHE_DIR = str(tmp_path_factory.mktemp("numba"))
    import librosa
    import librosa.core.pitch
    import librosa.filters
    import librosa.onset
    import librosa.util.utils

    yield librosa
    config.CACHE_DIR = before


@pytest.mark.slow
def test_filters_and_pitch_are_those_of_librosa(librosa):
    for settings in ((16_000, 512, 64, 50.0), (16_000, 2048, 128, 0.0)):
        rate, size, count, low = settings
        theirs = librosa.filters.mel(sr=rate, n_fft=size, n_mels=count, fmin=low)
        np.testing.assert_allclose(mel_filters(*settings), theirs, atol=1e-8)
    for noise in (0.0, 0.1, 1.0, 30.0):
        waveform = voice(np.linspace(80, 380, 32_000), noise).astype(np.float32)
        ours = fundamentals(windows_of(waveform), RATE, LOW, HIGH)
        theirs = librosa.yin(
            waveform, fmin=LOW, fmax=HIGH, sr=RATE, frame_length=SIZE, hop_length=160, center=False
        )
        # Sums differ in their last figure, which a window in a hundred may show in another dip.
        assert np.mean(np.abs(ours - theirs) < 0.05) > 0.98
        assert np.median(np.abs(ours - theirs)) < 1e-3


@pytest.mark.slow
def test_speech_and_noise_of_any_length_begin_where_librosa_says(librosa):
    waveforms = [load_speech(path).waveform for path in EXAMPLES]
    for length in (1, 511, 512, 1024, 2047, 2048, 40_000):
        bursts = np.random.default_rng(length).normal(0.0, 0.1, length).astype(np.float32)
        waveforms.append(bursts * ((np.arange(length) // 3000) % 2).astype(np.float32))
    for waveform in waveforms:
        theirs = librosa.onset.onset_detect(y=waveform, sr=RATE, hop_length=512, units="time")
        np.testing.assert_allclose(onset_times(waveform, RATE), theirs, atol=1e-9)
