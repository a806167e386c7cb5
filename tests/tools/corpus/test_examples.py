"""The bundled example speech: readable everywhere, small, with its text and its notice."""

import re
import wave

import numpy as np
import pytest

from model.plan.files import read_corpus_textgrid
from model.speech.audio import load_speech
from tests.tools.corpus.made_example import EXAMPLE, LENGTH_S, NAME, made_example
from tools.corpus.clip import ClipPaths
from tools.corpus.people.speaker import VoiceError, require_flite, words_of

EXAMPLES = EXAMPLE.parent
NUMBER = re.compile(r"-?\d+\.?\d*")
CLIPS = sorted(EXAMPLES.glob("*.wav"))


@pytest.mark.parametrize("path", CLIPS, ids=lambda path: path.stem)
def test_an_example_is_plain_speech_of_ten_to_sixteen_seconds_with_its_text(path):
    with wave.open(str(path)) as sound:
        assert (sound.getnchannels(), sound.getsampwidth()) == (1, 2)
        assert sound.getframerate() == 16000
        samples = np.frombuffer(sound.readframes(sound.getnframes()), dtype="<i2") / 32768
    assert 10 < len(samples) / 16000 < 16
    assert 0.5 < np.abs(samples).max() < 0.99
    loud = np.sqrt(np.mean(samples[: len(samples) // 480 * 480].reshape(-1, 480) ** 2, axis=1))
    assert 0.4 < (loud > 0.02).mean() < 0.98  # speech, with pauses
    assert len(words_of(path.with_suffix(".txt").read_text())) > 20
    assert path.name in (EXAMPLES / "NOTICE").read_text()
    assert path.name in (EXAMPLES / "README.md").read_text()


def test_examples_are_read_without_the_speech_program(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(VoiceError, match="apt-get install flite"):
        require_flite()
    for path in CLIPS:
        assert load_speech(path).num_motion_frames > 300


def numbers(text: str) -> list[float]:
    return [float(number) for number in NUMBER.findall(text)]


def test_the_procedural_speaker_is_what_the_corpus_program_makes(tmp_path, flite):
    """Whoever changes the corpus makes the example anew: see `tests.tools.corpus.made_example`."""
    made = made_example(tmp_path)
    kept = ClipPaths(*(EXAMPLE / f"{NAME}.{kind}" for kind in ("npz", "wav", "TextGrid")))
    told, anew = kept.textgrid.read_text(), made.textgrid.read_text()
    assert NUMBER.split(told) == NUMBER.split(anew)
    np.testing.assert_allclose(numbers(told), numbers(anew), atol=2e-3)
    with np.load(kept.motion) as own, np.load(made.motion) as again:
        assert set(own) == set(again)
        assert own["poses"].shape == (round(30 * LENGTH_S), 165)
        for name in ("poses", "trans", "expressions"):
            np.testing.assert_allclose(own[name], again[name], atol=1e-3)
    sound, said = load_speech(kept.sound).waveform, load_speech(made.sound).waveform
    assert len(sound) == round(16_000 * LENGTH_S)
    np.testing.assert_allclose(sound, said, atol=1e-3)


def test_the_procedural_speaker_is_told_of_in_full():
    plan = read_corpus_textgrid(EXAMPLE / f"{NAME}.TextGrid")
    assert plan.duration_s == LENGTH_S
    for phases in (plan.left, plan.right):
        assert (phases[0].start_s, phases[-1].end_s) == (0.0, LENGTH_S)
        assert {"preparation", "stroke", "hold", "beat"} <= {p.phase for p in phases}
    assert all((plan.nods, plan.looks, plan.brows, plan.smiles, plan.blinks, plan.stands))
    assert {one.foot for one in plan.planted} == {"left", "right"}
