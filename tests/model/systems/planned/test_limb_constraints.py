"""Feet that stand where a plan plants them, and hands that are led to where it has them."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from conventions.joints import JOINT_INDEX, JOINT_NAMES
from model.motion.kinematics import forward_kinematics, open_body_skeleton
from model.motion.motion import Motion, concatenate
from model.motion.tracks import track_points, wrist_positions_in_chest_frame
from model.plan.editing import add_gesture
from model.plan.plan import SIDES, FootContact, GesturePlan, Side, fill_gaps
from model.plan.plan_features import goal_path
from model.systems.planned.limb_constraints import (
    ANKLE_M,
    HAND_GUIDE_WEIGHT,
    LIFT_M,
    MAX_REACH_SHARE,
    FootLock,
    FootPlacement,
    HandGuide,
)
from tests.model.motion.made import about, posed
from tests.model.plan.made import phase, resting

BODY = open_body_skeleton()
FRAMES = 150
ANKLES = [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
LEG = [JOINT_INDEX[f"{side}_{joint}"] for side in SIDES for joint in ("hip", "knee", "ankle")]
STANDS = (
    FootContact(0.0, 2.0, "left"),
    FootContact(2.5, 5.0, "left"),
    FootContact(0.0, 5.0, "right"),
)


def by_name(poses: np.ndarray) -> dict[str, np.ndarray]:
    return {name: poses[:, joint] for joint, name in enumerate(JOINT_NAMES)}


def trembling(seed: int = 0, high: float = 0.0) -> Motion:
    """Someone whose legs tremble and whose body drifts, with the ankles about where they belong."""
    rng = np.random.default_rng(seed)
    poses = np.cumsum(rng.normal(0, 0.004, (FRAMES, 55, 3)), axis=0)
    poses[:, [JOINT_INDEX["left_knee"], JOINT_INDEX["right_knee"]], 0] += 0.2
    trans = np.cumsum(rng.normal(0, 0.001, (FRAMES, 3)), axis=0)
    trans[:, 1] += ANKLE_M - float(BODY.rest_joints[ANKLES[0], 1]) - 0.02 + high
    return posed(FRAMES, trans, **by_name(poses))


def joints(motion: Motion) -> np.ndarray:
    trans = torch.from_numpy(motion.trans)
    return forward_kinematics(motion.local_rotations(), BODY, trans)[1].numpy()


def poses_of(motion: Motion, which: list[int]) -> np.ndarray:
    return motion.poses.reshape(-1, 55, 3)[:, which]


@pytest.fixture(scope="module")
def before() -> Motion:
    return trembling()


@pytest.fixture(scope="module")
def after(before) -> Motion:
    return FootLock(STANDS).constrain_next(before)


def test_a_planted_foot_stays_to_a_tenth_of_a_millimetre_with_its_sole_flat(before, after):
    left, right = joints(after)[:, ANKLES[0]], joints(after)[:, ANKLES[1]]
    for path in (right, left[:60], left[75 + 6 :]):
        assert np.abs(path - path[0]).max() < 1e-4
        np.testing.assert_allclose(path[:, 1], ANKLE_M, atol=1e-4)
    turned, _ = forward_kinematics(after.local_rotations(), BODY)
    soles = turned[:, ANKLES, :, 1].numpy()
    np.testing.assert_allclose(soles[:, 1], np.tile([0, 1, 0], (FRAMES, 1)), atol=1e-4)
    assert np.ptp(joints(before)[:, ANKLES[1]], axis=0).max() > 0.02  # it had not


def test_it_stands_where_it_was_lands_where_the_network_led_it_and_is_lifted_between(before, after):
    was, now = joints(before)[:, ANKLES[0]], joints(after)[:, ANKLES[0]]
    np.testing.assert_allclose(now[0, [0, 2]], was[0, [0, 2]], atol=1e-4)
    np.testing.assert_allclose(now[90, [0, 2]], was[75, [0, 2]], atol=1e-4)
    assert (now[60:75, 1] - ANKLE_M).max() == pytest.approx(LIFT_M, rel=0.05)
    assert np.abs(np.diff(now, axis=0)).max() < 0.03  # no frame jumps


def test_the_rest_of_the_body_and_feet_that_are_never_planted_are_left_alone(before, after):
    others = [joint for joint in range(len(JOINT_NAMES)) if joint not in LEG]
    np.testing.assert_array_equal(poses_of(before, others), poses_of(after, others))
    np.testing.assert_array_equal(before.trans[:, [0, 2]], after.trans[:, [0, 2]])
    assert FootLock(()).constrain_next(before) is before
    left = FootLock(STANDS[:2]).constrain_next(before)
    right_leg = [joint for joint in LEG if JOINT_NAMES[joint].startswith("right")]
    np.testing.assert_array_equal(poses_of(before, right_leg), poses_of(left, right_leg))


def test_a_body_that_stands_too_high_is_let_down_until_its_legs_reach():
    high = trembling(high=0.1)
    low = FootLock(STANDS).constrain_next(high)
    np.testing.assert_allclose(joints(low)[:, ANKLES[1], 1], ANKLE_M, atol=1e-4)
    assert (high.trans[:, 1] - low.trans[:, 1]).min() > 0.05


@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.lists(st.integers(1, FRAMES - 1), max_size=5, unique=True), st.integers(0, 5))
def test_feet_in_pieces_of_any_length_are_held_as_in_the_whole(cuts, seed):
    motion = trembling(seed)
    whole = FootLock(STANDS).constrain_next(motion)
    held = FootLock(STANDS)
    edges = [0, *sorted(cuts), FRAMES]
    pieces = concatenate(
        [held.constrain_next(motion.part(slice(*edge))) for edge in pairwise(edges)]
    )
    np.testing.assert_allclose(pieces.poses, whole.poses, atol=1e-6)
    np.testing.assert_allclose(pieces.trans, whole.trans, atol=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_a_known_footing_is_kept(before, side):
    stand = FootContact(1.0, 4.0, side)
    held = FootLock((stand,), {stand: FootPlacement(0.3, 0.1, 0.2)})
    at = joints(held.constrain_next(before))[40:110, JOINT_INDEX[f"{side}_ankle"]]
    np.testing.assert_allclose(at, np.tile([0.3, ANKLE_M, 0.1], (70, 1)), atol=1e-4)
    assert held.placements == {stand: FootPlacement(0.3, 0.1, 0.2)}


def test_stands_that_round_to_no_frame_or_lie_behind_the_motion_do_no_harm(before):
    stands = (FootContact(1.0, 1.001, "left"), FootContact(40.0, 50.0, "left"))
    assert np.isfinite(FootLock(stands).constrain_next(before).poses).all()


LONG = 240
ARMS = [JOINT_INDEX[f"{side}_{name}"] for side in SIDES for name in ("shoulder", "elbow")]
PLAN = add_gesture(add_gesture(resting(8.0), "offer", 2.0, "right").plan, "stop", 5.0, "left").plan


def swaying() -> Motion:
    """Someone with hanging, bent arms who sways."""
    rng = np.random.default_rng(0)
    poses = np.cumsum(np.cumsum(rng.normal(0, 2e-4, (LONG, 55, 3)), axis=0), axis=0)
    poses -= np.linspace(0, 1, LONG)[:, None, None] * poses[-1]
    named = by_name(poses)
    for side, sign in (("left", 1), ("right", -1)):
        named[f"{side}_shoulder"] = named[f"{side}_shoulder"] + about(2, -sign * 1.1)
        named[f"{side}_elbow"] = named[f"{side}_elbow"] + about(1, -sign * 1.2)
    return posed(LONG, **named)


@pytest.fixture(scope="module")
def swayed() -> Motion:
    return swaying()


@pytest.fixture(scope="module")
def led(swayed) -> Motion:
    return HandGuide(PLAN).constrain_next(swayed)


def off(motion: Motion, side: Side) -> np.ndarray:
    """Metres from the planned path."""
    path = goal_path(fill_gaps(PLAN.hand(side), PLAN.duration_s), (np.arange(LONG) + 0.5) / 30)
    return np.linalg.norm(
        wrist_positions_in_chest_frame(track_points(motion, BODY))[side] - path, axis=1
    )


def test_wrists_are_led_their_share_of_the_way_and_no_frame_jumps(swayed, led):
    for side in SIDES:
        was, now = off(swayed, side), off(led, side)
        assert was.mean() > 0.1
        np.testing.assert_allclose(now, (1 - HAND_GUIDE_WEIGHT) * was, atol=0.02)
        np.testing.assert_allclose(now.mean(), (1 - HAND_GUIDE_WEIGHT) * was.mean(), rtol=0.05)
    steps = np.abs(np.diff(poses_of(led, ARMS), axis=0))
    assert steps.max() < 0.25  # a stroke of .3 s turns joints by about as much


def test_nothing_but_shoulders_and_elbows_turns(swayed, led):
    changed = np.abs(led.poses - swayed.poses).reshape(LONG, 55, 3).max(axis=(0, 2)) > 0
    assert np.flatnonzero(changed).tolist() == sorted(ARMS)
    np.testing.assert_array_equal(led.trans, swayed.trans)


def test_a_hand_that_is_where_it_should_be_stays(led):
    for _ in range(12):
        led = HandGuide(PLAN).constrain_next(led)
    again = HandGuide(PLAN).constrain_next(led)
    assert np.abs(again.poses - led.poses).max() < 2e-3


def test_places_out_of_reach_leave_the_elbow_a_little_bent(swayed):
    plan = GesturePlan(8.0, right=(phase(0.0, 8.0, "hold", (0.7, 0.5, 0.6)),))
    led = swayed
    for _ in range(4):
        led = HandGuide(plan).constrain_next(led)
    shoulder, elbow, wrist = (JOINT_INDEX[f"right_{j}"] for j in ("shoulder", "elbow", "wrist"))
    span = np.linalg.norm(joints(led)[:, wrist] - joints(led)[:, shoulder], axis=1)
    rest = BODY.rest_joints
    straight = float((rest[elbow] - rest[shoulder]).norm() + (rest[wrist] - rest[elbow]).norm())
    assert 0.95 * straight < span.min() and span.max() <= MAX_REACH_SHARE * straight + 1e-4


def test_hands_that_no_plan_tells_of_are_left_alone(swayed):
    assert HandGuide(GesturePlan(8.0)).constrain_next(swayed) is swayed
    right = HandGuide(GesturePlan(8.0, right=PLAN.right)).constrain_next(swayed)
    np.testing.assert_array_equal(poses_of(right, ARMS[:2]), poses_of(swayed, ARMS[:2]))


def test_pieces_are_led_as_the_whole(swayed, led):
    hands = HandGuide(PLAN)
    parts = [
        hands.constrain_next(swayed.part(slice(a, b))) for a, b in ((0, 52), (52, 60), (60, LONG))
    ]
    np.testing.assert_allclose(concatenate(parts).poses, led.poses, atol=1e-6)


def test_what_lies_far_from_a_change_of_the_plan_stays_bit_for_bit(swayed, led):
    other = HandGuide(add_gesture(PLAN, "you", 4.0, "right").plan).constrain_next(swayed)
    same = (led.poses == other.poses).all(axis=1)
    assert same[:80].all() and same[180:].all() and not same[100:115].any()
