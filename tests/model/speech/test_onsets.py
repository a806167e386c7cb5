from pathlib import Path

import numpy as np
import pytest

from model.speech.audio import load_speech
from model.speech.onsets import onset_times

EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("*.wav"))


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


def test_sound_after_silence_is_an_onset_and_silence_has_none():
    waveform = np.zeros(32_000, np.float32)
    assert len(onset_times(waveform, 16_000)) == 0
    waveform[16_000:] = np.random.default_rng(0).normal(0.0, 0.1, 16_000)
    assert abs(onset_times(waveform, 16_000)[0] - 1.0) < 0.07
