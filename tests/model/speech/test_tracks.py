"""Which track and channel is heard, and what is told of lengths that are not the sound's."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from app.errors import RunError
from app.run.ask import read_channel
from conventions.rates import SAMPLE_RATE
from model.speech.audio import SpeechLimits, load_speech
from tests.model.speech.test_audio import assert_refused, ffmpeg

PICTURES = ("-f", "lavfi", "-i", "color=size=64x64:rate=25:duration=6")


def tone(duration_s: float, rate: int = SAMPLE_RATE, hertz: float = 440.0) -> np.ndarray:
    moments = np.arange(round(duration_s * rate)) / rate
    return (0.5 * np.sin(2 * np.pi * hertz * moments)).astype(np.float32)


def encode(source: Path, target: Path, *options: str) -> Path:
    ffmpeg("-i", source, *options, target)
    return target


def hertz(waveform: np.ndarray) -> int:
    power = np.abs(np.fft.rfft(waveform[: 2 * SAMPLE_RATE]))
    return int(power.argmax() / 2)


@pytest.fixture
def dialogue(tmp_path: Path) -> Path:
    """440 Hz on the left, 880 on the right."""
    sides = np.stack([tone(3.0), tone(3.0, hertz=880.0)], axis=1)
    wavfile.write(tmp_path / "dialogue.wav", SAMPLE_RATE, sides)
    return tmp_path / "dialogue.wav"


def test_one_side_of_a_dialogue_is_heard_alone(dialogue):
    for written, wanted in (("left", 440), ("right", 880), ("2", 880)):
        speech = load_speech(dialogue, SpeechLimits(channel=read_channel(written)))
        assert hertz(speech.waveform) == wanted
        assert np.abs(speech.waveform).max() == pytest.approx(0.5, abs=0.01)  # not halved
        (note,) = speech.notes
        assert f"only number {1 + (wanted == 880)}" in note
    assert_refused(dialogue, "2 channels", "number 3", limits=SpeechLimits(channel=2))
    for written in ("middle", "0", "-1", "65"):
        with pytest.raises(RunError, match="left, right, or a number"):
            read_channel(written)


def test_the_first_track_that_is_not_silent_is_heard(tmp_path, dialogue):
    wavfile.write(tmp_path / "silent.wav", SAMPLE_RATE, np.zeros(3 * SAMPLE_RATE, np.float32))
    wavfile.write(tmp_path / "tone.wav", SAMPLE_RATE, tone(3.0))

    def film(name: str, *inputs: str) -> Path:
        more = [part for path in inputs for part in ("-i", str(tmp_path / path))]
        maps = [part for n in range(len(inputs) + 1) for part in ("-map", f"{n}:a")]
        return encode(tmp_path / "silent.wav", tmp_path / name, *more, *maps, "-c:a", "aac")

    speech = load_speech(film("two.mkv", "tone.wav"))
    assert hertz(speech.waveform) == 440
    assert speech.notes[0] == "Of 2 sound tracks number 2, the first that is not silent, was used."
    third = load_speech(film("three.mp4", "silent.wav", "dialogue.wav"), SpeechLimits(channel=1))
    assert hertz(third.waveform) == 880 and "number 3" in third.notes[0]
    assert_refused(film("none.mkv", "silent.wav"), "silent")


@pytest.mark.parametrize(
    ("name", "options"),
    [("a.mts", ("-c:v", "mpeg2video", "-c:a", "ac3")), ("a.mpg", ("-c:v", "mpeg2video")),
     ("a.mp4", ("-c:a", "aac")), ("a.mkv", ("-c:a", "aac"))],
)  # fmt: skip
def test_a_video_longer_than_its_sound_is_not_damaged(name, options, tmp_path):
    wavfile.write(tmp_path / "tone.wav", 32000, tone(3.0, 32000))
    film = encode(tmp_path / "tone.wav", tmp_path / name, *PICTURES, *options)
    speech = load_speech(film)
    assert hertz(speech.waveform) == 440 and speech.duration_s == pytest.approx(3.0, abs=0.1)
    assert not any("damaged" in note for note in speech.notes)


def test_a_length_that_is_only_estimated_is_not_held_against_the_sound(tmp_path):
    late = np.concatenate([np.zeros(5 * SAMPLE_RATE, np.float32), tone(1.0)])
    wavfile.write(tmp_path / "late.wav", SAMPLE_RATE, late)
    path = encode(tmp_path / "late.wav", tmp_path / "late.aac", "-c:a", "aac", "-b:a", "32k")
    speech = load_speech(path)
    assert speech.duration_s == pytest.approx(6.0, abs=0.1) and speech.notes == ()


def test_a_cut_video_is_still_told(tmp_path):
    wavfile.write(tmp_path / "noise.wav", SAMPLE_RATE, tone(6.0))
    options = (*PICTURES, "-c:a", "aac", "-movflags", "faststart")
    whole = encode(tmp_path / "noise.wav", tmp_path / "whole.mp4", *options)
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    (note,) = (note for note in load_speech(cut).notes if "damaged" in note)
    assert "6.0 s that the file states" in note
