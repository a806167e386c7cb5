"""Legs of one hinge; hands are pushed off the trunk and off each other. What moves in every clip
(noise, moves, arms) is told by the example that is made again."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from model.motion.limb import HingedLimb
from tools.corpus.body.contact import Hips, push_apart, push_off_trunk

coordinate = st.floats(-0.3, 0.3)


LEG = HingedLimb(np.array([0.05, -0.36, -0.01]), np.array([-0.03, -0.42, -0.03]), np.eye(3)[0])


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(0.5, 0.775), coordinate, coordinate, st.floats(-0.6, 0.6))
def test_a_leg_reaches_the_floor_by_bending_its_knee_about_one_axis(length, x, z, aside):
    span = length * np.array([[x, -1.0, z]]) / np.linalg.norm([x, -1.0, z])
    upper, knee = LEG.reach(span, np.array([[aside, 0.0, 1.0]]))
    np.testing.assert_allclose(upper[0] @ (LEG.upper + knee[0] @ LEG.lower), span[0], atol=1e-9)
    np.testing.assert_allclose(knee[0] @ LEG.axis, LEG.axis, atol=1e-12)
    assert knee[0, 2, 1] > 0  # the shin goes back, not forth
    assert (upper[0] @ np.array([0.0, 0.0, 1.0])) @ [aside, 0.0, 1.0] > 0


def test_a_leg_asked_for_more_than_its_length_is_straight():
    bend = np.degrees(LEG.bend(np.array([0.6, 0.7, 0.9])))
    assert bend[0] > bend[1] > 30
    assert abs(bend[2]) < 5
    np.testing.assert_allclose(LEG.length(LEG.bend(np.array([0.6, 0.7]))), [0.6, 0.7])


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
    push = push_apart(left, right, RADII)
    gap = left[:, 0, 0] - right[:, 0, 0] + 2 * push
    np.testing.assert_allclose(gap, 2 * RADII[0] - 0.004, atol=1e-9)


def test_resting_hands_that_nearly_touch_are_drawn_together_and_gesturing_ones_are_not():
    left, right = ball(0.04, 0.0, 0.3), ball(-0.04, 0.0, 0.3)
    gap = 0.08 + 2 * push_apart(left, right, RADII)
    np.testing.assert_allclose(gap, 2 * RADII[0] - 0.004, atol=1e-6)
    moving = 0.01 * np.arange(FRAMES)[:, None, None] * [0.0, 1.0, 0.0]  # 0.3 m/s
    np.testing.assert_allclose(push_apart(left + moving, right + moving, RADII), 0.0, atol=1e-9)
    far = push_apart(ball(0.24, 0.0, 0.3), ball(-0.24, 0.0, 0.3), RADII)
    np.testing.assert_allclose(far, 0.0, atol=1e-9)
