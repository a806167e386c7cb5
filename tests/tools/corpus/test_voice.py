"""Speech by flite: exact times, words found, and sentences for what goes wrong."""

from itertools import pairwise

import numpy as np
import pytest

from conventions.rates import SAMPLE_RATE
from tools.corpus.people.speaker import (
    PAUSE,
    SPEAKERS,
    FliteVoice,
    Phone,
    VoiceError,
    align,
    pronounce,
    synthesise,
    words_of,
)
from tools.corpus.words.prosody import synthesise_utterance

VOICE = FliteVoice("slt", 178.0, 26.0)
SENTENCE = "Honestly, the whole project is really important."


def test_stress_marks_one_vowel_and_words_keep_their_apostrophes(flite):
    assert [name for name, stress in pronounce("amazing") if stress] == ["ey"]
    assert words_of("I don't know, OK?") == ["i", "don't", "know", "ok"]


def test_phones_tile_the_sentence_and_every_word_is_found_in_order(flite):
    waveform, phones = synthesise(SENTENCE, VOICE)
    assert phones[0].start_s == 0.0
    for before, after in pairwise(phones):
        assert before.end_s == after.start_s < after.end_s
    assert abs(phones[-1].end_s - len(waveform) / SAMPLE_RATE) < 0.05
    numbers = [p.word for p in phones if p.name != PAUSE]
    assert numbers == sorted(numbers)
    assert set(numbers) == set(range(len(words_of(SENTENCE))))
    assert {p.word for p in phones if p.name == PAUSE} <= {-1}


def test_alignment_gives_a_joined_sound_to_one_of_its_words(flite):
    spoken = [Phone(n, float(k), k + 1.0) for k, n in enumerate("ih z ih t".split())]
    assert [p.word for p in align(["is", "it"], spoken)] == [0, 0, 1, 1]
    # One "s" where "this" and "sun" bring two.
    spoken = [Phone(n, float(k), k + 1.0) for k, n in enumerate("dh ih s ah n".split())]
    words = [p.word for p in align(["this", "sun"], spoken)]
    assert words[:2] == [0, 0]
    assert words[3:] == [1, 1]
    assert words[2] in (0, 1)


def test_a_sentence_without_sound_is_refused(flite):
    with pytest.raises(VoiceError, match="found no words to speak"):
        synthesise("...", VOICE)


def test_every_speaker_has_a_voice_within_range(flite):
    for speaker in SPEAKERS:
        utterance = synthesise_utterance(speaker, 2.0, "train", *np.random.default_rng(0).spawn(2))
        first, last = utterance.words[0], utterance.words[-1]
        assert last.sentence == 0 and len(utterance.words) > 3
        assert 0.15 < (last.end_s - first.start_s) / len(utterance.words) < 0.7, speaker.name
        assert 0.1 < np.abs(utterance.waveform).max() < 1.0, speaker.name
