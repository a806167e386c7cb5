"""Speech by flite: exact times, words found, and sentences for what goes wrong."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from conventions.rates import SAMPLE_RATE
from tools.corpus.people.speaker import SPEAKERS
from tools.corpus.people.voice import (
    PAUSE,
    Phone,
    Voice,
    VoiceError,
    align,
    pronounce,
    say,
    words_of,
)
from tools.corpus.words.prosody import speak_text

VOICE = Voice("slt", 178.0, 26.0)
SENTENCE = "Honestly, the whole project is really important."


def test_stress_marks_one_vowel_and_words_keep_their_apostrophes(flite):
    assert [name for name, stress in pronounce("amazing") if stress] == ["ey"]
    assert words_of("I don't know, OK?") == ["i", "don't", "know", "ok"]


def test_phones_tile_the_sentence_and_every_word_is_found_in_order(flite):
    waveform, phones = say(SENTENCE, VOICE)
    assert phones[0].start_s == 0.0
    for before, after in pairwise(phones):
        assert before.end_s == after.start_s < after.end_s
    assert abs(phones[-1].end_s - len(waveform) / SAMPLE_RATE) < 0.05
    numbers = [p.word for p in phones if p.name != PAUSE]
    assert numbers == sorted(numbers)
    assert set(numbers) == set(range(len(words_of(SENTENCE))))
    assert {p.word for p in phones if p.name == PAUSE} <= {-1}


def test_a_loud_vowel_lies_where_its_phone_says(flite):
    waveform, phones = say("Ah, see.", VOICE)
    spans = [waveform[int(p.start_s * 16000) : int(p.end_s * 16000)] for p in phones]
    loudness = [float(np.sqrt(np.mean(s**2))) for s in spans]
    vowels = [x for x, p in zip(loudness, phones, strict=True) if p.is_vowel]
    pauses = [x for x, p in zip(loudness, phones, strict=True) if p.name == PAUSE]
    assert min(vowels) > 5 * max(pauses)


def pitch_hz(waveform: np.ndarray) -> float:
    """Median pitch of the voiced 50 ms frames, by autocorrelation."""
    pitches = []
    for frame in waveform[: len(waveform) // 800 * 800].reshape(-1, 800):
        if frame.std() > 0.3 * waveform.std():
            lags = np.correlate(frame, frame, "full")[799:]
            lag = int(np.argmax(lags[50:230])) + 50
            if lags[lag] > 0.5 * lags[0]:
                pitches.append(SAMPLE_RATE / lag)
    return float(np.median(pitches))


def test_pitch_and_pace_follow_the_voice_and_formants_change_neither(flite):
    plain, _ = say(SENTENCE, VOICE)
    assert abs(pitch_hz(plain) - 178) < 18
    high, _ = say(SENTENCE, replace(VOICE, f0_hz=220.0))
    assert 1.12 < pitch_hz(high) / pitch_hz(plain) < 1.35
    slow, _ = say(SENTENCE, replace(VOICE, stretch=1.2))
    assert 1.12 < len(slow) / len(plain) < 1.28
    small, _ = say(SENTENCE, replace(VOICE, formant=1.12))
    assert abs(len(small) / len(plain) - 1) < 0.03
    assert abs(pitch_hz(small) / pitch_hz(plain) - 1) < 0.08
    assert spectral_centroid(small) > 1.04 * spectral_centroid(plain)


def spectral_centroid(waveform: np.ndarray) -> float:
    power = np.abs(np.fft.rfft(waveform)) ** 2
    return float((np.arange(len(power)) * power).sum() / power.sum() / len(power))


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
    with pytest.raises(VoiceError, match="nothing to say"):
        say("...", VOICE)


def test_every_speaker_has_a_voice_within_range(flite):
    for speaker in SPEAKERS:
        utterance = speak_text(speaker, ["Wow, that is amazing!"], np.random.default_rng(0))
        assert [w.text for w in utterance.words] == ["wow", "that", "is", "amazing"]
        assert 1.3 < utterance.duration_s < 6.0, speaker.name
        assert 0.1 < np.abs(utterance.waveform).max() < 1.0, speaker.name
