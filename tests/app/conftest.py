"""Weights, speech and bad files that the tests of the app share."""

import subprocess
import wave
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from app.run.requests.request import GenerateRequest
from tests.model.made import made_waveform


@pytest.fixture(autouse=True)
def _any_machine_is_quick_enough_to_be_live(monkeypatch: pytest.MonkeyPatch) -> None:
    """Busy machines refuse live systems by time; the test of that asks for it."""
    monkeypatch.setattr("app.live.session.MAX_WINDOW_MS", 1e6)


@pytest.fixture
def ask(weights: Path, speech: Path, tmp_path: Path) -> Callable[..., GenerateRequest]:
    """A request that needs no GL and draws no figures unless it is told otherwise."""

    def make(**changes) -> GenerateRequest:
        values = {
            "speech": speech,
            "out": tmp_path / "out",
            "weights": weights,
            "steps": 1,
            "has_video": False,
            "has_figures": False,
        }
        return GenerateRequest(**{**values, **changes})

    return make


def _write_samples(path: Path, samples: np.ndarray, rate: int) -> None:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1 if samples.ndim == 1 else samples.shape[1])
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes((32767 * samples).astype("<i2").tobytes())


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _no_samples(path: Path) -> None:
    _write_samples(path, np.zeros(0), 16_000)


def _too_short(path: Path) -> None:
    _write_samples(path, made_waveform(3_200), 16_000)


def _silent(path: Path) -> None:
    _write_samples(path, np.zeros(32_000), 16_000)


def _text(path: Path) -> None:
    path.write_text("This is a shopping list: eggs, milk, bread.\n" * 50)


def _nan_samples(path: Path) -> None:
    """A float wav by hand: Python's wave module writes integers only."""
    samples = made_waveform(16_000)
    samples[8_000] = np.nan
    data = samples.astype("<f4").tobytes()
    header = b"RIFF" + (36 + len(data)).to_bytes(4, "little") + b"WAVEfmt "
    header += (16).to_bytes(4, "little") + (3).to_bytes(2, "little") + (1).to_bytes(2, "little")
    header += (16_000).to_bytes(4, "little") + (64_000).to_bytes(4, "little")
    header += (4).to_bytes(2, "little") + (32).to_bytes(2, "little")
    path.write_bytes(header + b"data" + len(data).to_bytes(4, "little") + data)


def _half_an_hour(path: Path) -> None:
    tone = np.sin(np.arange(8_000 * 60) * 0.3) * 0.3
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 8_000, 0, "NONE", ""))
        for _ in range(30):
            file.writeframes((32767 * tone).astype("<i2").tobytes())


BAD_SPEECH: dict[str, tuple[Callable[[Path], None], str]] = {
    "empty file": (_empty, "empty"),
    "no samples": (_no_samples, "no sound"),
    "0.2 s": (_too_short, "at least 0.5 s"),
    "silence": (_silent, "silent"),
    "text renamed": (_text, "not a sound file"),
    "NaN samples": (_nan_samples, "not finite"),
    "30 minutes": (_half_an_hour, "longer than 10 minutes"),
}
"""What each bad speech file is, how it is made, and words of the sentence it must give."""


@pytest.fixture(params=list(BAD_SPEECH))
def bad_speech(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, str]:
    """A speech file that must be refused, and words of the sentence."""
    make, words = BAD_SPEECH[request.param]
    path = tmp_path / "speech.wav"
    make(path)
    return path, words


@pytest.fixture
def eight_channels(tmp_path: Path) -> Path:
    """Two seconds of eight channels at 96 kHz."""
    path = tmp_path / "eight.wav"
    one = np.repeat(made_waveform(32_000), 6)
    _write_samples(path, np.stack([one * (i + 1) / 8 for i in range(8)], axis=1), 96_000)
    return path


@pytest.fixture
def cut_mp3(tmp_path: Path) -> Path:
    """An mp3 whose last third is missing, in the middle of a frame."""
    whole = tmp_path / "whole.wav"
    _write_samples(whole, made_waveform(48_000), 16_000)
    path = tmp_path / "cut.mp3"
    subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", "-i", str(whole), str(path)],
        check=True,
    )
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3 + 1])
    return path


def _pickled(path: Path) -> None:
    np.savez(path, poses=np.array([{"a": 1}], dtype=object))


def _wrong_keys(path: Path) -> None:
    np.savez(path, vertices=np.zeros((3, 3)))


def _wrong_shapes(path: Path) -> None:
    np.savez(
        path, poses=np.zeros((30, 70)), trans=np.zeros((30, 3)), betas=np.zeros(300),
        expressions=np.zeros((30, 100)), mocap_frame_rate=30,
    )  # fmt: skip


BAD_MOTION: dict[str, tuple[Callable[[Path], None], str]] = {
    "pickled objects": (_pickled, "pickled"),
    "wrong keys": (_wrong_keys, "lacks poses"),
    "wrong shapes": (_wrong_shapes, "(frames, 165)"),
    "text renamed": (_text, "not a readable npz"),
}


@pytest.fixture(params=list(BAD_MOTION))
def bad_motion(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, str]:
    """A motion file that must be refused, and words of the sentence."""
    make, words = BAD_MOTION[request.param]
    path = tmp_path / "motion.npz"
    make(path)
    return path, words
