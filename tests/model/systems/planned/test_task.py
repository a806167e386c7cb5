import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from model.data.annotated import prepare_plans
from model.data.prepared import prepare
from model.data.recordings import DataError
from model.speech.features import MelEncoder
from model.storage.cards import BUNDLED_WEIGHTS
from model.systems.planned.config import PLANNED, PLANNER
from model.systems.registry import family_of, load_system
from model.training.loop import train
from tests.model.made import make_data_folder
from tests.model.systems.planned.made import make_annotated_folder

QUICK = {"steps": 6, "save_every": 3, "validate_every": 6, "warmup_steps": 2, "batch_size": 2}


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Annotated data, and beside it what was trained on it."""
    root = tmp_path_factory.mktemp("planned")
    make_annotated_folder(root / "data")
    family = family_of(PLANNER)
    for name in ("expression", PLANNER, PLANNED):
        config = replace(family_of(name).config("smoke", name), **QUICK)
        if name == "expression":
            config = replace(config, plan_dropout=0.5)
        out = root / name.replace("/", "-")
        train(config, family_of(name).make_task, root / "data", out, helpers=BUNDLED_WEIGHTS)
    assert family.trained == (PLANNED, PLANNER)
    return root


def test_what_was_trained_performs(root, tmp_path):
    for name in ("expression", PLANNER, PLANNED):
        for path in (root / name.replace("/", "-") / "weights").iterdir():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    system = load_system(PLANNED, tmp_path)
    assert system.face.network.plan.out.weight.any()
    assert system.plans and system.speakers == {"ann": 1, "bob": 2}
    card = json.loads((tmp_path / "planner.json").read_text())
    assert card["validation"]["right"] > 0 and card["validation"]["right mark"] != 0


def test_windows_of_plans_are_those_of_their_clips(root):
    data = prepare(root / "data", root / "prepared-mel64", MelEncoder(), augmented_copies=1)
    plans = prepare_plans(data, 4)
    clips = data.of_split("train")
    batch = data.window_batch(clips, 60, 8, np.random.default_rng(0), context=5)
    tracks, kinds = plans.of(batch, 5)
    assert tracks.shape == (8, 70, 29) and kinds.shape == (8, 70, 2)
    np.testing.assert_array_equal(tracks[:, 5:-5], plans.tracks[batch.frames])
    at_start = batch.frames.copy()
    at_start[0] = clips[-1].start + np.arange(60)
    held, _ = plans.of(replace(batch, frames=at_start), 5)
    np.testing.assert_array_equal(held[0, :6], np.repeat(plans.tracks[[clips[-1].start]], 6, 0))
    assert set(np.unique(plans.kinds[: data.clips[0].stop])) == {0, plans.table.place("offer")}
    events = plans.events(batch)
    assert {name: event.shape for name, event in events.event.items()}["right"] == (8, 60)
    for row, frames in enumerate(batch.frames):
        clip = next(k for k, c in enumerate(data.clips) if c.start <= frames[0] < c.stop)
        begins = [b.frame + data.clips[clip].start for b in plans.chains[clip]["right"][1:]]
        expected = [frame in begins for frame in frames]
        assert (events.event["right"][row] > 0).tolist() == expected


def test_plans_keep_time_with_faster_copies(root):
    data = prepare(root / "data", root / "prepared-mel64", MelEncoder(), augmented_copies=1)
    plans = prepare_plans(data, 4)
    plain, copy = (next(k for k, c in enumerate(data.clips) if c.copy == n) for n in (0, 1))
    name = data.clips[copy].name
    assert data.clips[plain].name == name
    speed = data.clips[plain].num_frames / data.clips[copy].num_frames
    for one, other in zip(plans.chains[plain]["right"], plans.chains[copy]["right"], strict=True):
        assert other.frame == pytest.approx(one.frame / speed, abs=1.5)


def test_mirrored_windows_are_refused(root):
    data = prepare(root / "data", root / "prepared-mel64", MelEncoder(), augmented_copies=1)
    batch = data.window_batch(data.of_split("train"), 60, 2, np.random.default_rng(0))
    with pytest.raises(ValueError, match="mirror=0"):
        prepare_plans(data, 4).of(batch.mirror(torch.tensor([True, False])), 0)


def test_data_without_plans_is_refused_in_a_sentence(tmp_path):
    make_data_folder(tmp_path / "data")
    config = replace(family_of(PLANNER).config("smoke", PLANNER), **QUICK)
    with pytest.raises(DataError, match="1_ann_0_0_0 has no annotated plan"):
        train(
            config,
            family_of(PLANNER).make_task,
            tmp_path / "data",
            tmp_path / "out",
            helpers=BUNDLED_WEIGHTS,
        )
