"""The authors' checkpoints, named on a command line."""

import json
import os
from pathlib import Path

import pytest

from app.commands.cli import main
from app.errors import RunError
from app.page.launch import launch, parse_config
from app.run import models
from model.speech.audio import write_wav
from model.speech.encoder import EncoderError
from model.storage.cards import CheckpointError
from model.systems.official import system
from model.systems.official.config import FILTERED, UNFILTERED
from tests.model.made import made_waveform
from tests.model.systems.official.made_official import make_features, make_official


@pytest.fixture(autouse=True)
def unnamed(monkeypatch):
    """Nothing is named by the environment, and what a command names is forgotten again."""
    for name in ("OFFICIAL_DIR", "OFFICIAL_FEATURES", "OFFICIAL_SEED", "WAVLM_DIR"):
        monkeypatch.setenv(name, "")
    yield
    for kept in (models._load_system, system._shared):  # half a gigabyte
        kept.cache_clear()


@pytest.fixture
def checkpoints(made_once) -> Path:
    return made_once("official", make_official)


@pytest.mark.slow  # each is held against its own network in model/systems/official
def test_generate_runs_them_beside_ours(checkpoints, weights, tmp_path):
    speech, out = tmp_path / "speech.wav", tmp_path / "out"
    write_wav(speech, made_waveform(24_000))
    features = make_features(tmp_path / "features.npz", 1)
    argv = ["generate", speech, "--out", out, "--weights", weights, "--official", checkpoints,
            "--official-features", features, "--no-video", "--no-figures", "--steps", "1",
            "--systems", f"{FILTERED},{UNFILTERED},globaldiff/local"]  # fmt: skip
    assert main(list(map(str, argv))) == 0
    assert (out / "official-authors.npz").is_file()
    assert (out / "official-authors-unfiltered.npz").is_file()
    record = json.loads((out / "provenance.json").read_text())
    assert "epoch_999 was trained on" in record["weights"][FILTERED]["trained_on"]
    assert record["weights_are"].startswith("the authors' checkpoint epoch_999, run by this")
    assert "demonstration weights of this project" in record["weights_are"]


def test_what_is_not_there_is_told_before_anything_is_made(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_wav(tmp_path / "speech.wav", made_waveform(16_000))
    for folder, told in (
        ("nowhere", "There is no folder"),
        (".", "holds no file of the motion network"),
    ):
        assert main(["generate", "speech.wav", "--out", "out", "--official", folder]) == 1
        assert told in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_the_page_needs_something_that_hears_every_speech(checkpoints, tmp_path):
    with pytest.raises(CheckpointError, match="There is no folder"):
        parse_config(["--official", str(tmp_path / "nowhere")])
    with pytest.raises(EncoderError, match="with --official-features PATH"):
        parse_config(["--official", str(checkpoints)])
    features = str(make_features(tmp_path / "features.npz", 1))
    flags = ["--official", str(checkpoints), "--official-features", features, "--port", "0"]
    config = parse_config(flags)
    assert os.environ["OFFICIAL_DIR"] == str(checkpoints)
    with pytest.raises(RunError, match="it must accept any speech, but prepared features"):
        launch(config, preloads_models=False)


@pytest.mark.slow  # networks of their real size
def test_doctor_reads_each_of_them(checkpoints, tmp_path):
    from app.commands.doctor import _family_files

    assert _family_files() == []
    os.environ["OFFICIAL_DIR"] = str(checkpoints)
    os.environ["OFFICIAL_FEATURES"] = str(make_features(tmp_path / "features.npz", 1))
    found = {finding.name: finding for finding in _family_files()}
    assert found["official motion"].detail.endswith("epoch_999, 43.1 M parameters")
    assert found["official expression"].works and found["official speech"].works
