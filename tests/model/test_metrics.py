"""Measures on signals whose answer is known in closed form, and how `diagnose` gathers them."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from conventions.joints import (
    FINGERTIP_JOINTS,
    FINGERTIP_NAMES,
    HANDS,
    JOINT_INDEX,
    JOINT_NAMES,
    MIRROR_PERMUTATION,
    chain_to_root,
)
from model.diagnostics import GLOBALDIFF_WINDOWS, analyse_raw, diagnose, with_current_format
from model.faults.analysis import Finding
from model.generation.base import Windowing
from model.metrics import posture, smoothness, tracked_point
from model.metrics.beats import read_mean_speeds
from model.metrics.joints import (
    elbow_backwards_share,
    estimate_rotation_noise_rad,
    finger_outside_limits,
)
from model.metrics.protocols.clip import ProtocolInputs
from model.metrics.reference_error import error_to_reference
from model.metrics.smoothness import HIGH_FREQUENCY_HZ, velocity_spectrum
from model.metrics.tracked_point import attribute_jerk
from model.motion import tracks as tracks_module
from model.motion.kinematics import (
    fingertip_positions,
    forward_kinematics,
    open_body_skeleton,
)
from model.motion.motion import Motion, load_motion
from model.motion.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from model.motion.tracks import kinematic_chain, point_label, track_points
from model.motion.transforms import smooth_motion, smooth_rotations
from model.storage.npz import MotionError
from tests.helpers import ROOT, beat2_folder, smooth_motion_example
from tests.model.motion.made import about, along, posed

SKELETON = open_body_skeleton()


def measures(motion: Motion, **options: Any) -> dict[str, Any]:
    """Of one, as the file tells them."""
    return analyse_raw(motion, SKELETON, windows=GLOBALDIFF_WINDOWS, **options).metrics.as_json()


def told(*motions: Any, **options: Any) -> dict[str, Any]:
    """What the file tells."""
    return diagnose(*motions, **options).as_json()


def seconds(num_frames: int) -> np.ndarray:
    return np.arange(num_frames) / 30


def test_derivatives_of_a_cubic_are_its_own():
    t = seconds(60)
    path = along(0, 2 * t**3)
    # The third difference of a cubic is exact; lower ones are the mean over their frames.
    np.testing.assert_allclose(smoothness.derivative_magnitudes(path, 3), 12, rtol=1e-6)
    np.testing.assert_allclose(smoothness.derivative_magnitudes(path, 2), 12 * t[1:-1], rtol=1e-9)
    np.testing.assert_allclose(smoothness.derivative_magnitudes(along(0, 0.5 * t), 1), 0.5)
    assert smoothness.derivative_magnitudes(path[:3], 3).shape == (0,)


def power_above_5hz(path: np.ndarray) -> float:
    spectrum = velocity_spectrum(np.diff(path, axis=0) * 30)
    assert spectrum is not None
    return float(spectrum.normalised().power_above(HIGH_FREQUENCY_HZ))


def test_power_of_sines_and_of_noise_lies_on_its_side_of_5_hz():
    for hertz, above in ((2.0, 0.0), (4.2, 0.0), (5.9, 1.0), (10.0, 1.0)):
        sine = along(0, np.sin(2 * np.pi * hertz * seconds(300)))
        assert abs(power_above_5hz(sine) - above) < 0.01
    t, low, high = seconds(1200), 2.0, 8.0
    path = along(0, np.sin(2 * np.pi * low * t) + 0.1 * np.sin(2 * np.pi * high * t))
    # Differencing over one frame weighs a frequency with sin(pi f / 30), not with f.
    weights = [np.sin(np.pi * low / 30) ** 2, (0.1 * np.sin(np.pi * high / 30)) ** 2]
    assert abs(power_above_5hz(path) - weights[1] / sum(weights)) < 0.003
    white = np.cumsum(np.random.default_rng(0).standard_normal((6000, 3)), axis=0)
    assert abs(power_above_5hz(white) - 2 / 3) < 0.02  # velocities, to 15 Hz
    assert math.isnan(power_above_5hz(np.ones((100, 3))))
    assert velocity_spectrum(np.diff(white[:32], axis=0)) is None
    assert 0 < power_above_5hz(white[:33]) < 1


def test_spectrum_of_two_tones_has_their_powers_at_their_places():
    t = seconds(1280)
    low, high = 10 * 30 / 128, 40 * 30 / 128  # in the middle of bins 10 and 40
    velocity = np.stack([np.sin(2 * np.pi * low * t), 0.5 * np.sin(2 * np.pi * high * t), 0 * t], 1)
    spectrum = velocity_spectrum(velocity)
    assert spectrum is not None
    share = spectrum.normalised().velocity_power
    assert share.sum() == pytest.approx(1)
    assert share[9:12].sum() == pytest.approx(0.8, abs=1e-3)  # 1/2 against 1/8
    assert share[39:42].sum() == pytest.approx(0.2, abs=1e-3)
    assert spectrum.velocity_power.sum() == pytest.approx(0.5 + 0.125, rel=0.01)


def test_log_dimensionless_jerk_of_a_sine():
    """x = a sin(wt): T^3 / v^2 * integral of jerk^2 = T^4 c^4 / 2; c is the differences' rate."""
    hertz = 1.5
    path = along(0, 0.3 * np.sin(2 * np.pi * hertz * seconds(61)))
    rate = 2 * 30 * np.sin(np.pi * hertz / 30)
    expected = -math.log(2.0**4 * rate**4 / 2)
    assert tracked_point.log_dimensionless_jerk(path) == pytest.approx(expected, abs=0.05)
    assert tracked_point.log_dimensionless_jerk(7 * path) == pytest.approx(expected, abs=0.05)
    assert math.isnan(tracked_point.log_dimensionless_jerk(path[:3]))
    assert math.isnan(tracked_point.log_dimensionless_jerk(np.ones((61, 3))))


def test_sparc_of_a_bell_is_the_length_of_its_own_curve():
    """A Gaussian speed of deviation s has the spectrum exp(-f^2 / 2 b^2) with b = 1 / (2 pi s)."""
    width_s = 0.12
    t = np.arange(-60, 61) / 30
    width_hz = 1 / (2 * np.pi * width_s)
    end = width_hz * np.sqrt(2 * np.log(1 / 0.05))  # where it falls to 0.05

    def step(f: float) -> float:
        slope = f / width_hz**2 * np.exp(-(f**2) / (2 * width_hz**2))
        return float(np.hypot(1 / end, slope))

    speed = np.exp(-(t**2) / (2 * width_s**2))
    assert tracked_point.sparc(speed) == pytest.approx(-quad(step, 0, end)[0], abs=0.01)
    assert tracked_point.sparc(speed) == pytest.approx(tracked_point.sparc(5 * speed))
    assert tracked_point.sparc(speed + np.roll(speed, 30)) < tracked_point.sparc(speed) - 0.3
    assert math.isnan(tracked_point.sparc(np.zeros(60)))


def test_movement_smoothness_does_not_depend_on_the_clip_s_length():
    path = along(0, 0.2 * np.sin(2 * np.pi * seconds(601)))
    long, short = (
        tracked_point.mean_sparc_and_log_jerk(path),
        tracked_point.mean_sparc_and_log_jerk(path[:61]),
    )
    np.testing.assert_allclose(long, short, rtol=1e-6)
    assert (
        np.isfinite(short).all()
        and np.isnan(tracked_point.mean_sparc_and_log_jerk(path[:60])).all()
    )


def test_measures_of_a_body_that_moves_as_one():
    # Positions reach 53 m, where float32 steps are 4 micrometres: 0.1 m/s^3 each.
    t = seconds(90)
    result = measures(posed(90, along(0, 2 * t**3)))
    assert abs(result["tip_jerk_m_s3"] - 12) < 0.5
    np.testing.assert_allclose(result["joint_jerk_m_s3"], result["tip_jerk_m_s3"], rtol=1e-6)
    np.testing.assert_allclose(result["jerk_by_depth_m_s3"], result["tip_jerk_m_s3"], rtol=1e-6)
    assert len(result["jerk_by_depth_m_s3"]) == 11
    walking = measures(posed(90, along(0, 0.25 * t)))
    assert abs(walking["tip_speed_m_s"] - 0.25) < 1e-5
    assert abs(walking["foot_slide_m_s"] - 0.25) < 1e-5
    np.testing.assert_allclose(walking["fingertips_speed_m_s"], 0.25, atol=1e-5)


def test_tip_measures_of_a_turning_wrist_follow_its_radius():
    """The right wrist turns about y at a steady rate: the tip moves on a circle."""
    rate, rest = 1.5, SKELETON.rest_joints.double().numpy()
    tip = rest[45] + SKELETON.tip_offsets[6].double().numpy()
    radius = np.linalg.norm((tip - rest[21])[[0, 2]])
    step = 2 * radius * np.sin(rate / 30 / 2)  # a chord of the circle
    result = measures(posed(120, right_wrist=about(1, rate * seconds(120))))
    assert abs(result["tip_speed_m_s"] - 30 * step) < 1e-5
    assert abs(result["tip_acceleration_m_s2"] - 900 * step * 2 * np.sin(rate / 60)) < 1e-3
    moved = {joint for joint in range(55) if result["joint_jerk_m_s3"][joint] > 0.05}
    assert moved == {joint for joint in range(55) if 21 in chain_to_root(joint)[1:]}


def test_angular_speed_and_acceleration_of_a_steady_and_of_a_faster_turn():
    elbow, frames = JOINT_INDEX["left_elbow"], np.arange(90)
    steady = measures(posed(90, left_elbow=about(1, 0.05 * frames)))
    speeds = steady["joint_angular_speed_deg_s"]
    assert speeds[elbow] == pytest.approx(np.degrees(0.05) * 30, rel=1e-4)
    assert max(np.delete(speeds, elbow)) == 0
    assert steady["joint_angular_acceleration_deg_s2"][elbow] < 0.1
    rate = 2.0  # rad/s^2
    faster = measures(posed(60, left_elbow=about(1, rate / 2 * seconds(60) ** 2)))
    acceleration = faster["joint_angular_acceleration_deg_s2"][elbow]
    assert acceleration == pytest.approx(np.degrees(rate), rel=1e-3)


def test_rotation_noise_is_recovered_from_a_moving_joint():
    draws = np.random.default_rng(0).standard_normal((900, 3))
    swing, noise = (
        matrix_from_axis_angle(torch.from_numpy(vectors))
        for vectors in (about(0, np.sin(2 * np.pi * seconds(900))), 0.02 * draws)
    )
    for rotmat, expected in ((swing @ noise, 0.02), (swing, 0.0)):
        velocity = smoothness.angular_velocity(rotmat[:, None].numpy())
        assert estimate_rotation_noise_rad(velocity)[0] == pytest.approx(expected, abs=0.0015)


@pytest.mark.parametrize("noisy", ["right_elbow", "spine2", "right_middle2"])
def test_attribution_points_at_the_joint_that_shakes(noisy):
    motion = smooth_motion_example(300, seed=3)
    poses = motion.poses.reshape(300, 55, 3).copy()
    poses[:, JOINT_INDEX[noisy]] += 0.05 * np.random.default_rng(0).standard_normal((300, 3))
    tracks = track_points(replace(motion, poses=poses.reshape(300, 165)), SKELETON)
    found = attribute_jerk(tracks.point("right_middle"), tracks, kinematic_chain("right_middle"))
    assert found.joints[int(found.share.argmax())] == noisy
    assert found.share.max() > 0.3 and np.sort(found.share)[-2] < 0.02


def test_attribution_is_forward_kinematics_with_one_joint_smoothed():
    motion = smooth_motion_example(60, seed=4)
    R_parent_joint = motion.local_rotations().double()
    joint = JOINT_INDEX["right_shoulder"]
    changed = R_parent_joint.clone()
    changed[:, joint] = smooth_rotations(R_parent_joint[:, joint])
    transl = torch.from_numpy(motion.trans).double()
    R_world_joint, positions = forward_kinematics(changed, SKELETON, transl)
    tip = fingertip_positions(R_world_joint, positions, SKELETON)[:, 6].numpy()
    tracks = track_points(motion, SKELETON)
    found = attribute_jerk(tracks.point("right_middle"), tracks, kinematic_chain("right_middle"))
    after, before = (
        smoothness.derivative_magnitudes(points, 3).mean()
        for points in (tip, tracks.point("right_middle"))
    )
    share = found.share[found.joints.index("right_shoulder")]
    assert share == pytest.approx(1 - after / before, abs=1e-3)


def test_jitter_of_the_translation_is_told_apart_and_a_joint_has_its_ancestors_only():
    motion = smooth_motion_example(200)
    jitter = 0.02 * np.random.default_rng(0).standard_normal((200, 3)).astype(np.float32)
    trembling = measures(replace(motion, trans=motion.trans + jitter), point="left_wrist")
    found = trembling["tip_jerk_attribution"]
    assert found["translation_share"] > 0.5 and max(found["share"]) < 0.1
    assert found["joints"] == [
        *("pelvis", "spine1", "spine2", "spine3", "left_collar", "left_shoulder", "left_elbow")
    ]


def test_chains_and_names_of_points():
    assert kinematic_chain("right_middle")[-1] == FINGERTIP_JOINTS[6]
    assert kinematic_chain("right_middle")[0] == 0
    assert kinematic_chain("left_hip") == (0,) and kinematic_chain("pelvis") == ()
    assert point_label("right_middle") == "right middle fingertip"
    assert point_label("left_thumb2") == "left thumb joint 2"
    assert point_label("spine3") == "spine3" and point_label("left_hip") == "left hip"


def test_tracks_do_not_depend_on_chunks(monkeypatch):
    motion = smooth_motion_example(50)
    whole = track_points(motion, SKELETON)
    monkeypatch.setattr(tracks_module, "_CHUNK_FRAMES", 7)
    parts = track_points(motion, SKELETON)
    np.testing.assert_allclose(parts.joints, whole.joints, rtol=0, atol=1e-12)
    np.testing.assert_allclose(parts.fingertips, whole.fingertips, rtol=0, atol=1e-12)


def test_spine_tilt_is_the_angle_of_a_leaning_body():
    upright = measures(posed(3))["spine_tilt_deg"]["mean"]
    leaning = measures(posed(3, pelvis=about(0, math.radians(20))))["spine_tilt_deg"]
    spine = (SKELETON.rest_joints[12] - SKELETON.rest_joints[0]).double().numpy()
    at_rest = math.degrees(math.atan2(spine[2], spine[1]))  # forwards is +z
    assert upright == pytest.approx(abs(at_rest), abs=1e-3)
    assert leaning["mean"] == pytest.approx(abs(20 + at_rest), abs=0.01)
    assert leaning["p95"] == pytest.approx(leaning["mean"])


def test_feet_slide_by_their_speed_on_the_ground_and_stand_above_the_lower_one():
    t = seconds(90)
    sliding = np.stack([0.3 * t, np.zeros(90), 0.4 * t], axis=1)  # 0.5 m/s on the ground
    lifted = np.stack([9 * t, np.full(90, 0.2), t], axis=1)  # fast, but in the air
    assert abs(posture.foot_slide(np.stack([sliding, lifted], axis=1)) - 0.5) < 1e-9
    planted = np.zeros((90, 2, 3))
    planted[:, 1, 1] = 0.02 * np.abs(np.sin(5 * t))  # a heel may lift a little
    assert posture.foot_slide(planted) == 0 and math.isnan(posture.foot_slide(planted[:1]))
    fallen = np.concatenate([np.stack([sliding, sliding], axis=1)] * 3)
    fallen[4, 0, 1] -= 1.0  # one bad frame is not new ground
    assert posture.foot_slide(fallen) > 0.4
    planted[:, :, 1] = 0.7
    planted[:, 1, 1] += np.linspace(0.0, 0.2, 90)
    height = posture.height_above_ground(planted)
    np.testing.assert_allclose(height[:, 0], 0)
    np.testing.assert_allclose(height[-1, 1], 0.2)


@pytest.mark.parametrize(("lag", "expected"), [(0.0, 1.0), (math.pi / 2, -1.0)])
def test_hands_that_move_together_or_in_turn(lag, expected):
    """|cos| and |sin| of the same angle: highs of one are lows of the other."""
    t = seconds(300)
    joints = np.zeros((300, 55, 3))
    joints[:, JOINT_INDEX["left_wrist"], 0] = np.sin(np.pi * t)
    joints[:, JOINT_INDEX["right_wrist"], 1] = np.sin(np.pi * t + lag)
    joints += 0.3 * t[:, None, None]  # a walk does not make hands symmetrical
    assert posture.hand_speed_correlation(joints) == pytest.approx(expected, abs=0.1)


def test_root_drift_is_horizontal_and_between_means():
    t = seconds(120)
    path = np.stack([0.3 * t, 5 * t, 0.4 * t], axis=1)
    assert posture.root_drift(path) == pytest.approx(0.5 * 3)
    assert math.isnan(posture.root_drift(path[:59]))


def test_fingers_outside_the_human_range():
    for joint, axis_angle, is_outside in (
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
    ):
        outside = finger_outside_limits(
            posed(2, **{joint: axis_angle}).local_rotations().numpy(), SKELETON
        )
        assert outside[0, HANDS.index(JOINT_INDEX[joint])] == is_outside, (joint, axis_angle)
        assert outside.sum() == 2 * is_outside
    rest = SKELETON.rest_joints.double().numpy()
    bone = rest[JOINT_INDEX["left_pinky3"]] - rest[JOINT_INDEX["left_pinky2"]]
    twisted = posed(2, left_pinky2=2.0 * bone / np.linalg.norm(bone))  # a bone about itself
    assert not finger_outside_limits(twisted.local_rotations().numpy(), SKELETON).any()


def test_elbows_bend_to_the_front():
    bent = posed(2, left_elbow=about(1, -1.5), right_elbow=about(1, -1.5))
    R_parent_joint = bent.local_rotations().numpy()
    assert elbow_backwards_share(R_parent_joint, SKELETON, "left") == 0
    assert elbow_backwards_share(R_parent_joint, SKELETON, "right") == 1


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
    own, recorded = (track_points(each, SKELETON) for each in (motion, reference))
    raw = error_to_reference(own, recorded)
    local, world = raw.local_rotation_error_deg, raw.global_rotation_error_deg
    assert local[elbow] == pytest.approx(math.degrees(0.5), abs=1e-3)
    assert max(np.delete(local, elbow)) < 1e-3
    for joint in (elbow, wrist, JOINT_INDEX["left_index3"]):
        assert world[joint] == pytest.approx(math.degrees(0.5), abs=1e-3)
    position = raw.position_error_m
    moved = {JOINT_NAMES[joint] for joint in range(55) if position[joint] > 1e-6}
    assert "left_wrist" in moved and "left_elbow" not in moved
    assert all(name.startswith("left") for name in moved)
    assert raw.root_error_m == pytest.approx(0.5, rel=1e-5)
    forearm = SKELETON.rest_joints[wrist] - SKELETON.rest_joints[elbow]
    across = np.linalg.norm(forearm.double().numpy()[[0, 2]])
    assert position[wrist] == pytest.approx(2 * math.sin(0.25) * across, rel=1e-4)
    assert raw.position_error_by_depth_m[7] == pytest.approx(position[wrist] / 2, abs=1e-6)
    joints = reference.poses.reshape(-1, 55, 3)[:, list(MIRROR_PERMUTATION)]
    poses = (joints * np.float32([1, -1, -1])).reshape(reference.poses.shape)
    mirrored = replace(reference, poses=poses)
    sides = error_to_reference(track_points(mirrored, SKELETON), recorded)
    assert sides.rotation_error_by_sides_deg.mirrored < 1e-2
    assert sides.rotation_error_by_sides_deg.as_is > 1


def test_beats_come_with_chance_and_speeds_of_somebody_decide_what_is_one(tmp_path):
    motion, onsets_s = smooth_motion_example(400), np.arange(2.5, 11, 0.4)

    def beats(onsets_s: np.ndarray, **given: Any):
        found = analyse_raw(motion, SKELETON, onsets_s=onsets_s, **given).metrics.beats
        assert found is not None
        return found

    own = beats(onsets_s)
    assert 0 < own.beat_align <= 1 and 0 < own.beat_align_chance <= own.beat_align_chance_highest
    assert own.beat_align_chance_highest <= 1
    assert (own.num_speech_onsets, own.beat_speed_source) == (len(onsets_s), "own")
    outside = beats(np.array([0.5, 1.9]))
    assert math.isnan(outside.beat_align) and outside.num_speech_onsets == 0
    beside = beats(onsets_s, reference=analyse_raw(motion, SKELETON))
    assert beside.beat_speed_source == "reference" and beside.beat_align == own.beat_align
    rates = []
    for speed in (1e-3, 1e3):
        np.save(tmp_path / "speeds.npy", np.full(55, speed, np.float32))
        speeds = read_mean_speeds(tmp_path / "speeds.npy")
        given = beats(onsets_s, protocol_inputs=ProtocolInputs(published_mean_speeds=speeds))
        assert given.beat_speed_source == "emage"
        rates.append(given.beats_per_joint_s)
    assert rates[0] > own.beats_per_joint_s > rates[1] == 0


@pytest.mark.parametrize("speeds", [np.ones(54), -np.ones(55), np.full(55, np.nan), None])
def test_what_are_no_mean_speeds_is_refused(speeds, tmp_path):
    path = tmp_path / "speeds.npy"
    if speeds is None:
        path.write_text("eggs")
    else:
        np.save(path, speeds)
    with pytest.raises(MotionError, match="mean_vel_smplxflame_30"):
        read_mean_speeds(path)


def test_filter_is_exact_on_a_parabola_and_gives_rotations():
    t = seconds(40)
    motion = posed(40, along(0, 0.3 * t**2 - 0.1 * t))
    np.testing.assert_allclose(smooth_motion(motion).trans, motion.trans, atol=1e-6)
    # Half turns: axis-angle jumps between pi and -pi there, rotations do not.
    angle = np.pi + 0.05 * np.where(np.arange(40) % 2, 1, -1)
    wrapped = np.where(angle > np.pi, angle - 2 * np.pi, angle)
    results = [
        Rotation.from_rotvec(smooth_motion(posed(40, pelvis=about(0, a))).poses[:, :3])
        for a in (angle, wrapped)
    ]
    assert (results[0].inv() * results[1]).magnitude().max() < 1e-5
    about_pi = (results[0] * Rotation.from_rotvec([-np.pi, 0, 0])).magnitude()
    assert about_pi[3:-3].max() < 0.03  # the noise of 0.05 rad is more than a third smaller


@pytest.mark.parametrize("num_frames", [1, 2, 3, 32, 33])
def test_any_length_gives_valid_json(num_frames):
    result = told({"a": smooth_motion_example(num_frames)}, SKELETON)
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    raw = result["systems"]["a"]["raw"]
    assert (raw["tip_jerk_m_s3"] is None) == (num_frames < 4)
    assert (raw["tip_acceleration_m_s2"] is None) == (num_frames < 3)
    assert (raw["foot_slide_m_s"] is None) == (num_frames < 2)
    assert (raw["tip_velocity_power_share_above_5hz"] is None) == (num_frames < 33)
    assert raw["seam_jerk_ratio"] is None and len(raw["joint_jerk_m_s3"]) == 55
    assert len([note for note in result["notes"] if f"a has {num_frames} frame" in note]) == (
        num_frames < 4
    )


def test_a_still_body_has_no_jerk_and_no_nan():
    result = told({"a": posed(200, trans=0.7)}, SKELETON)
    json.dumps(result, allow_nan=False)
    raw = result["systems"]["a"]["raw"]
    assert raw["tip_jerk_m_s3"] < 1e-6 and raw["foot_slide_m_s"] == 0
    assert raw["tip_velocity_power_share_above_5hz"] is None and raw["seam_jerk_ratio"] is None


def test_all_is_gathered_raw_and_filtered_and_every_key_is_documented():
    """The other system's windows are not the reference's, so nobody's are told."""
    motion, other = smooth_motion_example(60, seed=1), smooth_motion_example(60)
    windows = {"globaldiff/local": Windowing(60, 8), "other": Windowing(60, 8)}
    given: dict[str, Any] = {"onsets_s": np.arange(0.5, 3, 0.5), "reference": other}
    motions = {"globaldiff/local": motion, "other": other}
    result = told(motions, SKELETON, windows=windows, **given)
    assert (result["fps"], result["fingertip"], result["tracked_point_source"]) == (
        30,
        "right_middle",
        "rigid",
    )
    assert result["window_advance_frames"] is None and set(result["systems"]) == set(motions)
    alone = told({"other": other}, SKELETON, windows=windows)
    assert (alone["window_advance_frames"], alone["window_overlap_frames"]) == (52, 8)
    assert alone["reference"] is None
    assert "beat_align" not in alone["systems"]["other"]["raw"]
    for kind, version in (("raw", other), ("savgol", smooth_motion(other))):
        assert set(result["systems"]["other"]) == {"raw", "savgol"}
        own = measures(version)
        for found in (result["systems"]["other"][kind], result["reference"][kind]):
            for name in ("tip_jerk_m_s3", "joint_jerk_m_s3", "foot_slide_m_s"):
                assert found[name] == own[name]
        assert max(result["systems"]["other"][kind]["position_error_m"]) == 0
        assert max(result["systems"]["globaldiff/local"][kind]["position_error_m"]) > 0.01
        assert "position_error_m" not in result["reference"][kind]
    documented = (ROOT / "docs" / "formats.md").read_text()
    for key in result:
        assert f'"{key}":' in documented
    for key in result["systems"]["other"]["raw"]:
        assert f"`{key}`" in documented


def test_files_of_the_format_before_have_the_present_keys():
    before = json.loads((ROOT / "tests/model/kept/diagnostics_format_1.json").read_text())
    content = with_current_format(before)
    assert with_current_format(content) == content
    motion = smooth_motion_example(60)
    now = told({"a": motion}, SKELETON, reference=motion, onsets_s=np.arange(0.5, 2, 0.5))
    assert set(content) == set(now)
    old, new = content["systems"]["noisy"]["raw"], now["systems"]["a"]["raw"]
    lag = {"lag_s", "lag_low_s", "lag_high_s", "lag_drift_s"}
    lag |= {"lag_corrected_fps", "lag_source", "lag_z_score"}  # of speech
    assert set(old) - set(new) == lag and set(new) - set(old) <= {"protocols"}
    assert set(old["recurring_jerk"]) == set(new["recurring_jerk"])
    assert old["tip_jerk_m_s3"] == before["systems"]["noisy"]["raw"]["tip_jerk_m_s3"]
    assert content["assumptions"]["noisy"][-1] == {
        "kind": "facing",
        "value": "z",
        "reason": "as you say",
        "confidence": "user",
        "alternatives": ["x", "-z", "-x", "as-is"],
    }
    fresh = Finding("It jumps.", {}, kind="jerk", worst_frame=3).as_json()
    assert set(fresh) <= set(content["findings"]["noisy"][0])
    with pytest.raises(ValueError, match="format 9; this version of the program reads up to 2"):
        with_current_format({"format": 9})


def tracked(result: dict[str, Any]) -> tuple[str | None, str, str]:
    return result["fingertip"], result["tracked_point"], result["tracked_point_source"]


def test_a_joint_another_tip_or_a_given_track_is_followed():
    motion = smooth_motion_example(40)
    result = told({"a": motion}, SKELETON, point="left_wrist")
    assert tracked(result) == (None, "left_wrist", "joint")
    raw = result["systems"]["a"]["raw"]
    wrist_jerk = raw["joint_jerk_m_s3"][JOINT_INDEX["left_wrist"]]
    assert raw["tip_jerk_m_s3"] == pytest.approx(wrist_jerk)
    tip = told({"a": motion}, SKELETON, point="left_thumb")
    assert tracked(tip) == ("left_thumb", "left_thumb", "rigid")
    tips = track_points(motion, SKELETON).fingertips
    expected = smoothness.derivative_magnitudes(tips[:, FINGERTIP_NAMES.index("left_thumb")], 3)
    assert tip["systems"]["a"]["raw"]["tip_jerk_m_s3"] == pytest.approx(expected.mean())
    track = along(0, seconds(40) ** 3)
    given = told({"a": motion}, SKELETON, tip_track=lambda *_: track)["systems"]["a"]["raw"]
    assert given["tip_jerk_m_s3"] == pytest.approx(6, rel=1e-6)
    assert given["joint_jerk_m_s3"] == raw["joint_jerk_m_s3"]
    with pytest.raises(ValueError, match="nose is neither a fingertip nor a joint; choose one of"):
        diagnose({}, SKELETON, point="nose")


def test_a_longer_reference_or_motion_is_cut_and_said_so():
    short, long = smooth_motion_example(5), smooth_motion_example(8)
    result = told({"a": short}, SKELETON, reference=long)
    cut = told({"a": short}, SKELETON, reference=long.part(slice(5)))
    assert result["reference"] == cut["reference"] and result["num_frames"] == {"a": 5}
    assert "The reference has 8 frames; only the first 5 were measured" in result["notes"][0]
    assert cut["notes"] == []
    result = told({"a": long, "b": short}, SKELETON, reference=short)
    assert result["num_frames"] == {"a": 5, "b": 5}
    assert result["notes"][0].startswith("a has 8 frames")
    assert told({"a": long, "b": short}, SKELETON)["num_frames"] == {"a": 8, "b": 5}


@pytest.mark.beat2
def test_real_motion_has_the_known_smoothness():
    """Reference values for this clip's tip: jerk about 152 m/s^3, acceleration 8.6 m/s^2."""
    motion = load_motion(beat2_folder() / "smplxflame_30" / "2_scott_0_1_1.npz")
    result = measures(motion)
    assert 120 < result["tip_jerk_m_s3"] < 185
    assert 7 < result["tip_acceleration_m_s2"] < 10.5
    assert 0.003 < result["tip_velocity_power_share_above_5hz"] < 0.012
    assert 0.8 < result["seam_jerk_ratio"] < 1.25
    assert np.isfinite(result["jerk_by_frame_in_period_m_s3"]).all()
