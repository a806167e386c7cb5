"""Gestures belong to what is stressed: the sound tells when the hands move, and how far."""

import numpy as np
import pytest

from conventions.rates import SAMPLE_RATE
from tools.corpus.gesture.plan import Plan, make_plan
from tools.corpus.people.rig import SIDES
from tools.corpus.people.speaker import SPEAKERS
from tools.corpus.words.prosody import Phrase, Utterance, Word

WORD_S = 0.5
BEN = next(speaker for speaker in SPEAKERS if speaker.name == "ben")


def spoken(accents: list[float]) -> Utterance:
    """One phrase of words of half a second; each begins with its stressed vowel."""
    words = tuple(
        Word("lamp", 0.5 + k * WORD_S, 0.5 + (k + 1) * WORD_S, 0.5 + k * WORD_S, 0, accent)
        for k, accent in enumerate(accents)
    )
    phrase = Phrase(range(len(words)), words[0].start_s, words[-1].end_s, True)
    waveform = np.zeros(round((words[-1].end_s + 1.0) * SAMPLE_RATE))
    return Utterance(waveform, (), words, (phrase,))


def plan(accents: list[float], seed: int) -> Plan:
    return make_plan(spoken(accents), BEN, np.random.default_rng(seed))


def test_unstressed_words_bring_no_gesture_and_no_beat():
    for seed in range(10):
        keys = plan([0.0] * 12, seed).keys
        assert not {key.phase for side in SIDES for key in keys[side]} & {"stroke", "beat"}


def test_every_stressed_chunk_brings_a_stroke_on_its_stressed_vowel():
    for seed in range(10):
        keys = plan([0.0, 0.0, 1.0, 0.0], seed).keys
        apexes = [key.arrive_s for side in SIDES for key in keys[side] if key.phase == "stroke"]
        assert any(abs(apex - 1.5) < 0.15 for apex in apexes), (seed, apexes)


@pytest.mark.parametrize("phase", ["beat", "stroke"])
def test_hands_travel_further_for_stronger_accents(phase):
    def travel(accent: float) -> float:
        steps = []
        for seed in range(40):
            keys = plan([0.0, accent] * 8, seed).keys
            for side in SIDES:
                for before, after in zip(keys[side][:-1], keys[side][1:], strict=True):
                    if after.phase == phase:
                        step = after.pose.position - before.pose.position
                        steps.append(np.linalg.norm(step))
        return float(np.mean(steps))

    assert travel(1.2) > 1.06 * travel(0.7)
