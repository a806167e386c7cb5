import numpy as np

from model.speech.acoustics import onset_times


def test_sound_after_silence_is_an_onset_and_silence_has_none():
    waveform = np.zeros(32_000, np.float32)
    assert len(onset_times(waveform, 16_000)) == 0
    waveform[16_000:] = np.random.default_rng(0).normal(0.0, 0.1, 16_000)
    assert abs(onset_times(waveform, 16_000)[0] - 1.0) < 0.07
