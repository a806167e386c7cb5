from dataclasses import replace

import numpy as np
import pytest
import torch

from model.systems.matching.config import HEARING_JUDGE
from model.systems.matching.network import TRACKS
from model.systems.matching.task import contrastive_loss, make_task, share_right
from model.systems.registry import family_of
from model.training.task import TaskSetup
from tests.model.systems.matching.made import made_data, tiny_config, trained


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    return trained(tmp_path_factory.mktemp("matching"))


def windows(data, split, task, size):
    rng = np.random.default_rng(1)
    return data.window_batch(data.of_split(split), task.window_frames, size, rng)


def test_a_judge_learns_which_speech_belongs_and_only_where_it_shows(learned):
    task, data = learned
    batch = windows(data, "val", task, 16)
    found = task.validate(batch, torch.Generator().manual_seed(0))
    assert found["arms_share_right"] > 0.95
    # Nothing moves there: all are tied, or told apart by one rounding error that all motions share,
    # as often wrongly as rightly. Which of the two depends on the processor.
    assert found["trunk_share_right"] < 0.1 or found["trunk_share_right"] == 0.5
    assert found["arm_speed"] < 0.3 * 0.3  # of an error of .3 where nothing is told
    strangers = replace(batch, speech=batch.speech.roll(1, dims=0))
    assert task.validate(strangers, torch.Generator())["arms_share_right"] < 0.7


def test_a_motion_that_lags_far_behind_its_speech_is_found_out(learned):
    task, data = learned
    batch = windows(data, "val", task, 16)
    late = replace(batch, poses=batch.poses.roll(30, dims=1))
    assert task.validate(late, torch.Generator())["arms_share_right"] < 0.7


def test_the_registry_knows_the_judge_and_its_windows_hold_all_pieces(tmp_path):
    family = family_of(HEARING_JUDGE)
    assert family.trained == (HEARING_JUDGE,) and family.systems == ()
    config = family.config("demo", HEARING_JUDGE)
    assert config.piece_frames == 300 and config.augment_speech and config.augmented_copies == 1
    with pytest.raises(ValueError, match="no config 'huge'"):
        family.config("huge", HEARING_JUDGE)
    task = family.make_task(tiny_config(pieces=3), made_data(tmp_path), TaskSetup(tmp_path))
    assert task.window_frames == 180
    assert task.normaliser.mean.shape == (len(TRACKS),)


def test_speech_is_heard_through_other_microphones_in_training_only(tmp_path):
    data = made_data(tmp_path, num_frames=300, count=2)
    config = replace(tiny_config(), augment_speech=True, learning_rate=0.0)
    task = make_task(config, data, TaskSetup(tmp_path))
    batch = windows(data, "train", task, 4)
    generators = [torch.Generator().manual_seed(seed) for seed in (0, 1)]
    heard = [task.step(0, batch, generator)["arms"] for generator in generators]
    assert heard[0] != heard[1]
    told = [task.validate(batch, generator)["arms"] for generator in generators]
    assert told[0] == told[1]


def test_contrastive_loss_asks_both_ways():
    assert contrastive_loss(torch.zeros(8, 8)) == pytest.approx(np.log(8))
    assert contrastive_loss(100 * torch.eye(8)) < 1e-6
    one_speech_for_all = torch.zeros(8, 8)
    one_speech_for_all[:, 0] = 100.0  # every motion prefers the first speech
    assert contrastive_loss(one_speech_for_all) > 40
    assert contrastive_loss(one_speech_for_all.T) == contrastive_loss(one_speech_for_all)


def test_share_right_leaves_out_the_own_speech():
    assert share_right(torch.eye(3)) == 1
    assert share_right(-torch.eye(3)) == 0
    agreements = torch.tensor([[0.5, 0.1, 0.9], [0.0, 1.0, 0.0], [2.0, 2.0, 1.0]])
    assert share_right(agreements) == pytest.approx(0.5)
