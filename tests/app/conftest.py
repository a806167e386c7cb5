"""What tests of the app share: requests, and speech of another form than models hear."""

import wave
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from app.run.requests.requests import AnyRun
from tests.app.requests import generate_request
from tests.model.made import made_waveform


@pytest.fixture(autouse=True)
def _any_machine_is_quick_enough_to_be_live(monkeypatch: pytest.MonkeyPatch) -> None:
    """Busy machines refuse live systems by time; the test of that asks for it."""
    monkeypatch.setattr("app.live.session.MAX_WINDOW_MS", 1e6)


@pytest.fixture
def ask(weights: Path, speech: Path, tmp_path: Path) -> Callable[..., AnyRun]:
    """A request that needs no GL and draws no figures unless it is told otherwise."""

    def make(**changes) -> AnyRun:
        values = {
            "speech": speech,
            "out": tmp_path / "out",
            "weights": weights,
            "steps": 1,
            "has_video": False,
            "has_figures": False,
        }
        return generate_request(**{**values, **changes})

    return make


@pytest.fixture
def eight_channels(tmp_path: Path) -> Path:
    """Two seconds of eight channels at 96 kHz."""
    path = tmp_path / "eight.wav"
    one = np.repeat(made_waveform(32_000), 6)
    samples = np.stack([one * (i + 1) / 8 for i in range(8)], axis=1)
    with wave.open(str(path), "wb") as file:
        file.setparams((8, 2, 96_000, 0, "NONE", ""))
        file.writeframes((32767 * samples).astype("<i2").tobytes())
    return path
