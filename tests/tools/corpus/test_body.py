"""Moves, noise and inverse kinematics; hands are pushed off the trunk and off each other."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from conventions.rates import FPS
from model.motion.two_bone_ik import HingedLimb
from tools.corpus.body.arms import Swing, two_bone_ik
from tools.corpus.body.contact import Hips, push_off_trunk, separate_hands
from tools.corpus.body.signals import bump, minimum_jerk, smooth_noise, sway_line


def test_a_minimum_jerk_move_starts_and_ends_at_rest_and_a_bump_is_one_in_its_middle():
    phase = np.linspace(-0.5, 1.5, 2001)
    move = minimum_jerk(phase)
    assert move[0] == 0.0
    assert move[-1] == 1.0
    assert np.all(np.diff(move) >= 0)
    speed = np.gradient(move, phase)
    assert abs(speed.max() - 1.875) < 0.01  # 15/8, at the middle
    assert abs(phase[speed.argmax()] - 0.5) < 0.01
    np.testing.assert_allclose(bump(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])), [0, 0, 1, 0, 0])


@pytest.mark.parametrize("scale_s", [0.05, 0.2, 1.0])
def test_noise_has_the_asked_size_and_speed_and_sway_is_slow(scale_s):
    noise = smooth_noise(np.random.default_rng(0), 60_000, 2.0, scale_s, 1)[:, 0]
    assert abs(noise.std() - 2.0) < 0.25
    # Gaussian-smoothed noise: speed sd = sd / (scale sqrt 2), a little less when sampled.
    speed = np.diff(noise).std() * FPS
    assert abs(speed / (2.0 / (scale_s * np.sqrt(2))) - 1) < 0.12
    sway = sway_line(np.random.default_rng(0), 6000, 1.0)
    power = np.abs(np.fft.rfft(sway)) ** 2
    frequency = np.fft.rfftfreq(len(sway), 1 / FPS)
    assert power[frequency > 2].sum() < 0.01 * power.sum()


BONES = (np.array([0.25, -0.05, -0.03]), np.array([0.24, 0.01, -0.01]), np.array([0.0, -1.0, 0.0]))
coordinate = st.floats(-0.3, 0.3)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(coordinate, coordinate, coordinate)
def test_the_arm_reaches_what_is_in_reach_and_keeps_its_bones(x, y, z):
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


LEG = HingedLimb(np.array([0.05, -0.36, -0.01]), np.array([-0.03, -0.42, -0.03]), np.eye(3)[0])


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(0.5, 0.775), coordinate, coordinate, st.floats(-0.6, 0.6))
def test_a_leg_reaches_the_floor_by_bending_its_knee_about_one_axis(length, x, z, aside):
    span = length * np.array([[x, -1.0, z]]) / np.linalg.norm([x, -1.0, z])
    upper, knee = LEG.solve(span, np.array([[aside, 0.0, 1.0]]))
    np.testing.assert_allclose(
        upper[0] @ (LEG.upper_bone + knee[0] @ LEG.lower_bone), span[0], atol=1e-9
    )
    np.testing.assert_allclose(knee[0] @ LEG.hinge_axis, LEG.hinge_axis, atol=1e-12)
    assert knee[0, 2, 1] > 0  # the shin goes back, not forth
    assert (upper[0] @ np.array([0.0, 0.0, 1.0])) @ [aside, 0.0, 1.0] > 0


def test_a_leg_asked_for_more_than_its_length_is_straight():
    bend = np.degrees(LEG.bend_for_length(np.array([0.6, 0.7, 0.9])))
    assert bend[0] > bend[1] > 30
    assert abs(bend[2]) < 5
    np.testing.assert_allclose(
        LEG.length_at_bend(LEG.bend_for_length(np.array([0.6, 0.7]))), [0.6, 0.7]
    )


FRAMES = 30
RADII = np.array([0.02])
HIPS = Hips(np.tile(np.eye(3), (FRAMES, 1, 1)), np.tile([0.0, -0.33, 0.0], (FRAMES, 1)))


def ball(x: float, y: float, z: float) -> np.ndarray:
    return np.tile([x, y, z], (FRAMES, 1, 1)).astype(float)


def test_a_hand_in_the_trunk_leaves_it_to_the_front_or_to_its_own_side():
    in_belly = ball(0.02, -0.1, 0.18)
    push = push_off_trunk(in_belly, RADII, "left", HIPS)
    assert (push[:, 2] > 0.02).all()
    beside_hip = ball(-0.2, -0.5, 0.02)
    push = push_off_trunk(beside_hip, RADII, "right", HIPS)
    assert (push[:, 0] < -0.02).all()
    for place, side in ((in_belly, "left"), (beside_hip, "right")):
        moved = place + push_off_trunk(place, RADII, side, HIPS)[:, None]
        assert np.abs(push_off_trunk(moved, RADII, side, HIPS)).max() < 0.004


def test_hands_that_overlap_are_parted_to_contact():
    left, right = ball(0.005, 0.0, 0.3), ball(-0.005, 0.0, 0.3)
    push = separate_hands(left, right, RADII)
    gap = left[:, 0, 0] - right[:, 0, 0] + 2 * push
    np.testing.assert_allclose(gap, 2 * RADII[0] - 0.004, atol=1e-9)


def test_resting_hands_that_nearly_touch_are_drawn_together_and_gesturing_ones_are_not():
    left, right = ball(0.04, 0.0, 0.3), ball(-0.04, 0.0, 0.3)
    gap = 0.08 + 2 * separate_hands(left, right, RADII)
    np.testing.assert_allclose(gap, 2 * RADII[0] - 0.004, atol=1e-6)
    moving = 0.01 * np.arange(FRAMES)[:, None, None] * [0.0, 1.0, 0.0]  # 0.3 m/s
    np.testing.assert_allclose(separate_hands(left + moving, right + moving, RADII), 0.0, atol=1e-9)
    far = separate_hands(ball(0.24, 0.0, 0.3), ball(-0.24, 0.0, 0.3), RADII)
    np.testing.assert_allclose(far, 0.0, atol=1e-9)


def test_a_swing_lags_behind_a_steady_pull_and_swings_back_after_it():
    swing = Swing(hz=3.0, damping=0.5, lever_m=0.06)
    pull = np.zeros(5 * FPS)
    pull[FPS : 3 * FPS] = 2.0
    angle = swing.angle_deg(pull)
    steady = -np.degrees(2.0 / (0.06 * (2 * np.pi * 3.0) ** 2))
    assert not angle[:FPS].any()
    assert abs(angle[3 * FPS - 1] / steady - 1) < 0.05
    overshoot = np.exp(-np.pi * 0.5 / np.sqrt(1 - 0.5**2))  # of a second-order system
    assert abs(angle[FPS : 3 * FPS].min() / steady - (1 + overshoot)) < 0.06
    assert angle[3 * FPS :].max() > 0.1 * abs(steady)
    assert abs(angle[-1]) < 0.01 * abs(steady)
