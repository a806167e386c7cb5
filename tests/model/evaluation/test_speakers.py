"""Manner and speakers: how much of a motion is whose, and whose it is."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.data.recordings import read_motion_and_speech
from model.evaluation.classifiers import (
    PIECE_FRAMES,
    SpeakerClassifier,
    SpeakerComparisonClips,
    arm_speaker_effect,
    calm_and_lively_wrist_speeds,
    cut_and_append_silence,
    fit_discriminant,
    fit_speaker_classifier,
    style_features,
)
from model.generation.windows import GenerateOptions, generate_motion
from model.metrics.speech_effect import (
    arm_axis_angle_correlation,
    silence_speed_ratio,
    smoothed_arm_speed_sum_deg_s,
)
from model.motion.motion import Motion, first_frames, save_motion
from model.sampling.samplers import DEFAULT_SAMPLING, noise_seed_of_clip
from model.systems.registry import load_system
from tests.helpers import smooth_motion_example
from tests.model.made import made_speech, make_data_folder
from tests.model.metrics.test_speech_effect import FRAMES, motion_of

SPEAKERS = {"june": 1, "hana": 2, "gus": 3}


def motions_of(share: float) -> dict:
    """By speaker and noise seed; the speaker decides ``share`` of the speed's variance."""
    return {
        (name, seed): motion_of(number, seed, share)
        for name, number in SPEAKERS.items()
        for seed in range(3)
    }


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_the_share_of_the_speaker_is_that_of_every_pair_one_by_one(share):
    motions = motions_of(share)
    alike: dict[str, list[float]] = {"speaker": [], "neither": []}
    for ((one, seed), a), ((other, seed_), b) in combinations(motions.items(), 2):
        if seed != seed_:
            r = float(np.corrcoef(*map(smoothed_arm_speed_sum_deg_s, (a, b)))[0, 1])
            alike["speaker" if one == other else "neither"].append(r)
    found = arm_speaker_effect(motions)
    wanted = np.mean(alike["speaker"]) - np.mean(alike["neither"])
    assert found["by_speaker"] == pytest.approx(wanted, abs=1e-6)
    assert found["by_speaker"] == pytest.approx(share, abs=0.25)


def test_rotations_of_the_same_noise_are_alike_whoever_speaks():
    same = {(name, seed): motion_of(7, seed, 0.0) for name in SPEAKERS for seed in range(2)}
    assert arm_speaker_effect(same)["arm_rotations_same_noise"] == pytest.approx(1 / 12, abs=1e-6)


def swinging(speed: float) -> Motion:
    """The left upper arm turns at a steady speed, radians a second."""
    motion = motion_of(0, 0, 0.5)
    poses = np.zeros_like(motion.poses)
    poses[:, 3 * 16 + 2] = speed * np.arange(FRAMES) / 30
    return Motion(poses, motion.trans, motion.expressions, "arkit52", motion.betas)


def test_a_calm_speaker_moves_the_wrists_so_much_less():
    calm, lively = swinging(0.25), swinging(0.5)
    motions = {("june", 0): lively, ("hana", 0): calm, ("hana", 1): lively}
    slow, fast = calm_and_lively_wrist_speeds(motions, ("hana", "june")).values()
    assert slow == pytest.approx(0.75 * fast, rel=1e-3)
    assert 0.4 < fast / 0.5 < 0.65, "metres from shoulder to wrist"


def moved(seconds: float, seed: int, size: float) -> Motion:
    """Arms that swing ``size`` times as far."""
    motion = smooth_motion_example(round(30 * seconds), seed)
    poses = motion.poses.reshape(motion.num_frames, -1, 3).copy()
    arms = [
        JOINT_INDEX[f"{side}_{part}"]
        for side in ("left", "right")
        for part in ("shoulder", "elbow")
    ]
    mean = poses[:, arms].mean(0)
    poses[:, arms] = mean + size * (poses[:, arms] - mean)
    return Motion(**{**vars(motion), "poses": poses.reshape(motion.poses.shape)})


def test_the_discriminant_is_the_gaussian_one_of_equal_covariances():
    rng = np.random.default_rng(0)
    mix = rng.standard_normal((3, 3))
    centres = {"ann": np.zeros(3), "bob": np.array([1.0, 0.5, 0.0]), "eve": np.array([0.0, 2, 1])}
    own = {who: at + rng.standard_normal((4000, 3)) @ mix for who, at in centres.items()}
    judge = fit_discriminant(own)
    asked = rng.standard_normal((200, 3)) @ mix + 0.5
    covariance = mix.T @ mix
    off = [asked - at for at in centres.values()]
    wanted = np.stack(
        [-0.5 * np.einsum("ni,ij,nj->n", x, np.linalg.inv(covariance), x) for x in off], axis=1
    )
    told = asked @ judge.weights.T + judge.bias
    agree = told.argmax(1) == wanted.argmax(1)
    assert agree.mean() > 0.9  # shrinkage and chance leave a little


def test_a_lively_and_a_calm_speaker_are_told_and_short_motion_is_not():
    pieces = {
        who: np.concatenate([style_features(moved(10, 10 * seed + k, size)) for seed in range(8)])
        for k, (who, size) in enumerate({"calm": 0.4, "lively": 1.0}.items())
    }
    judge = fit_discriminant(pieces)
    assert judge.accuracy_of_speaker(moved(30, 99, 0.4), "calm") == 1.0
    assert judge.accuracy_of_speaker(moved(30, 99, 1.0), "lively") == 1.0
    assert judge.accuracy_of_speaker(moved(30, 99, 1.0), "calm") == 0.0
    assert judge.accuracy_of_speaker(moved(30, 99, 1.0), "nobody") is None
    assert judge.accuracy_of_speaker(moved(9.9, 99, 1.0), "calm") is None
    assert judge.measures([moved(10, 98, 0.4), moved(10, 97, 1.0)], "calm") == {"speaker_told": 0.5}
    assert judge.measures([], "calm") == {}


def test_it_learns_from_the_training_split_alone(tmp_path, data_folder):
    folder = make_data_folder(tmp_path / "data", seconds=12)
    judge = fit_speaker_classifier(folder, ["ann", "bob", "eve"])
    assert isinstance(judge, SpeakerClassifier) and judge.speakers == ("ann", "bob")
    path = folder / "smplxflame_30" / "1_ann_0_2_2.npz"  # of the validation split
    save_motion(moved(12, 5, 3.0), path)
    again = fit_speaker_classifier(folder, ["ann", "bob", "eve"])
    np.testing.assert_array_equal(again.weights, judge.weights)
    save_motion(moved(12, 5, 3.0), folder / "smplxflame_30" / "1_ann_0_0_0.npz")
    other = fit_speaker_classifier(folder, ["ann", "bob", "eve"])
    assert not np.allclose(other.weights, judge.weights)
    assert (
        fit_speaker_classifier(data_folder, ["ann", "bob"]) is None
    )  # no recording is long enough


@pytest.mark.parametrize(("frames", "count"), [(299, 0), (300, 1), (599, 1), (600, 2)])
def test_a_rest_of_less_than_a_piece_is_left_out(frames, count):
    assert len(style_features(smooth_motion_example(frames, 1))) == count == frames // PIECE_FRAMES


CLIPS = ["1_ann_0_0_0", "2_bob_0_1_1", "1_ann_0_2_2"]
PAIR = "bob", "ann"


def test_silence_follows_ten_seconds_or_what_there_is():
    for given, kept in ((4, 4), (12, 10)):
        speech = made_speech(16_000 * given)
        heard = cut_and_append_silence(speech)
        assert heard.num_motion_frames == 30 * (kept + 5)
        end = 16_000 * kept
        np.testing.assert_array_equal(heard.waveform[:end], speech.waveform[:end])
        assert not heard.waveform[end:].any()


def test_numbers_are_those_of_motions_made_one_by_one(data_folder, weights):
    found = load_system("globaldiff/local", weights)
    system = replace(found, samplers=(replace(found.samplers[0], default_steps=1),))
    few = SpeakerComparisonClips.choose(data_folder, CLIPS[:1], [system], PAIR)
    name, speech = CLIPS[0], read_motion_and_speech(data_folder, CLIPS[0])[1]
    found = few.few_clip_metrics(system, name, speech, DEFAULT_SAMPLING)
    made = {}
    for speaker in PAIR:
        options = GenerateOptions(speaker, seed=noise_seed_of_clip(0, name), num_samples=2)
        made[speaker] = generate_motion(system, cut_and_append_silence(speech), options)
    spoken = {who: [first_frames(motion, 120) for motion in own] for who, own in made.items()}
    motions = {(who, seed): m for who, own in spoken.items() for seed, m in enumerate(own)}
    speeds = calm_and_lively_wrist_speeds(motions, PAIR)
    assert {name: found[name] for name in speeds} == pytest.approx(speeds, rel=1e-6)
    alike = [arm_axis_angle_correlation(*pair) for pair in zip(*spoken.values(), strict=True)]
    assert found["arm_rotations_other_speaker"] == pytest.approx(np.mean(alike), abs=1e-6)
    silent = [
        silence_speed_ratio(motion, np.arange(270) < 120)["arms_in_silence"]
        for own in made.values()
        for motion in own
    ]
    assert found["arms_in_silence"] == pytest.approx(np.mean(silent), rel=1e-6)
    assert few.few_clip_metrics(system, CLIPS[1], speech, DEFAULT_SAMPLING) == {}, (
        "not among the few"
    )
