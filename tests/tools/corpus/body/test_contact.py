"""Hands are pushed off the trunk and off each other, and swing on when they stop."""

import numpy as np

from conventions.rates import FPS
from tools.corpus.body.contact import Hips, push_apart, push_off_trunk
from tools.corpus.body.hand_life import Swing

FRAMES = 30
RADII = np.array([0.02])
HIPS = Hips(np.tile(np.eye(3), (FRAMES, 1, 1)), np.tile([0.0, -0.33, 0.0], (FRAMES, 1)))


def ball(x: float, y: float, z: float) -> np.ndarray:
    return np.tile([x, y, z], (FRAMES, 1, 1)).astype(float)


def test_a_hand_away_from_the_trunk_is_left_alone() -> None:
    for place in (ball(0.1, -0.1, 0.3), ball(0.35, -0.4, 0.0)):
        assert not push_off_trunk(place, RADII, "left", HIPS).any()


def test_a_hand_in_the_trunk_leaves_it_to_the_front_or_to_its_own_side() -> None:
    in_belly = ball(0.02, -0.1, 0.18)
    push = push_off_trunk(in_belly, RADII, "left", HIPS)
    assert (push[:, 2] > 0.02).all()
    beside_hip = ball(-0.2, -0.5, 0.02)
    push = push_off_trunk(beside_hip, RADII, "right", HIPS)
    assert (push[:, 0] < -0.02).all()
    for place, side in ((in_belly, "left"), (beside_hip, "right")):
        moved = place + push_off_trunk(place, RADII, side, HIPS)[:, None]
        assert np.abs(push_off_trunk(moved, RADII, side, HIPS)).max() < 0.004


def test_hands_that_overlap_are_parted_to_contact() -> None:
    left, right = ball(0.005, 0.0, 0.3), ball(-0.005, 0.0, 0.3)
    push = push_apart(left, right, RADII)
    gap = left[:, 0, 0] - right[:, 0, 0] + 2 * push
    np.testing.assert_allclose(gap, 2 * RADII[0] - 0.004, atol=1e-9)


def test_resting_hands_that_nearly_touch_are_drawn_together_and_gesturing_ones_are_not() -> None:
    left, right = ball(0.04, 0.0, 0.3), ball(-0.04, 0.0, 0.3)
    gap = 0.08 + 2 * push_apart(left, right, RADII)
    np.testing.assert_allclose(gap, 2 * RADII[0] - 0.004, atol=1e-6)
    moving = 0.01 * np.arange(FRAMES)[:, None, None] * [0.0, 1.0, 0.0]  # 0.3 m/s
    np.testing.assert_allclose(push_apart(left + moving, right + moving, RADII), 0.0, atol=1e-9)
    far = push_apart(ball(0.24, 0.0, 0.3), ball(-0.24, 0.0, 0.3), RADII)
    np.testing.assert_allclose(far, 0.0, atol=1e-9)


def test_a_swing_lags_behind_a_steady_pull_and_swings_back_after_it() -> None:
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
