"""Words, phrases and accents of a whole clip."""

from itertools import pairwise

import numpy as np
import pytest

from conventions.rates import SAMPLE_RATE
from tools.corpus.clip import Clip
from tools.corpus.people.speaker import SPEAKERS
from tools.corpus.people.voice import PAUSE
from tools.corpus.words.prosody import LEAD_S, MIN_ACCENT_GAP_S, speak_text


def test_phrases_cover_all_words_once(clips: dict[str, Clip]) -> None:
    for clip in clips.values():
        utterance = clip.utterance
        covered = [k for phrase in utterance.phrases for k in phrase.words]
        assert covered == list(range(len(utterance.words)))
        ends = [p for p in utterance.phrases if p.ends_sentence]
        assert len(ends) == len({w.sentence for w in utterance.words})


def test_times_run_on_and_stay_in_the_clip(clips: dict[str, Clip]) -> None:
    for clip in clips.values():
        utterance = clip.utterance
        phones, words = utterance.phones, utterance.words
        assert 0.3 < phones[0].start_s < LEAD_S + 0.05
        for before, after in pairwise(phones):
            assert before.end_s <= after.start_s + 1e-9
        assert phones[-1].end_s < utterance.duration_s
        for word in words:
            assert word.start_s < word.end_s
            assert word.start_s <= word.beat_s <= word.end_s + 0.03
        spoken = {p.word for p in phones if p.name != PAUSE}
        assert len(spoken) > 0.97 * len(words)


def test_accents_lie_apart_within_a_phrase_and_are_louder_than_the_rest(
    clips: dict[str, Clip],
) -> None:
    for clip in clips.values():
        utterance = clip.utterance
        for phrase in utterance.phrases:
            beats = [
                utterance.words[k].beat_s for k in phrase.words if utterance.words[k].accent > 0
            ]
            # The local speed-up moves beats by a few hundredths.
            assert all(gap > 0.85 * MIN_ACCENT_GAP_S for gap in np.diff(sorted(beats)))
        loud = [loudness_db(utterance, w.beat_s) for w in utterance.words if w.accent > 0]
        plain = [loudness_db(utterance, w.beat_s) for w in utterance.words if w.accent == 0]
        assert np.mean(loud) > np.mean(plain) + 2.5


def loudness_db(utterance, beat_s: float) -> float:
    at = int(beat_s * SAMPLE_RATE)
    return 10 * np.log10(np.mean(utterance.waveform[at : at + 1600] ** 2) + 1e-9)


@pytest.mark.parametrize("speaker", SPEAKERS, ids=lambda s: s.name)
def test_every_speaker_has_a_voice_within_range(speaker, flite: None) -> None:
    utterance = speak_text(speaker, ["Wow, that is amazing!"], np.random.default_rng(0))
    assert [w.text for w in utterance.words] == ["wow", "that", "is", "amazing"]
    assert 1.3 < utterance.duration_s < 6.0
    assert 0.1 < np.abs(utterance.waveform).max() < 1.0
