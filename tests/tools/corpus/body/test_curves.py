"""Moves, noise and inverse kinematics."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from conventions.rates import FPS
from model.motion.limb import HingedLimb
from tools.corpus.body.arm import two_bone_ik
from tools.corpus.body.signals import bump, minimum_jerk, smooth_noise, sway_line
from tools.corpus.people.rig import forward_kinematics, matrices, open_body_rig


def test_a_minimum_jerk_move_starts_and_ends_at_rest() -> None:
    phase = np.linspace(-0.5, 1.5, 2001)
    move = minimum_jerk(phase)
    assert move[0] == 0.0
    assert move[-1] == 1.0
    assert np.all(np.diff(move) >= 0)
    speed = np.gradient(move, phase)
    assert abs(speed.max() - 1.875) < 0.01  # 15/8, at the middle
    assert abs(phase[speed.argmax()] - 0.5) < 0.01


def test_a_bump_rises_to_one_in_the_middle() -> None:
    np.testing.assert_allclose(bump(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])), [0, 0, 1, 0, 0])


@pytest.mark.parametrize("scale_s", [0.05, 0.2, 1.0])
def test_noise_has_the_asked_size_and_speed(scale_s: float) -> None:
    noise = smooth_noise(np.random.default_rng(0), 60_000, 2.0, scale_s, 1)[:, 0]
    assert abs(noise.std() - 2.0) < 0.25
    # Gaussian-smoothed noise: speed sd = sd / (scale sqrt 2), a little less when sampled.
    speed = np.diff(noise).std() * FPS
    assert abs(speed / (2.0 / (scale_s * np.sqrt(2))) - 1) < 0.12


def test_sway_is_slow() -> None:
    sway = sway_line(np.random.default_rng(0), 6000, 1.0)
    power = np.abs(np.fft.rfft(sway)) ** 2
    frequency = np.fft.rfftfreq(len(sway), 1 / FPS)
    assert power[frequency > 2].sum() < 0.01 * power.sum()


BONES = (np.array([0.25, -0.05, -0.03]), np.array([0.24, 0.01, -0.01]), np.array([0.0, -1.0, 0.0]))
coordinate = st.floats(-0.3, 0.3)


@settings(max_examples=60, deadline=None)
@given(coordinate, coordinate, coordinate)
def test_the_arm_reaches_what_is_in_reach_and_keeps_its_bones(x: float, y: float, z: float) -> None:
    upper, lower, hinge = BONES
    assume(np.hypot(x, np.hypot(y, z)) > 0.02)
    target = np.array([[x, y, z]])
    pole = np.array([[0.3, -1.0, -0.4]])
    root = np.zeros((1, 3))
    upper_rot, lower_rot, direction = two_bone_ik(root, target, upper, lower, hinge, pole)
    for rotmat in (upper_rot, lower_rot):
        np.testing.assert_allclose(rotmat[0] @ rotmat[0].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotmat[0]) > 0.99
    end = upper_rot[0] @ upper + lower_rot[0] @ lower
    reach = np.linalg.norm(upper) + np.linalg.norm(lower)
    distance = np.linalg.norm(target)
    if 0.08 < distance < 0.92 * reach:
        np.testing.assert_allclose(end, target[0], atol=1e-6)
    assert np.linalg.norm(end) < 0.986 * reach
    np.testing.assert_allclose(
        lower_rot[0] @ lower / np.linalg.norm(lower), direction[0], atol=1e-9
    )


def test_a_target_out_of_reach_is_pointed_at_without_a_snap() -> None:
    upper, lower, hinge = BONES
    distances = np.linspace(0.3, 0.8, 200)
    target = distances[:, None] * np.array([0.6, -0.64, 0.48])
    pole = np.tile([0.3, -1.0, -0.4], (200, 1))
    upper_rot, _, _ = two_bone_ik(np.zeros((200, 3)), target, upper, lower, hinge, pole)
    step = matrices(np.zeros((1, 3))) - np.swapaxes(upper_rot[:-1], 1, 2) @ upper_rot[1:]
    assert np.linalg.norm(step, axis=(1, 2)).max() < 0.06


LEG = HingedLimb(np.array([0.05, -0.36, -0.01]), np.array([-0.03, -0.42, -0.03]), np.eye(3)[0])


@settings(max_examples=60, deadline=None)
@given(st.floats(0.5, 0.775), coordinate, coordinate, st.floats(-0.6, 0.6))
def test_a_leg_reaches_the_floor_by_bending_its_knee_about_one_axis(
    length: float, x: float, z: float, aside: float
) -> None:
    span = length * np.array([[x, -1.0, z]]) / np.linalg.norm([x, -1.0, z])
    upper, knee = LEG.reach(span, np.array([[aside, 0.0, 1.0]]))
    np.testing.assert_allclose(upper[0] @ (LEG.upper + knee[0] @ LEG.lower), span[0], atol=1e-9)
    np.testing.assert_allclose(knee[0] @ LEG.axis, LEG.axis, atol=1e-12)
    assert knee[0, 2, 1] > 0  # the shin goes back, not forth
    assert (upper[0] @ np.array([0.0, 0.0, 1.0])) @ [aside, 0.0, 1.0] > 0


def test_a_leg_asked_for_more_than_its_length_is_straight() -> None:
    bend = np.degrees(LEG.bend(np.array([0.6, 0.7, 0.9])))
    assert bend[0] > bend[1] > 30
    assert abs(bend[2]) < 5
    np.testing.assert_allclose(LEG.length(LEG.bend(np.array([0.6, 0.7]))), [0.6, 0.7])


def test_the_rig_rests_where_the_open_body_does() -> None:
    rig = open_body_rig()
    rest = np.tile(np.eye(3), (1, 55, 1, 1))
    _, positions = forward_kinematics(rig, rest, np.zeros((1, 3)))
    np.testing.assert_allclose(positions[0], rig.rest_joints, atol=1e-9)
    assert -1.31 < rig.floor_m < -1.28
