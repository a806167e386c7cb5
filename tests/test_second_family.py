"""A family that nothing in the project knows of trains, generates, is measured and shown: that of
`examples/frame_regression`."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from frame_regression import DRAWN, FAMILY, MEAN

from app.page.parts.catalogue import read_catalogue
from app.page.tabs.systems.systems import ladder
from app.run.pipeline import generate_all
from app.run.requests.request import GenerateRequest
from model import evaluate as measuring
from model.generation.windows import GenerateOptions, generate_motion
from model.sampling.samplers import UnknownNameError
from model.speech.audio import write_wav
from model.systems.registry import (
    families,
    list_systems,
    load_system,
    read_card,
    register,
    unregister,
)
from model.train import main
from tests.model.made import made_speech, made_waveform, make_data_folder


@pytest.fixture(scope="module", autouse=True)
def known():
    register(FAMILY)
    yield
    unregister(FAMILY.name)


@pytest.fixture(scope="module")
def trained(tmp_path_factory, known) -> tuple[Path, Path]:
    """Folders of data and of the weights that the project's own command leaves."""
    root = tmp_path_factory.mktemp("regression")
    data = make_data_folder(root / "data")
    command = ["smoke", "--system", MEAN, "--data", str(data), "--out", str(root / "run")]
    assert main(command) == 0
    return data, root / "run" / "weights"


def test_its_name_is_taken_once():
    with pytest.raises(ValueError, match="'regression' is taken"):
        register(FAMILY)
    assert families()[-1] is FAMILY


def test_it_trains_and_resumes_with_both_optimizers(trained, tmp_path):
    data, _ = trained
    for steps in (["--steps", "6"], ["--steps", "6", "--resume"]):
        command = ["smoke", "--system", MEAN, "--data", str(data), "--out", str(tmp_path / "run")]
        assert main([*command, *steps]) == 0
    state = torch.load(tmp_path / "run" / "state.pt", weights_only=True)
    assert state["step"] == 6 and len(state["optimizers"]) == 2
    assert all(optimizer["state"] for optimizer in state["optimizers"])


def test_two_systems_move_with_one_file_of_weights(trained):
    _, weights = trained
    assert list_systems(weights) == (MEAN, DRAWN) and DRAWN not in FAMILY.trained
    assert read_card(DRAWN, weights) == read_card(MEAN, weights)
    mean, drawn = load_system(MEAN, weights), load_system(DRAWN, weights)
    assert mean.sha256s == drawn.sha256s and drawn.samplers[0].steps == 3
    with pytest.raises(
        UnknownNameError, match="regression/drawn has no sampler 'mean'; it has smoothed"
    ):
        drawn.sampler("mean")


def test_it_moves_for_as_long_as_it_is_spoken(trained):
    speech = made_speech(16_000 * 5)
    options = GenerateOptions(speaker="ann", samples=2)
    one, same = generate_motion(load_system(MEAN, trained[1]), speech, options)
    assert one.num_frames == same.num_frames == 150
    assert np.abs(one.poses - same.poses).max() == 0.0
    assert (one.expressions[:, :52] > 0).all()  # its own face
    drawn = load_system(DRAWN, trained[1])
    once, thrice = (
        generate_motion(drawn, speech, replace(options, steps=steps)) for steps in (1, 3)
    )
    assert np.abs(once[0].poses - once[1].poses).max() > 1e-3
    rough, smooth = (np.abs(np.diff(each[0].poses, axis=0)).mean() for each in (once, thrice))
    assert rough > 2 * smooth  # smoothed once and three times


def test_what_it_cannot_do_is_told(trained):
    system, speech = load_system(MEAN, trained[1]), made_speech(16_000)
    with pytest.raises(UnknownNameError, match="no sampler 'euler'; it has mean"):
        generate_motion(system, speech, GenerateOptions(speaker="ann", sampler="euler"))
    with pytest.raises(ValueError, match="takes no guidance"):
        generate_motion(system, speech, GenerateOptions(speaker="ann", guidance=2.0))


def test_it_is_measured_without_the_abilities_that_it_lacks(trained):
    data, weights = trained
    split = data / "train_test_split.csv"
    rows = split.read_text().replace(",val", ",test").replace("3_eve_0_3_3,test", "3_eve_0_3_3,val")
    split.write_text(rows.replace("2_bob_0_1_1,train", "2_bob_0_1_1,test"))
    system = load_system(DRAWN, weights)
    clips = measuring.test_clips(data, [system])
    table = measuring.evaluate(data, clips, [system], seeds=2)
    assert table["motion"][DRAWN]["tip_jerk_m_s3"]["mean"] > 0
    assert DRAWN not in table["wrong_speech"]
    assert "position_error_m" not in table["by_depth"][DRAWN]


def test_the_page_offers_it_and_a_run_holds_it(trained, tmp_path):
    _, weights = trained
    catalogue = read_catalogue(weights)
    assert FAMILY.about[MEAN] in ladder(catalogue.systems)
    assert catalogue.systems == (MEAN, DRAWN) and catalogue.speakers == ("ann", "bob")
    write_wav(tmp_path / "speech.wav", made_waveform(32_000))
    request = GenerateRequest(
        speech=tmp_path / "speech.wav", out=tmp_path / "out", weights=weights, has_video=False
    )
    result = generate_all(request, lambda event: None, lambda: False)
    assert result.names == (MEAN, DRAWN) and (tmp_path / "out" / "regression-mean.npz").is_file()
    record = json.loads((tmp_path / "out" / "provenance.json").read_text())
    assert record["weights"][MEAN]["sha256"] == record["weights"][DRAWN]["sha256"]
    assert record["options"]["steps"] == {MEAN: 1, DRAWN: 3}
    assert record["options"]["sampler"] == {MEAN: "mean", DRAWN: "smoothed"}
