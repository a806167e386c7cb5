"""Words and phones that are found in speech: where they are, which they are, and what is told when
they cannot be."""

import os
import re
import signal
import sys
from itertools import pairwise

import numpy as np
import pytest

from app.run.examples import CLEAN
from conventions.rates import SAMPLE_RATE
from model.speech import word_recognition
from model.speech.audio import load_speech
from model.speech.transcript import EMPTY_TRANSCRIPT, Transcript, Word, read_textgrid_transcript
from model.speech.word_alignment import PIECE_S, piece_ranges
from model.speech.word_recognition import (
    MIN_CONFIDENCE,
    RecognitionResult,
    WordRecognition,
    _judged,
)
from tests.helpers import ROOT, foreign_folder

EXAMPLES = ROOT / "examples"
PHONE = re.compile(r"[A-Z]{1,3}")


def heard(waveform: np.ndarray, text: str | None = None) -> RecognitionResult:
    with WordRecognition(waveform, text) as hearing:
        return hearing.result()


def example(name: str) -> tuple[np.ndarray, str]:
    text = (EXAMPLES / f"{name}.txt").read_text()
    return load_speech(EXAMPLES / f"{name}.wav").waveform, text


def spelt(said: Transcript) -> list[str]:
    return [re.sub("[^a-z']", "", word.text.lower()) for word in said.words]


def test_a_text_is_found_where_it_is_said_with_its_phones():
    words = read_textgrid_transcript(CLEAN.with_suffix(".TextGrid")).words
    exact = [word for word in words if word.end_s < 6.0]
    text = " ".join(word.text for word in exact).capitalize()
    until = round((exact[-1].end_s + words[len(exact)].start_s) / 2 * SAMPLE_RATE)
    said = heard(load_speech(CLEAN.with_suffix(".wav")).waveform[:until], text)
    assert said.notes == () and said.transcript.origin == "aligned"
    words, phones = said.transcript.words, said.transcript.phones
    assert [word.text for word in words] == text.split()  # as it was written
    off = [abs(word.start_s - given.start_s) for word, given in zip(words, exact, strict=True)]
    assert np.median(off) < 0.02 and np.percentile(off, 90) < 0.08 and max(off) < 0.3
    for word in words:
        own = [each for each in phones if word.start_s <= each.start_s < word.end_s]
        assert own[0].start_s == word.start_s and own[-1].end_s == word.end_s
        assert all(PHONE.fullmatch(each.text) for each in own)
        assert all(a.end_s == b.start_s for a, b in pairwise(own))


@pytest.mark.slow
def test_a_sentence_that_nobody_has_said_spoils_its_neighbourhood_only():
    waveform, text = example("a_long_drive")
    exact = heard(waveform, text).transcript
    more = text.replace("Wow,", "My mother gave me an apple. Wow,")
    said = heard(waveform, more)
    assert not {"mother", "gave", "apple"} & set(spelt(said.transcript))
    assert len(said.transcript.words) > 0.8 * len(exact.words)
    assert said.transcript.words[-1].start_s == pytest.approx(exact.words[-1].start_s, abs=0.02)
    (note,) = said.notes
    assert re.fullmatch(r"\d+ of the 50 words of the text were not found where .*\.", note)


@pytest.mark.slow
def test_speech_of_another_language_is_told_so_and_no_words_are_used():
    said = heard(load_speech(foreign_folder() / "talkshow_french.wav").waveform)
    assert said.transcript == EMPTY_TRANSCRIPT
    assert "probably not in English" in said.notes[0]


@pytest.mark.parametrize(
    ("sure", "unsure", "is_aligned", "says"),
    [
        (10, 0, False, ""),
        (4, 6, False, "6 of 10 recognised words were uncertain and are left out."),
        (3, 5, False, "probably not in English"),
        (1, 6, False, "6 of 7 recognised words were uncertain"),  # too few to tell by
        (0, 7, False, "No words were recognised in the speech."),
        (0, 0, False, "No words were recognised in the speech."),
        (
            4,
            6,
            True,
            "6 of the 10 words of the text were not found in the speech and are left out.",
        ),
        (3, 5, True, "5 of its 8 words were not found. Its words are not used"),
        (0, 0, True, "none of its words were found. Its words are not used"),
    ],
)
def test_sure_words_are_used_unless_too_few_are(sure, unsure, is_aligned, says):
    words = [Word(float(k), k + 0.3, f"w{k}", MIN_CONFIDENCE) for k in range(sure)]
    doubted = [Word(50.0 + k, 50.3 + k, "?", MIN_CONFIDENCE - 0.01) for k in range(unsure)]
    doubted[:1] = [Word(50.0, 52.6, "?", 1.0)] if doubted else []  # too long for a word
    found = _judged([(word, ()) for word in words + doubted], is_aligned)
    assert says in "".join(found.notes) and len(found.notes) == bool(says)
    is_used = found.transcript != EMPTY_TRANSCRIPT
    assert is_used == (sure > 0 and not ("English" in says or "not used" in says))
    if is_used:
        assert found.transcript.words == tuple(words)
        assert found.transcript.origin == ("aligned" if is_aligned else "recognised")


def test_of_a_few_seconds_words_are_recognised():
    waveform, _ = example("three_reasons")
    said = heard(waveform[: 2 * SAMPLE_RATE]).transcript
    assert (
        said.origin == "recognised"
        and min(word.confidence for word in said.words) >= MIN_CONFIDENCE
    )
    assert {"three", "reasons"} <= set(spelt(said))
    (three,) = (word for word in said.words if word.text == "three")
    assert three.start_s == pytest.approx(0.97, abs=0.05)


def test_a_text_that_is_not_said_is_not_used():
    waveform, (_, other) = example("a_long_drive")[0], example("three_reasons")
    for text in (other, "中文"):
        said = heard(waveform[: 3 * SAMPLE_RATE], text)
        assert said.transcript == EMPTY_TRANSCRIPT
        assert (
            len(said.notes) == 1
            and "Its words are not used; give the spoken words" in said.notes[0]
        )


@pytest.mark.parametrize("seconds", [0.02, pytest.param(1.0, marks=pytest.mark.slow)])
def test_a_tone_holds_no_words_and_no_length_is_a_failure(seconds):
    times = np.arange(round(seconds * SAMPLE_RATE)) / SAMPLE_RATE
    said = heard(np.sin(440 * 2 * np.pi * times).astype(np.float32))
    assert len(said.transcript.words) <= 1
    assert not any("could not be found" in note for note in said.notes)


def test_it_is_ended_when_nobody_waits_any_more():
    waveform, _ = example("a_long_drive")
    with WordRecognition(np.tile(waveform, 20)) as hearing:
        assert not hearing.is_over(0.0)
        child = hearing._child
    assert child is not None and not child.is_alive()


def test_whatever_goes_wrong_is_one_note(monkeypatch, tmp_path):
    waveform, _ = example("a_long_drive")
    with WordRecognition(waveform) as hearing:
        assert hearing._child is not None
        os.kill(hearing._child.pid, signal.SIGTERM)
        (note,) = hearing.result().notes
    assert note.endswith("the recogniser ended by signal 15 (SIGTERM).")
    monkeypatch.setattr(word_recognition, "TIMEOUT_S", (0.0, 0.0))
    (note,) = heard(waveform).notes
    assert note.endswith("finding them in the speech failed: it took too long.")
    monkeypatch.undo()
    # A package of that name which cannot be imported, as if it were not installed.
    (tmp_path / "pocketsphinx.py").write_text(
        "raise ModuleNotFoundError(\"No module named 'pocketsphinx'\")"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (note,) = heard(waveform).notes
    assert "the package pocketsphinx is not installed" in note
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no python"))
    (note,) = heard(waveform).notes
    assert "no process could be started (no such file" in note


def test_long_speech_is_cut_where_it_is_quiet():
    rng = np.random.default_rng(0)
    sound = (3000 * rng.standard_normal(60 * SAMPLE_RATE)).astype("<i2")
    for second in (10, 21, 33):
        sound[second * SAMPLE_RATE : second * SAMPLE_RATE + SAMPLE_RATE // 2] = 0
    cuts = list(piece_ranges(sound))
    assert cuts[0][0] == 0 and cuts[-1][1] == len(sound)
    assert all(a[1] == b[0] for a, b in pairwise(cuts))
    lengths = [(stop - start) / SAMPLE_RATE for start, stop in cuts]
    assert max(lengths) <= PIECE_S[1] + 0.01 and min(lengths[:-1]) >= PIECE_S[0]
    for second, (_, stop) in zip((10, 21, 33), cuts, strict=False):
        assert second < stop / SAMPLE_RATE < second + 0.5
    assert list(piece_ranges(sound[:100])) == [(0, 100)]
