"""The bundled example speech: readable everywhere, small, with its text and its notice."""

import wave
from pathlib import Path

import numpy as np
import pytest

from model.corpus.people.voice import VoiceError, require_flite, words_of
from model.speech.audio import load_speech

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CLIPS = sorted(EXAMPLES.glob("*.wav"))


def test_there_are_a_few_and_they_are_small() -> None:
    assert 2 <= len(CLIPS) <= 4
    assert sum(path.stat().st_size for path in EXAMPLES.iterdir()) < 2_000_000


@pytest.mark.parametrize("path", CLIPS, ids=lambda path: path.stem)
def test_an_example_is_plain_speech_of_ten_to_sixteen_seconds(path: Path) -> None:
    with wave.open(str(path)) as sound:
        assert (sound.getnchannels(), sound.getsampwidth()) == (1, 2)
        assert sound.getframerate() == 16000
        samples = np.frombuffer(sound.readframes(sound.getnframes()), dtype="<i2") / 32768
    assert 10 < len(samples) / 16000 < 16
    assert 0.5 < np.abs(samples).max() < 0.99
    loud = np.sqrt(np.mean(samples[: len(samples) // 480 * 480].reshape(-1, 480) ** 2, axis=1))
    assert 0.4 < (loud > 0.02).mean() < 0.98  # speech, with pauses


@pytest.mark.parametrize("path", CLIPS, ids=lambda path: path.stem)
def test_an_example_has_its_text_and_is_named_in_the_notice(path: Path) -> None:
    assert len(words_of(path.with_suffix(".txt").read_text())) > 20
    assert path.name in (EXAMPLES / "NOTICE").read_text()
    assert path.name in (EXAMPLES / "README.md").read_text()


def test_examples_are_read_without_the_speech_program(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(VoiceError, match="apt-get install flite"):
        require_flite()
    for path in CLIPS:
        assert load_speech(path).num_frames > 300
