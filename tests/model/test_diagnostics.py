"""Each measure on signals whose answer is known."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from conventions.joints import FINGERTIP_NAMES, chain_to_root
from model.diagnostics import diagnose, measures
from model.measures import smoothness
from model.measures.posture import foot_slide
from model.measures.seams import jerk_by_window_phase, seam_jerk_ratio
from model.measures.smoothness import velocity_spectrum
from model.motion import tracks
from model.motion.filtering import smooth_motion
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames, load_motion
from model.motion.tracks import track_points
from tests.helpers import ROOT, beat2_folder, smooth_motion_example

SKELETON = open_body_skeleton()


def told(*motions: Any, **options: Any) -> dict[str, Any]:
    """What the file tells."""
    return diagnose(*motions, **options).as_json()


def seconds(num_frames: int) -> np.ndarray:
    return np.arange(num_frames) / 30


def moving_root(trans: np.ndarray) -> Motion:
    """A stiff body whose every point moves with ``trans (T, 3)``."""
    frames = len(trans)
    return Motion(
        poses=np.zeros((frames, 165), dtype=np.float32),
        trans=trans.astype(np.float32),
        expressions=np.zeros((frames, 100), dtype=np.float32),
        expression_basis="flame100",
        betas=np.zeros(300, dtype=np.float32),
    )


def along_x(x: np.ndarray) -> np.ndarray:
    return np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)


def power_above_5hz(path: np.ndarray) -> float:
    spectrum = velocity_spectrum(np.diff(path, axis=0) * 30)
    assert spectrum is not None
    return float(spectrum.share_above(5.0))


def rough_points(num_frames: int, level: float = 1e-3, seed: int = 0) -> np.ndarray:
    """Five points on slow paths with a little white noise: (T, 5, 3)."""
    rng = np.random.default_rng(seed)
    time_s = seconds(num_frames)[:, None, None]
    slow = 0.1 * np.sin(2 * np.pi * rng.uniform(0.2, 1, (1, 5, 3)) * time_s)
    return slow + level * rng.standard_normal((num_frames, 5, 3))


def test_derivatives_of_a_cubic_are_its_own():
    t = seconds(60)
    path = along_x(2 * t**3)
    # The third difference of a cubic is exact; lower ones are the mean over their frames.
    np.testing.assert_allclose(smoothness.derivative_magnitudes(path, 3), 12, rtol=1e-6)
    np.testing.assert_allclose(smoothness.derivative_magnitudes(path, 2), 12 * t[1:-1], rtol=1e-9)
    still = smoothness.derivative_magnitudes(along_x(0.5 * t), 1)
    np.testing.assert_allclose(still, 0.5)
    assert smoothness.derivative_magnitudes(path[:3], 3).shape == (0,)


@pytest.mark.parametrize(("hertz", "above"), [(2.0, 0.0), (4.0, 0.0), (6.5, 1.0), (10.0, 1.0)])
def test_power_of_one_sine_lies_on_its_side_of_5_hz(hertz, above):
    share = power_above_5hz(along_x(np.sin(2 * np.pi * hertz * seconds(300))))
    assert abs(share - above) < 0.01


def test_power_of_two_sines_divides_as_their_velocities():
    t = seconds(1200)
    low, high = 2.0, 8.0
    path = along_x(np.sin(2 * np.pi * low * t) + 0.1 * np.sin(2 * np.pi * high * t))
    # Differencing over one frame weighs a frequency with sin(pi f / 30), not with f.
    weights = [np.sin(np.pi * low / 30) ** 2, (0.1 * np.sin(np.pi * high / 30)) ** 2]
    assert abs(power_above_5hz(path) - weights[1] / sum(weights)) < 0.003


def test_white_velocity_has_two_thirds_of_its_power_above_5_of_15_hz():
    path = np.cumsum(np.random.default_rng(0).standard_normal((6000, 3)), axis=0)
    assert abs(power_above_5hz(path) - 2 / 3) < 0.02


def test_power_has_no_meaning_when_still_or_short():
    assert math.isnan(power_above_5hz(np.ones((100, 3))))
    path = np.random.default_rng(0).standard_normal((33, 3))
    assert velocity_spectrum(np.diff(path[:32], axis=0)) is None
    assert 0 < power_above_5hz(path) < 1


def test_seams_of_a_motion_without_any_are_like_the_rest():
    ratios = [seam_jerk_ratio(rough_points(600, seed=seed), 52, 8) for seed in range(20)]
    assert abs(np.mean(ratios) - 1) < 0.05
    assert 0.75 < min(ratios) and max(ratios) < 1.3


@pytest.mark.parametrize("offset", range(-1, 10))
@pytest.mark.parametrize("kind", ["jump", "kink"])
def test_a_pop_anywhere_in_a_join_is_found(offset, kind):
    """The pose jumps, or turns sharply, at ``offset`` frames into what two windows share."""
    points = rough_points(600)
    frames = np.arange(600)
    for index, join in enumerate(range(52, 600, 52)):
        since = frames - (join + offset)
        change = (since >= 0) * 0.05 if kind == "jump" else np.maximum(since, 0) * 0.05
        points += (-1) ** index * change[:, None, None]
    assert seam_jerk_ratio(points, 52, 8) > 4


@pytest.mark.parametrize("offset", range(0, 52, 3))
def test_a_pop_at_any_offset_stands_out_at_its_phase(offset):
    points = rough_points(620)
    for index, frame in enumerate(range(52 + offset, 620, 52)):
        points[frame:] += (-1) ** index * 0.05
    by_phase = jerk_by_window_phase(points, 52)
    assert by_phase.argmax() == offset
    assert by_phase.max() > 5 * np.median(by_phase)


def test_a_pop_away_from_the_joins_is_not_blamed_on_them():
    points = rough_points(600)
    for index, frame in enumerate(range(52 + 30, 600, 52)):
        points[frame:] += (-1) ** index * 0.05
    assert seam_jerk_ratio(points, 52, 8) < 0.5


def test_other_windows_have_other_joins():
    points = rough_points(600)
    for index, frame in enumerate(range(40, 600, 40)):
        points[frame:] += (-1) ** index * 0.05
    assert seam_jerk_ratio(points, 40, 8) > 4
    assert seam_jerk_ratio(points, 52, 8) < 2


def test_one_window_has_no_seams():
    assert math.isnan(seam_jerk_ratio(rough_points(52), 52, 8))
    assert math.isnan(seam_jerk_ratio(rough_points(60), 52, 8))
    assert not math.isnan(seam_jerk_ratio(rough_points(65), 52, 8))
    assert np.isnan(jerk_by_window_phase(rough_points(20), 52)).sum() == 52 - 17


def test_foot_slide_is_the_speed_of_feet_on_the_ground():
    t = seconds(90)
    sliding = np.stack([0.3 * t, np.zeros(90), 0.4 * t], axis=1)  # 0.5 m/s on the ground
    lifted = np.stack([9 * t, np.full(90, 0.2), t], axis=1)  # fast, but in the air
    assert abs(foot_slide(np.stack([sliding, lifted], axis=1)) - 0.5) < 1e-9
    planted = np.zeros((90, 2, 3))
    planted[:, 1, 1] = 0.02 * np.abs(np.sin(5 * t))  # a heel may lift a little
    assert foot_slide(planted) == 0
    assert math.isnan(foot_slide(planted[:1]))
    fallen = np.concatenate([np.stack([sliding, sliding], axis=1)] * 3)
    fallen[4, 0, 1] -= 1.0  # one bad frame is no new ground
    assert foot_slide(fallen) > 0.4


def test_measures_of_a_body_that_moves_as_one():
    # Positions reach 53 m, where float32 steps are 4 micrometres: 0.1 m/s^3 each.
    t = seconds(90)
    result = measures(moving_root(along_x(2 * t**3)), SKELETON)
    assert abs(result["tip_jerk_m_s3"] - 12) < 0.5
    np.testing.assert_allclose(result["joint_jerk_m_s3"], result["tip_jerk_m_s3"], rtol=1e-6)
    np.testing.assert_allclose(result["jerk_by_depth_m_s3"], result["tip_jerk_m_s3"], rtol=1e-6)
    assert len(result["jerk_by_depth_m_s3"]) == 11
    walking = measures(moving_root(along_x(0.25 * t)), SKELETON)
    assert abs(walking["tip_path_m_s"] - 0.25) < 1e-5
    assert abs(walking["foot_slide_m_s"] - 0.25) < 1e-5
    np.testing.assert_allclose(walking["fingertips_path_m_s"], 0.25, atol=1e-5)


def test_tip_measures_of_a_turning_wrist_follow_its_radius():
    """The right wrist turns about x at a steady rate: the tip moves on a circle."""
    num_frames, rate = 120, 1.5
    motion = moving_root(np.zeros((num_frames, 3)))
    poses = motion.poses.copy()
    poses[:, 21 * 3 + 1] = rate * seconds(num_frames)
    motion = replace(motion, poses=poses)
    rest = SKELETON.rest_joints.double().numpy()
    tip = rest[45] + SKELETON.tip_offsets[6].double().numpy()
    radius = np.linalg.norm((tip - rest[21])[[0, 2]])
    step = 2 * radius * np.sin(rate / 30 / 2)  # a chord of the circle
    result = measures(motion, SKELETON)
    assert abs(result["tip_path_m_s"] - 30 * step) < 1e-5
    assert abs(result["tip_acceleration_m_s2"] - 900 * step * 2 * np.sin(rate / 60)) < 1e-3
    jerk = result["joint_jerk_m_s3"]
    moved = {joint for joint in range(55) if jerk[joint] > 0.05}
    assert moved == {joint for joint in range(55) if 21 in chain_to_root(joint)[1:]}


def test_joint_noise_grows_with_depth():
    rng = np.random.default_rng(0)
    motion = moving_root(np.zeros((300, 3)))
    noisy = replace(motion, poses=(0.02 * rng.standard_normal((300, 165))).astype(np.float32))
    result = measures(noisy, SKELETON)
    arm = [result["joint_jerk_m_s3"][joint] for joint in (9, 17, 19, 21, 43, 45)]
    assert arm == sorted(arm)
    assert result["tip_jerk_m_s3"] > arm[-1]


def test_another_tip_and_a_given_track():
    motion = smooth_motion_example()
    left = measures(motion, SKELETON, tip="left_thumb")
    tips = track_points(motion, SKELETON).fingertips
    expected = smoothness.derivative_magnitudes(tips[:, FINGERTIP_NAMES.index("left_thumb")], 3)
    assert left["tip_jerk_m_s3"] == pytest.approx(expected.mean())
    t = seconds(motion.num_frames)
    report = told({"a": motion}, SKELETON, tip_track=lambda *_: along_x(t**3))
    given = report["systems"]["a"]["raw"]
    assert given["tip_jerk_m_s3"] == pytest.approx(6, rel=1e-6)
    assert given["joint_jerk_m_s3"] == left["joint_jerk_m_s3"]


def test_tracks_do_not_depend_on_chunks(monkeypatch):
    motion = smooth_motion_example(50)
    whole = track_points(motion, SKELETON)
    monkeypatch.setattr(tracks, "_CHUNK_FRAMES", 7)
    parts = track_points(motion, SKELETON)
    np.testing.assert_allclose(parts.joints, whole.joints, rtol=0, atol=1e-12)
    np.testing.assert_allclose(parts.fingertips, whole.fingertips, rtol=0, atol=1e-12)


def test_filter_keeps_slow_motion_and_removes_noise():
    motion = smooth_motion_example(150)
    smooth = smooth_motion(motion)
    assert smooth.num_frames == 150
    before, after = (track_points(m, SKELETON).joints for m in (motion, smooth))
    assert np.abs(before - after).max() < 0.02
    assert np.median(np.abs(before - after)) < 0.001
    rng = np.random.default_rng(0)
    noise = (0.03 * rng.standard_normal(motion.poses.shape)).astype(np.float32)
    noisy = replace(motion, poses=motion.poses + noise)
    raw, filtered = (measures(m, SKELETON) for m in (noisy, smooth_motion(noisy)))
    assert filtered["tip_jerk_m_s3"] < 0.35 * raw["tip_jerk_m_s3"]
    assert filtered["tip_velocity_power_above_5hz"] < raw["tip_velocity_power_above_5hz"]


def test_filter_is_exact_on_a_parabola_and_gives_rotations():
    t = seconds(40)
    motion = moving_root(along_x(0.3 * t**2 - 0.1 * t))
    np.testing.assert_allclose(smooth_motion(motion).trans, motion.trans, atol=1e-6)
    # Half turns: axis-angle jumps between pi and -pi there, rotations do not.
    poses = motion.poses.copy()
    poses[:, 0] = np.pi + 0.05 * np.where(np.arange(40) % 2, 1, -1)
    wrapped = poses.copy()
    wrapped[poses[:, 0] > np.pi, 0] -= 2 * np.pi
    results = [smooth_motion(replace(motion, poses=p)).poses[:, :3] for p in (poses, wrapped)]
    angle = (Rotation.from_rotvec(results[0]).inv() * Rotation.from_rotvec(results[1])).magnitude()
    assert angle.max() < 1e-5
    about_pi = (Rotation.from_rotvec(results[0]) * Rotation.from_rotvec([-np.pi, 0, 0])).magnitude()
    assert about_pi[3:-3].max() < 0.03  # the noise of 0.05 rad is more than a third smaller


@pytest.mark.parametrize("num_frames", [1, 2, 3, 4, 5, 6, 7, 8, 15, 33, 53])
def test_any_length_gives_valid_json(num_frames):
    result = told({"a": smooth_motion_example(num_frames)}, SKELETON)
    text = json.dumps(result, allow_nan=False)
    assert json.loads(text) == result
    raw = result["systems"]["a"]["raw"]
    assert (raw["tip_jerk_m_s3"] is None) == (num_frames < 4)
    assert (raw["tip_acceleration_m_s2"] is None) == (num_frames < 3)
    assert (raw["foot_slide_m_s"] is None) == (num_frames < 2)
    assert (raw["tip_velocity_power_above_5hz"] is None) == (num_frames < 33)
    assert raw["seam_jerk_ratio"] is None
    assert len(raw["joint_jerk_m_s3"]) == 55
    assert [f"a has {num_frames} frame" in note for note in result["notes"]] == [True] * (
        num_frames < 4
    )


def test_a_still_body_has_no_jerk_and_no_nan():
    result = told({"a": moving_root(np.full((200, 3), 0.7))}, SKELETON)
    json.dumps(result, allow_nan=False)
    raw = result["systems"]["a"]["raw"]
    assert raw["tip_jerk_m_s3"] < 1e-6
    assert raw["tip_velocity_power_above_5hz"] is None
    assert raw["seam_jerk_ratio"] is None
    assert raw["foot_slide_m_s"] == 0


def test_the_public_keys():
    motions = {"globaldiff/local": smooth_motion_example(seed=1), "other": smooth_motion_example()}
    result = told(motions, SKELETON)
    assert result["fps"] == 30
    assert result["tip"] == "right_middle"
    assert result["tip_source"] == "rigid"
    assert result["reference"] is None
    assert set(result["systems"]) == set(motions)
    for kinds in result["systems"].values():
        assert set(kinds) == {"raw", "savgol"}
        for numbers in kinds.values():
            assert {
                "tip_jerk_m_s3", "tip_acceleration_m_s2", "tip_velocity_power_above_5hz",
                "seam_jerk_ratio", "foot_slide_m_s", "joint_jerk_m_s3", "jerk_by_depth_m_s3",
            } <= set(numbers)  # fmt: skip


def test_a_longer_reference_is_cut_and_said_so():
    short, long = smooth_motion_example(60), smooth_motion_example(90)
    result = told({"a": short}, SKELETON, reference=long)
    cut = told({"a": short}, SKELETON, reference=first_frames(long, 60))
    assert result["reference"] == cut["reference"]
    assert result["num_frames"] == {"a": 60}
    assert "The reference has 90 frames; the first 60 were measured" in result["notes"][0]
    assert cut["notes"] == []
    result = told({"a": long, "b": short}, SKELETON, reference=short)
    assert result["num_frames"] == {"a": 60, "b": 60}
    assert result["notes"][0].startswith("a has 90 frames")
    assert told({"a": long, "b": short}, SKELETON)["num_frames"] == {"a": 90, "b": 60}


def test_an_unknown_tip_names_the_known_ones():
    with pytest.raises(ValueError, match="nose is neither a fingertip nor a joint; choose one of"):
        diagnose({}, SKELETON, tip="nose")


@pytest.mark.beat2
def test_real_motion_has_the_known_smoothness():
    """Reference values for this clip's tip: jerk about 152 m/s^3, acceleration 8.6 m/s^2."""
    motion = load_motion(beat2_folder() / "smplxflame_30" / "2_scott_0_1_1.npz")
    result = measures(motion, SKELETON)
    assert 120 < result["tip_jerk_m_s3"] < 185
    assert 7 < result["tip_acceleration_m_s2"] < 10.5
    assert 0.003 < result["tip_velocity_power_above_5hz"] < 0.012
    assert 0.8 < result["seam_jerk_ratio"] < 1.25
    assert torch.isfinite(torch.tensor(result["jerk_by_window_phase_m_s3"])).all()


def test_every_public_key_is_documented():
    documented = (ROOT / "docs" / "formats.md").read_text()
    motion = smooth_motion_example()
    result = told({"a": motion}, SKELETON, reference=motion, onsets_s=np.arange(0.5, 3, 0.5))
    for key in result:
        assert f'"{key}":' in documented
    for key in result["systems"]["a"]["raw"]:
        assert f"| `{key}` |" in documented
