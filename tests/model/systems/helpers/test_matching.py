"""The judge that hears which motion belongs to which speech: its tracks, losses and training."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from conventions.joints import JOINT_INDEX
from model.motion.packing import Normaliser
from model.motion.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from model.systems.helpers.matching import (
    LOG_SPEED_OFFSET_RAD_S,
    TRACKS,
    TRACKS_BY_PART,
    MatchingNetwork,
    SpeechMotionMatcher,
    agreement,
    centred_log_arm_speed,
    speed_and_jaw_features,
)
from model.systems.helpers.task import contrastive_loss, make_task, pairwise_matching_accuracy
from model.training.task import TaskSetup
from tests.model.made import shaken
from tests.model.systems.helpers.made_matching import SHAPE, made_data, tiny_config

ALL = tuple(TRACKS_BY_PART)


def turning(joint: str, rad_s: float, frames: int = 60) -> torch.Tensor:
    """One joint that turns about its z axis at a steady rate."""
    poses = torch.zeros(1, frames, 55, 3)
    poses[0, :, JOINT_INDEX[joint], 2] = torch.arange(frames) / 30 * rad_s
    return poses.flatten(-2)


def drawn(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def track_of(poses: torch.Tensor, name: str) -> torch.Tensor:
    return speed_and_jaw_features(poses)[0, :, TRACKS.index(name)]


def wandering(batch: int, frames: int = 300, seed: int = 0) -> torch.Tensor:
    """Poses whose joints all turn, now faster, now slower."""
    return 0.02 * drawn(batch, frames, 165, seed=seed).cumsum(1)


@pytest.fixture(scope="module")
def judge() -> SpeechMotionMatcher:
    torch.manual_seed(0)
    network = shaken(MatchingNetwork(SHAPE), by=0.1).requires_grad_(False)
    statistics = Normaliser(torch.full((len(TRACKS),), -1.0), torch.full((len(TRACKS),), 0.5))
    return SpeechMotionMatcher(network, statistics, "")


@pytest.mark.parametrize("rad_s", [0.0, 0.5, 4.0])
def test_a_track_is_the_log_of_the_speed_of_its_joint_alone(rad_s):
    tracks = speed_and_jaw_features(turning("left_elbow", rad_s))[0]
    moving = TRACKS.index("left_elbow")
    expected = torch.full((60,), np.log(rad_s + LOG_SPEED_OFFSET_RAD_S))
    torch.testing.assert_close(tracks[:, moving], expected, atol=1e-3, rtol=0)
    others = [k for k, name in enumerate(TRACKS) if k != moving and name != "jaw_open"]
    assert (tracks[:, others] - np.log(LOG_SPEED_OFFSET_RAD_S)).abs().max() < 1e-4


def test_tracks_do_not_depend_on_the_pose():
    poses = wandering(1)
    turned = matrix_from_axis_angle(poses.unflatten(-1, (55, 3)))
    offset = matrix_from_axis_angle(torch.tensor([0.3, -0.8, 0.5]))
    elsewhere = axis_angle_from_matrix(offset @ turned)
    jaw = JOINT_INDEX["jaw"]
    elsewhere[:, :, jaw] = poses.unflatten(-1, (55, 3))[:, :, jaw]
    single = [k for k, name in enumerate(TRACKS) if name not in ("head", "trunk")]
    found, moved = (speed_and_jaw_features(p)[..., single] for p in (poses, elsewhere.flatten(-2)))
    torch.testing.assert_close(moved, found, atol=1e-3, rtol=0)


def test_a_head_held_still_against_a_turning_neck_turns_no_further():
    poses = turning("neck", 2.0).unflatten(-1, (55, 3))
    poses[:, :, JOINT_INDEX["head"]] = -poses[:, :, JOINT_INDEX["neck"]]
    assert track_of(poses.flatten(-2), "head").exp().max() < LOG_SPEED_OFFSET_RAD_S + 1e-3


def test_tremble_is_hardly_speed():
    poses = torch.zeros(1, 60, 55, 3)
    poses[0, ::2, JOINT_INDEX["right_wrist"], 0] = 0.02  # from frame to frame .6 rad/s
    assert (
        track_of(poses.flatten(-2), "right_wrist")[6:-6].exp().max() < LOG_SPEED_OFFSET_RAD_S + 0.02
    )


def test_the_arms_speed_is_that_of_shoulders_and_elbows_at_half_the_rate():
    tracks = torch.zeros(1, 31, len(TRACKS))
    tracks[..., TRACKS.index("left_elbow")] = torch.arange(31.0)
    tracks[..., TRACKS.index("left_wrist")] = torch.randn(31)
    found = centred_log_arm_speed(tracks)[0, :, 0]
    assert found.shape == (16,) and found.mean().abs() < 1e-5
    torch.testing.assert_close(found.diff()[:-1], torch.full((14,), 0.5))


def test_agreement_is_the_correlation_of_tracks():
    heard, seen = drawn(3, 50, 1), drawn(2, 50, 1, seed=1)
    heard, seen = (x - x.mean(1, keepdim=True) for x in (heard, seen))
    expected = np.corrcoef(seen[1, :, 0], heard[2, :, 0])[0, 1]
    found = agreement(seen, heard)
    assert found.shape == (2, 3) and found[1, 2] == pytest.approx(expected, abs=1e-5)
    torch.testing.assert_close(agreement(0.1 * seen, 5 * heard), found)
    assert agreement(1e-7 * seen, heard).abs().max() < 1e-2  # rounding is not movement


def test_a_voice_a_microphone_and_a_lively_habit_do_not_count(judge):
    poses, speech = (wandering(2), drawn(3, 300, 68))
    found = judge.agreements(poses, speech, ALL)
    assert found.shape == (2, 3) and found.abs().max() > 0.01
    colour = drawn(68, seed=2)
    torch.testing.assert_close(
        judge.agreements(poses, speech + colour, ALL), found, atol=1e-4, rtol=0
    )
    tracks = judge.normaliser.normalise(speed_and_jaw_features(poses))
    livelier = judge.network.encode_motion(tracks + 3.0)
    for part, track in judge.network.encode_motion(tracks).items():
        torch.testing.assert_close(livelier[part], track, atol=1e-3, rtol=0)


def test_who_stands_still_agrees_with_nothing(judge):
    still = wandering(1)[:, :1].expand(1, 300, 165)
    assert judge.agreements(still, drawn(4, 300, 68), ALL).abs().max() < 1e-3
    quiet = drawn(1, 1, 68).expand(1, 300, 68)
    assert judge.agreements(wandering(1), quiet, ALL).abs().max() < 1e-3


@pytest.mark.parametrize(
    ("joint", "part"), [("jaw", "face"), ("left_elbow", "arms"), ("head", "trunk")]
)
def test_each_part_is_judged_by_its_own_joints(judge, joint, part):
    poses, speech = (wandering(1), drawn(2, 300, 68))
    other = poses.clone().unflatten(-1, (55, 3))
    other[:, :, JOINT_INDEX[joint]] = wandering(1, seed=9).unflatten(-1, (55, 3))[:, :, 0]
    for name in TRACKS_BY_PART:
        pair = [judge.agreements(p, speech, (name,)) for p in (poses, other.flatten(-2))]
        assert torch.equal(*pair) == (name != part)
    summed = sum(judge.agreements(poses, speech, (name,)) for name in ("arms", "trunk"))
    torch.testing.assert_close(judge.agreements(poses, speech, ("arms", "trunk")), summed)


def test_speech_is_heard_through_other_microphones_in_training_only(tmp_path):
    data = made_data(tmp_path, num_frames=300, count=2)
    config = replace(tiny_config(), augment_speech=True, learning_rate=0.0)
    task = make_task(config, data, TaskSetup(tmp_path))
    rng = np.random.default_rng(1)
    batch = data.draw_windows(data.clips_of_split("train"), task.window_frames, 4, rng)
    generators = [torch.Generator().manual_seed(seed) for seed in (0, 1)]
    assert task.window_frames == 120 and task.normaliser.mean.shape == (len(TRACKS),)  # two pieces
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


def test_matching_accuracy_leaves_out_the_own_speech():
    assert pairwise_matching_accuracy(torch.eye(3)) == 1
    assert (
        pairwise_matching_accuracy(-torch.eye(3))
        == pairwise_matching_accuracy(torch.zeros(3, 3))
        == 0
    )
    agreements = torch.tensor([[0.5, 0.1, 0.9], [0.0, 1.0, 0.0], [2.0, 2.0, 1.0]])
    assert pairwise_matching_accuracy(agreements) == pytest.approx(0.5)
