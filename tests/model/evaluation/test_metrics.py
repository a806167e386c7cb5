"""Beats, Fréchet distances and diversity against textbooks and slow versions."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.linalg import sqrtm

from model.evaluation import frechet
from model.evaluation.clips import expression_mse, mean_pairwise_l1
from model.evaluation.frechet import window_diversity
from model.metrics import beats, reference_error
from model.metrics.reference_error import l1_distance_to_mean
from model.motion.motion import first_frames
from model.motion.packing import MOTION_DIM, Normaliser
from model.networks.autoencoder import FrozenMotionEncoder, MotionAutoencoder
from model.systems.helpers.config import AUTOENCODERS, EVALUATION_ENCODER
from tests.helpers import smooth_motion_example
from tests.model.made import shaken


def moving_at(stops_s: list[float], seconds: float = 12.0) -> np.ndarray:
    """Joints (T, 55, 3) that slow down at the given times and move at 1 m/s between them."""
    time = np.arange(round(30 * seconds)) / 30
    nearest = np.abs(time[:, None] - np.array(stops_s)).min(1)
    speed = np.clip(0.4 + 3 * nearest, None, 1.0) + 0.001 * time
    return np.repeat(np.cumsum(speed / 30)[:, None, None], 55, 1) * np.array([1.0, 0, 0])


STOPS = [2.5, 4.1, 5.3, 7.0, 8.2, 9.6]
ONES = np.ones(13)


def test_beats_are_found_at_the_stops():
    speeds = beats.joint_speeds(moving_at(STOPS)[:, beats.BEAT_JOINTS])
    found = beats.motion_beats(speeds, ONES)
    assert len(found) == 13
    np.testing.assert_allclose(found[0], STOPS, atol=0.05)
    assert all(len(joint) == 0 for joint in beats.motion_beats(speeds, 10 * ONES))  # too slow
    assert beats.beat_align_audio_to_motion(np.array([3.0]), [np.array([])] * 13) == 0


def test_alignment_is_one_in_time_and_at_chance_level_out_of_time():
    positions = moving_at(STOPS)
    right = beats.beat_scores(positions, np.array(STOPS), ONES)
    late = beats.beat_scores(positions, np.array(STOPS) + 0.3, ONES)
    for name in ("beat_align_audio_to_motion", "beat_align_motion_to_audio"):
        assert right[name] > 0.9
        assert right[f"{name}_chance"] < right[name] - 0.2
        assert late[name] < right[name] - 0.3
    more = np.array([0.4, 1.2, *STOPS, 11.3])  # near the ends
    assert beats.beat_scores(positions, more, ONES) == right


def test_the_directions_differ_where_one_side_has_more_beats():
    few, many = np.array([3.0, 6.0]), [np.arange(2.0, 10.0, 0.5)]
    assert beats.beat_align_audio_to_motion(few, many) == 1.0
    assert beats.beat_align_motion_to_audio(few, many) == pytest.approx(2 / 16, abs=1e-3)
    # one sigma away: exp(-1/2)
    assert beats.beat_align_audio_to_motion(few + 0.3, [few]) == pytest.approx(np.exp(-0.5))


def test_frechet_distance_agrees_with_the_textbook():
    rng = np.random.default_rng(0)
    a = rng.standard_normal((400, 5)) @ rng.standard_normal((5, 5))
    b = rng.standard_normal((300, 5)) @ rng.standard_normal((5, 5)) + 0.5
    cov_a, cov_b = np.cov(a.T), np.cov(b.T)
    expected = np.square(a.mean(0) - b.mean(0)).sum() + np.trace(
        cov_a + cov_b - 2 * sqrtm(cov_a @ cov_b).real
    )
    assert frechet.frechet_distance(a, b) == pytest.approx(expected, rel=1e-6)
    assert frechet.frechet_distance(a, a) == pytest.approx(0, abs=1e-8)
    assert frechet.frechet_distance(a, a + 2) == pytest.approx(20)  # 5 axes, 2 apart


def test_split_half_floor_is_above_zero_and_below_another_distribution():
    rng = np.random.default_rng(0)
    clips = [rng.standard_normal((50, 4)) for _ in range(10)]
    others = [rng.standard_normal((50, 4)) + 1 for _ in range(10)]
    floor, distance = (
        frechet.split_half_baseline(clips),
        frechet.frechet_with_interval(clips, others),
    )
    assert 0 < floor.mean < 0.2 < distance.low <= distance.mean <= distance.high
    assert distance.mean == pytest.approx(4, rel=0.2)


def test_features_are_one_for_every_eight_frames_and_the_same_for_any_cut():
    network = shaken(MotionAutoencoder(EVALUATION_ENCODER)).requires_grad_(False)
    statistics = Normaliser(torch.zeros(MOTION_DIM), torch.ones(MOTION_DIM))
    encoder = FrozenMotionEncoder(network, statistics, "")
    motion = smooth_motion_example(400)
    features = frechet.motion_features(encoder, motion)
    assert features.shape == (50, 32)
    start = frechet.motion_features(encoder, first_frames(motion, 213))
    assert start.shape == (26, 32)
    np.testing.assert_allclose(start[:20], features[:20], atol=1e-4)
    assert np.abs(start[-1] - features[25]).max() > 1e-3  # its end is another
    later = replace(
        motion,
        poses=motion.poses[80:],
        trans=motion.trans[80:],
        expressions=motion.expressions[80:],
    )
    rest = frechet.motion_features(encoder, later)
    np.testing.assert_allclose(rest[6:], features[16:], atol=1e-4)
    shape = AUTOENCODERS["fed-encoder"]
    statistics = Normaliser(torch.zeros(52), torch.ones(52))
    face = FrozenMotionEncoder(
        MotionAutoencoder(shape).eval().requires_grad_(False), statistics, ""
    )
    assert frechet.motion_features(face, motion).shape == (50, 32)
    faceless = replace(motion, expression_basis="flame100")
    assert frechet.motion_features(face, faceless) is None
    np.testing.assert_array_equal(frechet.motion_features(encoder, faceless), features)


def test_diversities_are_sums_over_coordinates():
    still, swaying = np.zeros((4, 55, 3)), np.zeros((4, 55, 3))
    swaying[::2, :, 0], swaying[1::2, :, 0] = 0.1, -0.1
    assert l1_distance_to_mean(still) == 0
    assert l1_distance_to_mean(swaying) == pytest.approx(5.5)
    distances = mean_pairwise_l1([still, swaying, swaying[:2]])
    assert distances[0, 1] == distances[1, 0] == pytest.approx(5.5)
    assert distances[1, 2] == 0 and (np.diag(distances) == 0).all()


def slow_diversity(windows: np.ndarray) -> float:
    """Eq. 17 of AsynFusion for one batch, term by term."""
    size = len(windows)
    total = 0.0
    for i in range(size - 1):
        for j in range(i + 1, size):
            for a, b in zip(windows[i].ravel(), windows[j].ravel(), strict=True):
                total += abs(float(a) - float(b)) / windows[i].size
    return 2 / (size * (size - 1)) * total


def test_div_is_the_mean_of_eq_17_over_batches():
    rng = np.random.default_rng(0)
    clips = [
        rng.normal(k, 1.0, (num, 1, 217)).astype(np.float32) for k, num in enumerate((40, 35, 25))
    ]
    found = window_diversity(clips)
    order = np.random.default_rng(0).permutation(100)
    sizes = [len(batch) for batch in reference_error.shuffled_window_batches(120)]
    assert sizes == [50, 50, 20]
    assert sorted(np.concatenate(list(reference_error.shuffled_window_batches(120)))) == list(
        range(120)
    )
    halves = [np.concatenate(clips)[batch] for batch in (order[:50], order[50:])]
    for name, dim in (("div", 217), ("div_gesture", 165)):
        expected = np.mean([slow_diversity(half[..., :dim]) for half in halves])
        assert found[name].mean == pytest.approx(expected, rel=1e-5)
        assert found[name].low < found[name].mean <= found[name].high
    mixed = window_diversity([clips[0][..., :165], *clips[1:]])  # one clip without a face
    assert mixed == {"div_gesture": found["div_gesture"]}
    few = window_diversity([clip[:4] for clip in clips])  # less than a batch
    assert few["div"].mean == pytest.approx(
        slow_diversity(np.concatenate([clip[:4] for clip in clips])), rel=1e-5
    )


def test_a_clip_drawn_twice_is_no_pair_with_itself():
    same = [np.full((1, 30, 217), value, np.float32) for value in (0.0, 1.0, 2.0)]
    found = window_diversity(same)["div"]
    assert found.mean == pytest.approx(4 / 3)  # of 1, 1 and 2
    assert found.high == pytest.approx(2)  # two of one end and one of the other: 2 and 2
    assert window_diversity([np.zeros((1, 30, 217), np.float32)]) == {}


def test_windows_hold_every_second_frame_end_to_end():
    motion = smooth_motion_example(150)
    windows = reference_error.diversity_windows(motion)
    assert windows.shape == (2, 30, 217)
    np.testing.assert_allclose(windows[1, 3, :165], motion.poses[66], atol=1e-5)
    np.testing.assert_array_equal(windows[1, 3, 165:], motion.expressions[66, :52])
    turned = motion.poses.copy()
    axis = turned[:, :3] / np.linalg.norm(turned[:, :3], axis=1, keepdims=True)
    turned[:, :3] += 2 * np.pi * axis  # the same rotation, told in another way
    np.testing.assert_allclose(
        reference_error.diversity_windows(replace(motion, poses=turned)), windows, atol=1e-4
    )
    assert reference_error.diversity_windows(first_frames(motion, 59)).shape == (0, 30, 217)
    flame = replace(motion, expression_basis="flame100")
    assert reference_error.diversity_windows(flame).shape == (2, 30, 165)


def test_face_error_looks_at_the_columns_in_use():
    motion = smooth_motion_example(30)
    other = smooth_motion_example(30)
    other.expressions[:, :52] += 0.5
    assert expression_mse(other, motion) == pytest.approx(0.25, rel=1e-5)
