"""Mel filters, pitch and onsets against librosa: in one file, since it compiles itself anew in each
process of the tests, which takes longer than all comparisons."""

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba.core import config

from model.speech.acoustics import fundamentals, mel_filters, onset_times
from model.speech.audio import load_speech
from tests.model.speech.test_pitch import HIGH, LOW, RATE, SIZE, voice, windows_of

EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("*.wav"))


@pytest.fixture(scope="module")
def librosa(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The library, with the code that it compiles in a folder of this process alone: tests run
    side by side, and its own folder is not for several processes that begin at once."""
    before = config.CACHE_DIR
    config.CACHE_DIR = str(tmp_path_factory.mktemp("numba"))
    import librosa
    import librosa.core.pitch
    import librosa.filters
    import librosa.onset
    import librosa.util.utils

    yield librosa
    config.CACHE_DIR = before


@pytest.mark.parametrize("settings", [(16_000, 512, 64, 50.0), (16_000, 2048, 128, 0.0)])
def test_filters_are_those_of_librosa(librosa, settings):
    rate, size, count, low = settings
    theirs = librosa.filters.mel(sr=rate, n_fft=size, n_mels=count, fmin=low)
    np.testing.assert_allclose(mel_filters(*settings), theirs, atol=1e-8)


@pytest.mark.parametrize("noise", [0.0, 0.1, 1.0, 30.0])
def test_a_glide_in_noise_is_heard_as_librosa_hears_it(librosa, noise):
    waveform = voice(np.linspace(80, 380, 32_000), noise).astype(np.float32)
    ours = fundamentals(windows_of(waveform), RATE, LOW, HIGH)
    theirs = librosa.yin(
        waveform, fmin=LOW, fmax=HIGH, sr=RATE, frame_length=SIZE, hop_length=160, center=False
    )
    # Sums differ in their last figure, which a window in a hundred may show in another dip.
    assert np.mean(np.abs(ours - theirs) < 0.05) > 0.98
    assert np.median(np.abs(ours - theirs)) < 1e-3


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_speech_begins_where_librosa_says(librosa, path):
    waveform = load_speech(path).waveform
    theirs = librosa.onset.onset_detect(y=waveform, sr=16_000, hop_length=512, units="time")
    np.testing.assert_allclose(onset_times(waveform, 16_000), theirs, atol=1e-9)
    assert len(theirs) > 50


@pytest.mark.parametrize("length", [1, 511, 512, 1024, 2047, 2048, 40_000])
def test_noise_of_any_length_begins_where_librosa_says(librosa, length):
    rng = np.random.default_rng(length)
    waveform = rng.normal(0.0, 0.1, length).astype(np.float32)
    waveform *= (np.arange(length) // 3000) % 2  # bursts
    theirs = librosa.onset.onset_detect(y=waveform, sr=16_000, hop_length=512, units="time")
    np.testing.assert_allclose(onset_times(waveform, 16_000), theirs, atol=1e-9)
