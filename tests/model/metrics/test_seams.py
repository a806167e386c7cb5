"""Jerk that comes again after some frames is found, whatever their number; people have none."""

import math
from dataclasses import replace

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX, LOWER_BODY
from model.diagnostics import analyse_raw
from model.formats.read import read_any_motion
from model.generation.base import Windowing
from model.metrics.seams import (
    JerkPeriod,
    find_jerk_period,
    mean_jerk_by_frame_of_period,
    recurring_jerk,
    seam_jerk_ratio,
)
from model.metrics.smoothness import derivative_magnitudes
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion
from model.motion.tracks import track_points
from tests.helpers import beat2_folder, foreign_folder
from tests.model.motion.made import posed

SKELETON = open_body_skeleton()
JUMP_M = 0.05


def rough_points(num_frames: int, seed: int = 0) -> np.ndarray:
    """Five points on slow paths with a little white noise: (T, 5, 3)."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(num_frames)[:, None, None] / 30
    slow = 0.1 * np.sin(2 * np.pi * rng.uniform(0.2, 1, (1, 5, 3)) * time_s)
    return slow + 1e-3 * rng.standard_normal((num_frames, 5, 3))


def jumping_points(num_frames: int, first: int, every: int, is_kink: bool = False) -> np.ndarray:
    """The pose jumps, or turns sharply, back and forth at these frames."""
    points, frames = rough_points(num_frames), np.arange(num_frames)
    for index, frame in enumerate(range(first, num_frames, every)):
        since = frames - frame
        change = np.maximum(since, 0) if is_kink else since >= 0
        points += (-1) ** index * JUMP_M * change[:, None, None]
    return points


def jerk_of(points: np.ndarray) -> np.ndarray:
    return derivative_magnitudes(points, 3).mean(axis=1)


def test_seams_of_a_motion_without_any_are_like_the_rest():
    ratios = [seam_jerk_ratio(jerk_of(rough_points(600, seed=seed)), 52, 8) for seed in range(20)]
    assert abs(np.mean(ratios) - 1) < 0.05
    assert 0.75 < min(ratios) and max(ratios) < 1.3


@pytest.mark.parametrize("is_kink", [False, True])
def test_a_pop_anywhere_in_a_join_is_found_and_elsewhere_not_blamed_on_it(is_kink):
    for offset in range(-1, 10):
        assert seam_jerk_ratio(jerk_of(jumping_points(600, 52 + offset, 52, is_kink)), 52, 8) > 4
    assert seam_jerk_ratio(jerk_of(jumping_points(600, 52 + 30, 52, is_kink)), 52, 8) < 0.5
    other = jumping_points(600, 40, 40, is_kink)  # other windows have other joins
    assert seam_jerk_ratio(jerk_of(other), 40, 8) > 4 and seam_jerk_ratio(jerk_of(other), 52, 8) < 2


def test_a_pop_at_any_offset_stands_out_at_its_phase():
    for offset in range(0, 52, 3):
        found = mean_jerk_by_frame_of_period(jerk_of(jumping_points(620, 52 + offset, 52)), 52)
        assert found.argmax() == offset
        assert found.max() > 5 * np.median(found)


def test_one_window_has_no_seams():
    assert math.isnan(seam_jerk_ratio(jerk_of(rough_points(52)), 52, 8))
    assert math.isnan(seam_jerk_ratio(jerk_of(rough_points(60)), 52, 8))
    assert not math.isnan(seam_jerk_ratio(jerk_of(rough_points(65)), 52, 8))
    assert np.isnan(mean_jerk_by_frame_of_period(jerk_of(rough_points(20)), 52)).sum() == 52 - 17


def test_a_jump_in_one_window_does_not_recur():
    once, always = rough_points(600), jumping_points(600, 52 + 7, 52)
    once[104 + 7 :] += 0.5
    assert recurring_jerk(jerk_of(once), 52).ratio < 1.5
    found = recurring_jerk(jerk_of(always), 52)
    assert found.frame_in_period in (6, 7, 8) and found.ratio > 5
    assert recurring_jerk(jerk_of(always[: 52 * 4 - 2]), 52).frame_in_period is None


def rough(num_frames: int, seed: int = 0) -> Motion:
    """Joints that turn at random below 6 Hz or so, as loud at any frame as at another."""
    draws = np.random.default_rng(seed).standard_normal((num_frames + 8, 165))
    kernel = np.hanning(9)
    poses = np.apply_along_axis(lambda one: np.convolve(one, kernel, "valid"), 0, 0.006 * draws)
    return replace(posed(num_frames), poses=poses.astype(np.float32))


def changed(motion: Motion, joints: list[int] | slice, by: np.ndarray) -> Motion:
    poses = motion.poses.copy().reshape(-1, 55, 3)
    poses[:, joints] += by
    return replace(motion, poses=poses.reshape(-1, 165))


def with_jumps(motion: Motion, period: int, joint: str | None = None, first: int = 5) -> Motion:
    """Turned by .04 rad back and forth every ``period`` frames."""
    windows = (np.arange(motion.num_frames) + period - first) // period
    joints = slice(None) if joint is None else [JOINT_INDEX[joint]]
    return changed(motion, joints, 0.04 * (windows % 2)[:, None, None] * np.array([0, 0, 1]))


def period_of(motion: Motion) -> JerkPeriod | None:
    return find_jerk_period(track_points(motion, SKELETON))


@pytest.mark.parametrize("period", [8, 33, 52, 60, 64, 124, 240])
def test_jumps_are_found_at_their_period_and_frame(period):
    found = period_of(with_jumps(rough(6 * period + 200), period, "right_shoulder"))
    assert found is not None and (found.frames, found.kind) == (period, "pulses")
    assert found.part in ("right arm", "right hand")
    assert (found.frame_in_period - 5) % period in (0, 1, period - 1)
    assert found.peak_over_median > 1.5
    for frame in found.worst_frames:
        assert (frame - found.frame_in_period) % period == 0


@pytest.mark.parametrize("period", [2, 3, 4, 7])
def test_ripple_of_the_legs_is_found_in_the_legs(period):
    steps = np.random.default_rng(1).standard_normal((900 // period + 1, 8, 3))
    hold = np.repeat(steps, period, axis=0)[:900]  # a code each `period` frames
    found = period_of(changed(rough(900), list(LOWER_BODY)[1:], 0.004 * hold))
    assert found is not None and (found.frames, found.part) == (period, "legs")


def test_what_repeats_nothing_has_no_period():
    found = [period_of(rough(length, seed)) for length in (300, 900) for seed in range(4)]
    found += [period_of(rough(length)) for length in (1, 4, 8, 40)]
    found += [period_of(posed(300)), period_of(with_jumps(rough(900), 450))]  # one jump
    beat = 0.1 * (np.sin(2 * np.pi * np.arange(900) / 10) > 0.9)
    beat[:300] = beat[360:] = 0.0  # two seconds of a hand that beats
    beat = beat[:, None, None] * np.array([1, 0, 0])
    found.append(period_of(changed(rough(900), [JOINT_INDEX["left_wrist"]], beat)))
    assert found == [None] * 15


def test_seams_are_folded_on_what_is_known_or_found():
    jumps = with_jumps(rough(900), 64, first=0)
    found = analyse_raw(jumps, SKELETON).metrics.seams
    assert found.fold_period_frames == len(found.jerk_by_frame_in_period_m_s3) == 64
    assert found.jerk_by_frame_in_period_m_s3.argmax() in (0, 1, 63)
    assert np.isnan(found.seam_jerk_ratio)  # a period has no first frame of its own
    known = analyse_raw(jumps, SKELETON, windows=Windowing(64, 0)).metrics.seams
    assert known.seam_jerk_ratio > 1.5 and known.fold_period_frames == 64
    nothing = analyse_raw(rough(900), SKELETON).metrics.seams
    assert nothing.fold_period_frames is None and not len(nothing.jerk_by_frame_in_period_m_s3)
    hip = analyse_raw(with_jumps(rough(900), 30, "left_hip", first=7), SKELETON).metrics.seams
    assert hip.jerk_by_frame_in_period_m_s3.argmax() in (6, 7, 8)


@pytest.mark.parametrize(("advance", "overlap"), [(1, 0), (-3, 0), (52, 60), (52, -1)])
def test_windows_that_cannot_be_are_refused(advance, overlap):
    with pytest.raises(ValueError, match=f"hop of {advance} and an overlap of {overlap}"):
        Windowing(advance + overlap, overlap)


@pytest.mark.slow
@pytest.mark.beat2
@pytest.mark.parametrize("joint", [None, "right_shoulder", "left_hip"])
@pytest.mark.parametrize("period", [52, 60, 64, 124])
def test_jumps_planted_in_a_recording_are_found(period, joint):
    recorded = load_motion(beat2_folder() / "smplxflame_30" / "2_scott_0_1_1.npz")
    found = period_of(with_jumps(recorded, period, joint))
    assert found is not None and found.frames == period and found.p_value < 1e-9


@pytest.mark.parametrize(
    ("name", "expected"), [("chgs_3_vq", (4, "legs")), ("mambatalk_2_scott_0_2_2", None)]
)
def test_codes_of_another_system_show_as_a_period(name, expected):
    found = period_of(read_any_motion(foreign_folder() / f"{name}.npz").motion)
    assert (found and (found.frames, found.part)) == expected
