"""What is said of a file as soon as it has been uploaded."""

from pathlib import Path

import numpy as np
import pytest

from app.run.examples import CLEAN
from app.run.requests.upload_check import refusal_of
from model.speech.audio import write_wav
from tests.model.made import made_waveform

MAX_S = 2.0


def wav(path: Path, seconds: float, loudness: float = 1.0) -> Path:
    write_wav(path, (loudness * made_waveform(round(16_000 * seconds))).astype(np.float32))
    return path


def test_what_can_be_used_is_not_refused(tmp_path: Path) -> None:
    assert refusal_of("speech", [wav(tmp_path / "a.wav", 1.0)], MAX_S) == ""
    motion = CLEAN
    assert refusal_of("reference", [motion], MAX_S) == ""
    assert refusal_of("motion", [motion], MAX_S) == ""
    assert refusal_of("motion", [], MAX_S) == ""
    assert refusal_of("transcript", [motion.with_suffix(".TextGrid")], MAX_S) == ""
    text = tmp_path / "said.txt"
    text.write_text("Hello, world.")
    assert refusal_of("transcript", [text], MAX_S) == ""
    text.write_text("?")
    assert refusal_of("transcript", [text], MAX_S) == "said.txt holds no words."


@pytest.mark.parametrize(
    ("seconds", "loudness", "words"),
    [(1.0, 0.0, "silent"), (0.2, 1.0, "0.2"), (3.0, 1.0, "2")],
)
def test_speech_that_is_silent_too_short_or_too_long_is_refused_in_a_sentence(
    tmp_path: Path, seconds: float, loudness: float, words: str
) -> None:
    sentence = refusal_of("speech", [wav(tmp_path / "a.wav", seconds, loudness)], MAX_S)
    assert words in sentence and sentence.endswith(".")


@pytest.mark.parametrize("kind", ["speech", "reference", "motion", "transcript"])
def test_the_first_wrong_file_is_named(tmp_path: Path, kind) -> None:
    wrong = [tmp_path / f"{name}.npz" for name in ("first", "second")]
    for path in wrong:
        path.write_bytes(b"\x00" * 64)
    sentence = refusal_of(kind, wrong, MAX_S)
    assert "first" in sentence and "second" not in sentence
