"""A family that nothing in the project knows of trains, generates, is measured and shown: that of
`examples/frame_regression`.
"""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from frame_regression.config import DRAWN, FAMILY, MEAN

from app.page.parts.catalogue import read_catalogue
from app.page.tabs.systems import ablations_html
from app.run.pipeline import run
from model import evaluate as measuring
from model.evaluation.clips import EvaluationModels
from model.generation.windows import GenerateOptions, generate_motion
from model.sampling.samplers import Sampling, UnknownNameError
from model.systems import registry
from model.systems.registry import families, list_systems, load_system, read_card, register
from model.train import main
from tests.app.requests import generate_request
from tests.model.made import made_speech
from tests.model.training.made import state_of


@pytest.fixture(scope="module", autouse=True)
def known():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_FAMILIES", list(families()))
        register(FAMILY)
        yield


@pytest.fixture(scope="module")
def trained(tmp_path_factory, data_folder, known) -> Path:
    """The weights that the project's own command leaves when it is resumed."""
    out = tmp_path_factory.mktemp("regression") / "run"
    command = ["smoke", "--system", MEAN, "--data", str(data_folder), "--out", str(out)]
    for more in ([], ["--resume"]):
        assert main([*command, "--set", "steps=2", "--no-compile", *more]) == 0
    state = state_of(out)
    assert state["step"] == 2 and len(state["optimizers"]) == 2
    assert all(optimizer["state"] for optimizer in state["optimizers"])
    return out / "weights"


def test_its_name_is_taken_once():
    with pytest.raises(ValueError, match="'regression' is already used"):
        register(FAMILY)
    assert families()[-1] is FAMILY


def test_two_systems_move_with_one_file_of_weights(trained):
    weights = trained
    assert list_systems(weights) == (MEAN, DRAWN) and DRAWN not in FAMILY.trainable_networks
    assert read_card(DRAWN, weights) == read_card(MEAN, weights)
    mean, drawn = load_system(MEAN, weights), load_system(DRAWN, weights)
    assert mean.sha256s == drawn.sha256s and drawn.samplers[0].default_steps == 3
    with pytest.raises(
        UnknownNameError, match="regression/drawn has no sampler 'mean'; it has smoothed"
    ):
        drawn.resolve_sampling(Sampling(sampler="mean"))
    with pytest.raises(ValueError, match="does not support guidance"):
        generate_motion(mean, made_speech(16_000), GenerateOptions(speaker="ann", guidance=2.0))


def test_it_moves_for_as_long_as_it_is_spoken(trained):
    speech = made_speech(16_000 * 3)
    options = GenerateOptions(speaker="ann", num_samples=2)
    one, same = generate_motion(load_system(MEAN, trained), speech, options)
    assert one.num_frames == same.num_frames == 90
    assert np.abs(one.poses - same.poses).max() == 0.0
    assert (one.expressions[:, :52] > 0).all()  # its own face
    drawn = load_system(DRAWN, trained)
    once, thrice = (
        generate_motion(drawn, speech, replace(options, steps=steps)) for steps in (1, 3)
    )
    assert np.abs(once[0].poses - once[1].poses).max() > 1e-3
    rough, smooth = (np.abs(np.diff(each[0].poses, axis=0)).mean() for each in (once, thrice))
    assert rough > 2 * smooth  # smoothed once and three times


def test_it_is_measured_without_the_abilities_that_it_lacks(trained, data_folder, tmp_path):
    data, weights = shutil.copytree(data_folder, tmp_path / "data"), trained
    split = data / "train_test_split.csv"
    rows = split.read_text().replace(",val", ",test").replace("3_eve_0_3_3,test", "3_eve_0_3_3,val")
    split.write_text(rows.replace("2_bob_0_1_1,train", "2_bob_0_1_1,test"))
    system = load_system(DRAWN, weights)
    clips = measuring.names_of_test_clips(data, [system])
    cast = partial(EvaluationModels, (system,))
    table = measuring.evaluate(cast, data, clips, num_seeds=2, resume_folder=tmp_path)
    assert table["motion"][DRAWN]["tip_jerk_m_s3"]["mean"] > 0


def test_the_page_offers_it_and_a_run_holds_it(trained, speech, tmp_path):
    weights = trained
    catalogue = read_catalogue(weights)
    assert FAMILY.descriptions[MEAN] in ablations_html(catalogue.systems)
    assert catalogue.systems == (MEAN, DRAWN) and catalogue.speakers == ("ann", "bob")
    request = generate_request(
        speech=speech, out=tmp_path / "out", weights=weights, has_figure_poses=False
    )
    run(request)
    assert (tmp_path / "out" / "regression-mean.npz").is_file()
    record = json.loads((tmp_path / "out" / "provenance.json").read_text())
    assert record["weights"][MEAN]["sha256"] == record["weights"][DRAWN]["sha256"]
    assert record["options"]["steps"] == {MEAN: 1, DRAWN: 3}
    assert record["options"]["sampler"] == {MEAN: "mean", DRAWN: "smoothed"}
