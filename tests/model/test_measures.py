"""Measures on signals whose answer is known in closed form."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.integrate import quad

from conventions.joints import FINGERTIP_JOINTS, HANDS, JOINT_INDEX, JOINT_NAMES
from model.diagnostics import diagnose, measures
from model.measures import point, posture, smoothness
from model.measures.beats import read_mean_speeds
from model.measures.joints import elbow_backwards_share, finger_is_outside, rotation_noise
from model.measures.point import attribute_jerk
from model.measures.seams import recurring_jerk
from model.measures.smoothness import velocity_spectrum
from model.motion.filtering import smooth_rotations
from model.motion.kinematics import (
    fingertip_positions,
    joint_positions_from_local,
    mirror_poses,
    open_body_skeleton,
)
from model.motion.motion import Motion
from model.motion.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from model.motion.tracks import moving_chain, point_words, track_points
from model.storage.npz import MotionError
from tests.helpers import smooth_motion_example

SKELETON = open_body_skeleton()


def told(*motions: Any, **options: Any) -> dict[str, Any]:
    """What the file tells."""
    return diagnose(*motions, **options).as_json()


def posed(num_frames: int, **joints: np.ndarray) -> Motion:
    """The rest pose, with some joints' axis-angle (T, 3) or (3,) given by name."""
    motion = smooth_motion_example(num_frames)
    poses = np.zeros((num_frames, 55, 3), np.float32)
    for name, axis_angle in joints.items():
        poses[:, JOINT_INDEX[name]] = axis_angle
    return replace(
        motion, poses=poses.reshape(num_frames, 165), trans=np.zeros((num_frames, 3), np.float32)
    )


def about(axis: int, angle: np.ndarray | float) -> np.ndarray:
    axis_angle = np.zeros((*np.shape(angle), 3))
    axis_angle[..., axis] = angle
    return axis_angle


def test_log_dimensionless_jerk_of_a_sine():
    """x = a sin(wt): T^3 / v^2 * integral of jerk^2 = T^4 c^4 / 2; c is the differences' rate."""
    hertz, frames = 1.5, 61
    t = np.arange(frames) / 30
    path = np.stack([0.3 * np.sin(2 * np.pi * hertz * t), 0 * t, 0 * t], axis=1)
    rate = 2 * 30 * np.sin(np.pi * hertz / 30)
    expected = -math.log(2.0**4 * rate**4 / 2)
    assert point.log_dimensionless_jerk(path) == pytest.approx(expected, abs=0.05)
    assert point.log_dimensionless_jerk(7 * path) == pytest.approx(expected, abs=0.05)
    assert math.isnan(point.log_dimensionless_jerk(path[:3]))
    assert math.isnan(point.log_dimensionless_jerk(np.ones((61, 3))))


def test_sparc_of_a_bell_is_the_length_of_its_own_curve():
    """A Gaussian speed of deviation s has the spectrum exp(-f^2 / 2 b^2) with b = 1 / (2 pi s)."""
    width_s = 0.12
    t = np.arange(-60, 61) / 30
    width_hz = 1 / (2 * np.pi * width_s)
    end = width_hz * np.sqrt(2 * np.log(1 / 0.05))  # where it falls to 0.05

    def step(f: float) -> float:
        slope = f / width_hz**2 * np.exp(-(f**2) / (2 * width_hz**2))
        return float(np.hypot(1 / end, slope))

    expected = -quad(step, 0, end)[0]
    speed = np.exp(-(t**2) / (2 * width_s**2))
    assert point.sparc(speed) == pytest.approx(expected, abs=0.01)
    assert point.sparc(speed) == pytest.approx(point.sparc(5 * speed))
    assert point.sparc(speed + np.roll(speed, 30)) < point.sparc(speed) - 0.3
    assert math.isnan(point.sparc(np.zeros(60)))


def test_movement_smoothness_does_not_depend_on_the_clip_s_length():
    t = np.arange(601) / 30
    path = np.stack([0.2 * np.sin(2 * np.pi * t), 0 * t, 0 * t], axis=1)
    np.testing.assert_allclose(
        point.mean_over_movements(path), point.mean_over_movements(path[:61]), rtol=1e-6
    )
    assert np.isnan(point.mean_over_movements(path[:60])).all()
    assert np.isfinite(point.mean_over_movements(path[:61])).all()


def test_spectrum_of_two_tones_has_their_powers_at_their_places():
    t = np.arange(1280) / 30
    low, high = 10 * 30 / 128, 40 * 30 / 128  # in the middle of bins 10 and 40
    velocity = np.stack([np.sin(2 * np.pi * low * t), 0.5 * np.sin(2 * np.pi * high * t), 0 * t], 1)
    spectrum = velocity_spectrum(velocity)
    assert spectrum is not None
    share = spectrum.share()
    assert share.sum() == pytest.approx(1)
    assert share[9:12].sum() == pytest.approx(0.8, abs=1e-3)  # 1/2 against 1/8
    assert share[39:42].sum() == pytest.approx(0.2, abs=1e-3)
    assert spectrum.power.sum() == pytest.approx(0.5 + 0.125, rel=0.01)
    assert velocity_spectrum(velocity[:31]) is None


def test_angular_speed_and_acceleration_of_a_steady_and_of_a_faster_turn():
    frames = np.arange(90)
    steady = measures(posed(90, left_elbow=about(1, 0.05 * frames)), SKELETON)
    elbow = JOINT_INDEX["left_elbow"]
    speeds = steady["joint_angular_speed_deg_s"]
    assert speeds[elbow] == pytest.approx(np.degrees(0.05) * 30, rel=1e-4)
    assert max(np.delete(speeds, elbow)) == 0
    assert steady["joint_angular_acceleration_deg_s2"][elbow] < 0.1
    rate = 2.0  # rad/s^2
    faster = measures(posed(60, left_elbow=about(1, rate / 2 * (frames[:60] / 30) ** 2)), SKELETON)
    acceleration = faster["joint_angular_acceleration_deg_s2"][elbow]
    assert acceleration == pytest.approx(np.degrees(rate), rel=1e-3)


def test_rotation_noise_is_recovered_from_a_moving_joint():
    rng = np.random.default_rng(0)
    swing = matrix_from_axis_angle(
        torch.from_numpy(about(0, np.sin(2 * np.pi * np.arange(900) / 30)))
    )
    noise = matrix_from_axis_angle(torch.from_numpy(0.02 * rng.standard_normal((900, 3))))
    for rotmat, expected in ((swing @ noise, 0.02), (swing, 0.0)):
        velocity = smoothness.angular_velocity(rotmat[:, None].numpy())
        found = rotation_noise(velocity)[0]
        assert found == pytest.approx(expected, abs=0.0015)


@pytest.mark.parametrize("noisy", ["right_elbow", "spine2", "right_middle2"])
def test_attribution_points_at_the_joint_that_shakes(noisy: str):
    motion = smooth_motion_example(300, seed=3)
    poses = motion.poses.reshape(300, 55, 3).copy()
    poses[:, JOINT_INDEX[noisy]] += 0.05 * np.random.default_rng(0).standard_normal((300, 3))
    tracks = track_points(replace(motion, poses=poses.reshape(300, 165)), SKELETON)
    found = attribute_jerk(tracks.point("right_middle"), tracks, moving_chain("right_middle"))
    assert found.joints[int(found.share.argmax())] == noisy
    assert found.share.max() > 0.3
    assert np.sort(found.share)[-2] < 0.02


def test_attribution_is_forward_kinematics_with_one_joint_smoothed():
    motion = smooth_motion_example(60, seed=4)
    local_rot = motion.local_rotations().double()
    joint = JOINT_INDEX["right_shoulder"]
    changed = local_rot.clone()
    changed[:, joint] = smooth_rotations(local_rot[:, joint])
    transl = torch.from_numpy(motion.trans).double()
    global_rot, positions = joint_positions_from_local(changed, SKELETON, transl)
    tip = fingertip_positions(global_rot, positions, SKELETON)[:, 6].numpy()
    tracks = track_points(motion, SKELETON)
    found = attribute_jerk(tracks.point("right_middle"), tracks, moving_chain("right_middle"))
    jerks = [
        smoothness.derivative_magnitudes(points, 3).mean()
        for points in (tip, tracks.point("right_middle"))
    ]
    share = found.share[found.joints.index("right_shoulder")]
    assert share == pytest.approx(1 - jerks[0] / jerks[1], abs=1e-3)


def test_jitter_of_the_translation_is_told_apart():
    motion = smooth_motion_example(200)
    rng = np.random.default_rng(0)
    trans = motion.trans + 0.02 * rng.standard_normal((200, 3)).astype(np.float32)
    found = measures(replace(motion, trans=trans), SKELETON)["tip_jerk_attribution"]
    assert found["translation_share"] > 0.5
    assert max(found["share"]) < 0.1


def test_a_followed_joint_is_attributed_to_its_ancestors_only():
    found = measures(smooth_motion_example(60), SKELETON, tip="left_wrist")
    assert found["tip_jerk_attribution"]["joints"] == [
        *("pelvis", "spine1", "spine2", "spine3", "left_collar", "left_shoulder", "left_elbow")
    ]


def test_diagnose_follows_a_joint_and_says_so():
    motion = smooth_motion_example(40)
    result = told({"a": motion}, SKELETON, joint="left_wrist")
    assert (result["tip"], result["joint"], result["tip_source"]) == (None, "left_wrist", "joint")
    raw = result["systems"]["a"]["raw"]
    wrist_jerk = raw["joint_jerk_m_s3"][JOINT_INDEX["left_wrist"]]
    assert raw["tip_jerk_m_s3"] == pytest.approx(wrist_jerk)
    tip = told({"a": motion}, SKELETON, joint="left_index")
    assert (tip["tip"], tip["joint"], tip["tip_source"]) == ("left_index", "left_index", "rigid")


def test_spine_tilt_is_the_angle_of_a_leaning_body():
    upright = measures(posed(3), SKELETON)["spine_tilt_deg"]["mean"]
    leaning = measures(posed(3, pelvis=about(0, math.radians(20))), SKELETON)["spine_tilt_deg"]
    spine = (SKELETON.rest_joints[12] - SKELETON.rest_joints[0]).double().numpy()
    at_rest = math.degrees(math.atan2(spine[2], spine[1]))  # forwards is +z
    assert upright == pytest.approx(abs(at_rest), abs=1e-3)
    assert leaning["mean"] == pytest.approx(abs(20 + at_rest), abs=0.01)
    assert leaning["p95"] == pytest.approx(leaning["mean"])


def test_heights_of_feet_are_above_the_lower_one():
    feet = np.zeros((100, 2, 3))
    feet[:, :, 1] = 0.7
    feet[:, 1, 1] += np.linspace(0.0, 0.2, 100)
    height = posture.height_above_ground(feet)
    np.testing.assert_allclose(height[:, 0], 0)
    np.testing.assert_allclose(height[-1, 1], 0.2)


@pytest.mark.parametrize(("lag", "expected"), [(0.0, 1.0), (math.pi / 2, -1.0)])
def test_hands_that_move_together_or_in_turn(lag: float, expected: float):
    """|cos| and |sin| of the same angle: highs of one are lows of the other."""
    t = np.arange(300) / 30
    left, right = (np.sin(2 * np.pi * 0.5 * t + shift) for shift in (0.0, lag))
    joints = np.zeros((300, 55, 3))
    joints[:, JOINT_INDEX["left_wrist"], 0] = left
    joints[:, JOINT_INDEX["right_wrist"], 1] = right
    joints += 0.3 * t[:, None, None]  # a walk does not make hands symmetrical
    assert posture.hand_speed_symmetry(joints) == pytest.approx(expected, abs=0.1)


def test_root_drift_is_horizontal_and_between_means():
    t = np.arange(120) / 30
    path = np.stack([0.3 * t, 5 * t, 0.4 * t], axis=1)
    assert posture.root_drift(path) == pytest.approx(0.5 * 3)
    assert math.isnan(posture.root_drift(path[:59]))


@pytest.mark.parametrize(
    ("joint", "axis_angle", "is_outside"),
    [
        ("left_index1", about(2, -1.4), False),  # a fist: inwards is -z on the left
        ("left_index1", about(2, -2.1), True),
        ("right_index1", about(2, 1.4), False),
        ("right_ring2", about(2, -0.5), True),  # backwards
        ("right_ring2", about(2, -0.2), False),
        ("left_middle3", about(2, -1.85), False),
        ("left_middle3", about(2, -2.0), True),
        ("left_middle1", about(1, 1.2), True),  # sideways
        ("left_middle1", about(1, 0.8), False),
        ("right_thumb3", about(1, 2.0), True),
    ],
)
def test_fingers_outside_the_human_range(joint, axis_angle, is_outside):
    local_rot = posed(2, **{joint: axis_angle}).local_rotations().numpy()
    outside = finger_is_outside(local_rot, SKELETON)
    assert outside[0, HANDS.index(JOINT_INDEX[joint])] == is_outside
    assert outside.sum() == 2 * is_outside


def test_a_turn_of_a_bone_about_itself_is_no_bend():
    rest = SKELETON.rest_joints.double().numpy()
    bone = rest[JOINT_INDEX["left_pinky3"]] - rest[JOINT_INDEX["left_pinky2"]]
    twisted = posed(2, left_pinky2=2.0 * bone / np.linalg.norm(bone))
    assert not finger_is_outside(twisted.local_rotations().numpy(), SKELETON).any()


def test_elbows_bend_to_the_front():
    bent = posed(2, left_elbow=about(1, -1.5), right_elbow=about(1, -1.5))
    local_rot = bent.local_rotations().numpy()
    assert elbow_backwards_share(local_rot, SKELETON, "left") == 0
    assert elbow_backwards_share(local_rot, SKELETON, "right") == 1


def test_errors_to_a_reference_of_one_turned_joint():
    """The elbow turns by 0.5 rad: itself locally, its whole arm globally, positions below it."""
    reference = smooth_motion_example(30, seed=5)
    turned = reference.local_rotations()
    elbow, wrist = JOINT_INDEX["left_elbow"], JOINT_INDEX["left_wrist"]
    turned[:, elbow] = turned[:, elbow] @ matrix_from_axis_angle(torch.tensor([0.0, 0.5, 0.0]))
    motion = replace(
        reference,
        poses=axis_angle_from_matrix(turned).flatten(1).numpy(),
        trans=reference.trans + np.array([0.3, 0.0, 0.4], np.float32),
    )
    raw = told({"a": motion}, SKELETON, reference=reference)["systems"]["a"]["raw"]
    local, world = raw["local_rotation_error_deg"], raw["global_rotation_error_deg"]
    assert local[elbow] == pytest.approx(math.degrees(0.5), abs=1e-3)
    assert max(np.delete(local, elbow)) < 1e-3
    for joint in (elbow, wrist, JOINT_INDEX["left_index3"]):
        assert world[joint] == pytest.approx(math.degrees(0.5), abs=1e-3)
    position = raw["position_error_m"]
    moved = {JOINT_NAMES[joint] for joint in range(55) if position[joint] > 1e-6}
    assert "left_wrist" in moved and "left_elbow" not in moved
    assert all(name.startswith("left") for name in moved)
    assert raw["root_error_m"] == pytest.approx(0.5, rel=1e-5)
    forearm = SKELETON.rest_joints[wrist] - SKELETON.rest_joints[elbow]
    across = np.linalg.norm(forearm.double().numpy()[[0, 2]])
    assert position[wrist] == pytest.approx(2 * math.sin(0.25) * across, rel=1e-4)
    assert raw["position_error_by_depth_m"][7] == pytest.approx(position[wrist] / 2, abs=1e-6)


def test_a_motion_is_no_error_to_itself_and_mirrored_is_found_so():
    motion = smooth_motion_example(30)
    mirrored = replace(motion, poses=mirror_poses(torch.from_numpy(motion.poses)).numpy())
    result = told({"same": motion, "mirrored": mirrored}, SKELETON, reference=motion)
    same, other = (result["systems"][name]["raw"] for name in ("same", "mirrored"))
    assert max(same["position_error_m"]) == 0
    assert max(same["local_rotation_error_deg"]) < 1e-3
    assert other["rotation_error_by_sides_deg"]["mirrored"] < 1e-2
    assert other["rotation_error_by_sides_deg"]["as_is"] > 1
    assert "position_error_m" not in result["reference"]["raw"]


def test_beats_need_speech_and_come_with_chance():
    motion = smooth_motion_example(400)
    onsets_s = np.arange(2.5, 11, 0.4)
    raw = told({"a": motion}, SKELETON, onsets_s=onsets_s)["systems"]["a"]["raw"]
    assert 0 < raw["beat_align"] <= 1 and 0 < raw["beat_align_chance"] <= 1
    assert raw["beat_align_chance"] <= raw["beat_align_chance_highest"] <= 1
    assert (raw["beat_onsets"], raw["beat_speeds_of"]) == (len(onsets_s), "own")
    outside = told({"a": motion}, SKELETON, onsets_s=np.array([0.5, 1.9]))
    assert outside["systems"]["a"]["raw"]["beat_align"] is None
    assert outside["systems"]["a"]["raw"]["beat_onsets"] == 0
    assert "beat_align" not in told({"a": motion}, SKELETON)["systems"]["a"]["raw"]


def test_published_mean_speeds_decide_what_is_a_beat(tmp_path: Path):
    motion = smooth_motion_example(400)
    onsets_s = np.arange(2.5, 11, 0.4)
    found = {}
    for name, speed in {"slow": 1e-3, "fast": 1e3}.items():
        np.save(tmp_path / f"{name}.npy", np.full(55, speed, np.float32))
        speeds = read_mean_speeds(tmp_path / f"{name}.npy")
        given = told({"a": motion}, SKELETON, onsets_s=onsets_s, mean_speeds=speeds)
        found[name] = given["systems"]["a"]["raw"]
        assert found[name]["beat_speeds_of"] == "emage"
    beside = told({"a": motion}, SKELETON, reference=motion, onsets_s=onsets_s)["systems"]["a"]
    assert beside["raw"]["beat_speeds_of"] == "reference"
    assert found["slow"]["beats_per_joint_s"] > beside["raw"]["beats_per_joint_s"] > 0
    assert found["fast"]["beats_per_joint_s"] == 0 == found["fast"]["beat_align"]


@pytest.mark.parametrize("speeds", [np.ones(54), -np.ones(55), np.full(55, np.nan), None])
def test_what_are_no_mean_speeds_is_refused(speeds: np.ndarray | None, tmp_path: Path):
    path = tmp_path / "speeds.npy"
    if speeds is None:
        path.write_text("eggs")
    else:
        np.save(path, speeds)
    with pytest.raises(MotionError, match="mean_vel_smplxflame_30"):
        read_mean_speeds(path)


def test_a_jump_in_one_window_does_not_recur():
    rng = np.random.default_rng(0)
    points = 1e-3 * rng.standard_normal((600, 5, 3))
    once, always = points.copy(), points.copy()
    once[104 + 7 :] += 0.5
    for index, frame in enumerate(range(52 + 7, 600, 52)):
        always[frame:] += (-1) ** index * 0.05
    assert recurring_jerk(once, 52).ratio < 1.5
    found = recurring_jerk(always, 52)
    assert found.phase_frame in (6, 7, 8) and found.ratio > 5
    assert recurring_jerk(always[: 52 * 4 - 2], 52).phase_frame is None


def test_points_are_called_as_people_call_them():
    assert point_words("right_middle") == "right middle fingertip"
    assert point_words("left_thumb2") == "left thumb joint 2"
    assert point_words("spine3") == "spine3" and point_words("left_hip") == "left hip"


def test_chains_of_points_end_where_the_last_rotation_is():
    assert moving_chain("right_middle")[-1] == FINGERTIP_JOINTS[6]
    assert moving_chain("right_middle")[0] == 0
    assert moving_chain("left_hip") == (0,)
    assert moving_chain("pelvis") == ()
