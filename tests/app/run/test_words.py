"""Which words a run has: those that are given, else those that are found."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.config import EXAMPLES
from app.errors import CancelledRun, RunError
from app.run.examples import CLEAN
from app.run.pipeline import generate_all
from app.run.words import SpokenWords, given_words
from model.speech.audio import load_speech
from model.speech.transcript import NOTHING_SAID, TranscriptError, read_transcript

GRID = CLEAN.with_suffix(".TextGrid")
SAID = EXAMPLES / "three_reasons.wav"


def never() -> None:
    raise AssertionError("nothing is waited for")


def test_a_textgrid_wins_and_nothing_is_looked_for() -> None:
    with SpokenWords(GRID, "recognise") as words:
        assert not words.need_speech
        words.begin(load_speech(SAID).waveform)
        assert words.found(never) == (read_transcript(GRID), ())
    assert given_words(GRID) == read_transcript(GRID)


def test_without_text_and_without_being_asked_there_are_no_words() -> None:
    with SpokenWords(None, "none") as words:
        assert not words.need_speech
        words.begin(load_speech(SAID).waveform)
        assert words.found(never) == (NOTHING_SAID, ())
    assert given_words(None) == NOTHING_SAID


def test_a_text_is_aligned_rather_than_recognised() -> None:
    text = SAID.with_suffix(".txt")
    assert given_words(text) == NOTHING_SAID  # not yet
    with SpokenWords(text, "recognise") as words:
        assert words.need_speech
        words.begin(load_speech(SAID).waveform)
        said, notes = words.found(lambda: None)
    assert (said.origin, notes) == ("aligned", ())
    assert said.words[0].text == "There"  # as it is written


def test_a_text_that_cannot_be_used_is_refused_before_anything(tmp_path: Path) -> None:
    path = tmp_path / "said.txt"
    path.write_text("...")
    with pytest.raises(TranscriptError, match=r"said.txt holds no words"):
        SpokenWords(path, "none")


def test_who_stops_a_run_ends_the_looking_for_words() -> None:
    def stop() -> None:
        raise CancelledRun

    with pytest.raises(CancelledRun), SpokenWords(None, "recognise") as words:
        words.begin(np.tile(load_speech(SAID).waveform, 20))
        child = words._hearing._child  # type: ignore[union-attr]
        assert child is not None and child.poll() is None
        words.found(stop)
    assert child.poll() is not None


def test_a_run_recognises_its_words_where_that_is_asked_for(ask) -> None:
    request = ask(speech=SAID, systems=("globaldiff/local",), words="recognise", has_figures=False)
    result = generate_all(request)
    assert result.said.origin == "recognised" and len(result.said.words) > 20
    told = json.loads((request.out / "diagnostics.json").read_text())
    assert told["words_origin"] == "recognised"
    assert {"text": "reasons"}.items() <= told["words"][3].items()
    assert 0.5 <= min(word["confidence"] for word in told["words"]) < 0.95
    assert len(told["phones"]) > len(told["words"])
    provenance = json.loads((request.out / "provenance.json").read_text())
    assert provenance["speech"]["words"] == {
        "origin": "recognised",
        "count": len(result.said.words),
    }
    assert (provenance["options"]["words"], provenance["options"]["transcript"]) == (
        *("recognise", None),
    )
    assert provenance["versions"]["pocketsphinx"][0] == "5"
    assert any("unsure" in note for note in result.notes)


def test_another_way_to_words_is_refused(ask) -> None:
    with pytest.raises(RunError, match="no way to words 'guess'; choose one of recognise, none"):
        generate_all(ask(words="guess"))
