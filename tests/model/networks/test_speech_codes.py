"""Accents, as the speech encoder hears them."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from conventions.rates import SAMPLE_RATE
from model.networks.speech_codes import detect_pitch_accents
from model.speech.audio import load_speech
from model.storage.cards import BUNDLED_WEIGHTS

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "three_reasons.wav"


def test_accents_are_heard_where_somebody_speaks():
    speech = load_speech(EXAMPLE)
    accents = detect_pitch_accents(speech, BUNDLED_WEIGHTS)
    assert 0.5 < len(accents) / speech.duration_s < 4
    assert all(after.time_s - before.time_s > 0.1 for before, after in pairwise(accents))
    loud = np.abs(speech.waveform)
    around = [
        loud[max(0, int(SAMPLE_RATE * (a.time_s - 0.1))) : int(SAMPLE_RATE * (a.time_s + 0.1))]
        for a in accents
    ]
    assert np.mean([part.mean() for part in around]) > 1.3 * loud.mean()
    assert all(0 <= accent.strength <= 1 for accent in accents)


def test_without_its_weights_nothing_is_heard(tmp_path):
    assert detect_pitch_accents(load_speech(EXAMPLE), tmp_path) == ()
