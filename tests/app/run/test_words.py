"""Which words a run has: those that are given, else those that are found."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.config import EXAMPLES
from app.errors import Cancelled
from app.run.examples import CLEAN
from app.run.pipeline import run
from app.run.timeline import TranscriptLoader
from model.speech.audio import load_speech, write_wav
from model.speech.transcript import EMPTY_TRANSCRIPT, TranscriptError, read_textgrid_transcript

GRID = CLEAN.with_suffix(".TextGrid")
SAID = EXAMPLES / "three_reasons.wav"


def never() -> None:
    raise AssertionError("nothing is waited for")


def test_a_textgrid_wins_and_unasked_nothing_is_looked_for() -> None:
    for given, asked in [(GRID, "recognise"), (None, "none")]:
        expected = EMPTY_TRANSCRIPT if given is None else read_textgrid_transcript(given)
        with TranscriptLoader(given, asked) as words:
            assert not words.needs_speech
            words.begin(load_speech(SAID).waveform)
            assert words.wait(never) == (expected, ()) and words.provided == expected


def test_a_text_is_aligned_rather_than_recognised_or_refused_before_anything(
    tmp_path: Path,
) -> None:
    text = SAID.with_suffix(".txt")
    with TranscriptLoader(text, "recognise") as words:
        assert words.needs_speech and words.provided == EMPTY_TRANSCRIPT  # not yet
        words.begin(load_speech(SAID).waveform)
        said, notes = words.wait(lambda: None)
    assert (said.origin, notes) == ("aligned", ())
    assert said.words[0].text == "There"  # as it is written
    (tmp_path / "said.txt").write_text("...")
    with pytest.raises(TranscriptError, match=r"said.txt holds no words"):
        TranscriptLoader(tmp_path / "said.txt", "none")


def test_who_stops_a_run_ends_the_looking_for_words() -> None:
    def stop() -> None:
        raise Cancelled

    with pytest.raises(Cancelled), TranscriptLoader(None, "recognise") as words:
        words.begin(np.tile(load_speech(SAID).waveform, 20))
        child = words._recognition._child  # type: ignore[union-attr]
        assert child is not None and child.is_alive()
        words.wait(stop)
    assert not child.is_alive()


def test_a_run_recognises_its_words_where_that_is_asked_for(ask, tmp_path: Path) -> None:
    write_wav(tmp_path / "begin.wav", load_speech(SAID).waveform[: 16_000 * 3])
    asked = ask(
        speech=tmp_path / "begin.wav", systems=("globaldiff/local",), word_source="recognise"
    )
    result = run(asked)
    assert result.transcript.origin == "recognised" and len(result.transcript.words) > 5
    told = json.loads((asked.output.out / "diagnostics.json").read_text())
    assert told["words_origin"] == "recognised"
    assert "reasons" in [word["text"] for word in told["words"]]
    assert 0 < min(word["confidence"] for word in told["words"]) < 1
    assert len(told["phones"]) > len(told["words"])
    provenance = json.loads((asked.output.out / "provenance.json").read_text())
    count = len(result.transcript.words)
    assert provenance["speech"]["words"] == {"origin": "recognised", "count": count}
    options = provenance["options"]
    assert (options["word_source"], options["transcript"]) == ("recognise", None)
    assert provenance["versions"]["pocketsphinx"][0] == "5"
