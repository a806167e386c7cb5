"""Hands that are led to where a plan has them."""

import numpy as np
import pytest
import torch
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from model.generation.limbs import LED, LONGEST, LedHands
from model.motion.kinematics import joint_positions_from_local, open_body_skeleton
from model.motion.motion import Motion, put_together
from model.motion.tracks import track_points
from model.plan.editing import added
from model.plan.kinds import wrist_places
from model.plan.plan import SIDES, GesturePlan, Side
from model.plan.tracks import goal_path, without_gaps
from tests.model.plan.made import phase

BODY = open_body_skeleton()
FRAMES = 240
ARMS = [JOINT_INDEX[f"{side}_{name}"] for side in SIDES for name in ("shoulder", "elbow")]


def moving(seed: int = 0) -> Motion:
    """Someone with hanging, bent arms who sways."""
    rng = np.random.default_rng(seed)
    poses = np.cumsum(np.cumsum(rng.normal(0, 2e-4, (FRAMES, 55, 3)), axis=0), axis=0)
    poses -= np.linspace(0, 1, FRAMES)[:, None, None] * poses[-1]
    for side, sign in (("left", 1), ("right", -1)):
        poses[:, JOINT_INDEX[f"{side}_shoulder"], 2] -= sign * 1.1
        poses[:, JOINT_INDEX[f"{side}_elbow"], 1] -= sign * 1.2
    return Motion(
        poses=poses.reshape(FRAMES, 165).astype(np.float32),
        trans=np.zeros((FRAMES, 3), np.float32),
        expressions=np.zeros((FRAMES, 100), np.float32),
        expression_basis="arkit52",
        betas=np.zeros(300, np.float32),
    )


@pytest.fixture(scope="module")
def plan() -> GesturePlan:
    seconds = FRAMES / 30
    made = GesturePlan(
        seconds, left=(phase(0.0, seconds, "rest"),), right=(phase(0.0, seconds, "rest"),)
    )
    made = added(made, "offer", 2.0, "right").plan
    return added(made, "stop", 5.0, "left").plan


def off(motion: Motion, plan: GesturePlan, side: Side) -> Float[np.ndarray, " T"]:
    """Metres from the planned path."""
    path = goal_path(without_gaps(plan.hand(side), plan.duration_s), (np.arange(FRAMES) + 0.5) / 30)
    return np.linalg.norm(wrist_places(track_points(motion, BODY))[side] - path, axis=1)


def test_wrists_are_led_their_share_of_the_way(plan):
    before = moving()
    after = LedHands(plan, BODY).lead(before)
    for side in SIDES:
        was, now = off(before, plan, side), off(after, plan, side)
        assert was.mean() > 0.1
        np.testing.assert_allclose(now, (1 - LED) * was, atol=0.02)
        np.testing.assert_allclose(now.mean(), (1 - LED) * was.mean(), rtol=0.05)


def test_nothing_but_shoulders_and_elbows_turns_and_bones_keep_their_length(plan):
    before = moving()
    after = LedHands(plan, BODY).lead(before)
    changed = np.abs(after.poses - before.poses).reshape(FRAMES, 55, 3).max(axis=(0, 2)) > 0
    assert np.flatnonzero(changed).tolist() == sorted(ARMS)
    np.testing.assert_array_equal(after.trans, before.trans)
    _, joints = joint_positions_from_local(after.local_rotations(), BODY)
    for side in SIDES:
        shoulder, elbow, wrist = (
            JOINT_INDEX[f"{side}_{j}"] for j in ("shoulder", "elbow", "wrist")
        )
        rest = BODY.rest_joints
        for a, b in ((shoulder, elbow), (elbow, wrist)):
            length = (joints[:, a] - joints[:, b]).norm(dim=1)
            torch.testing.assert_close(length, (rest[a] - rest[b]).norm().expand(FRAMES))


def test_a_hand_that_is_where_it_should_be_stays(plan):
    led = LedHands(plan, BODY).lead(moving())
    for _ in range(20):
        led = LedHands(plan, BODY).lead(led)
    again = LedHands(plan, BODY).lead(led)
    assert np.abs(again.poses - led.poses).max() < 2e-3


def test_no_frame_jumps(plan):
    before = moving()
    after = LedHands(plan, BODY).lead(before)
    steps = np.abs(np.diff(after.poses.reshape(FRAMES, 55, 3)[:, ARMS], axis=0))
    assert steps.max() < 0.25  # a stroke of .3 s turns joints by about as much


def test_places_out_of_reach_leave_the_elbow_a_little_bent():
    far = phase(0.0, FRAMES / 30, "hold", (0.7, 0.5, 0.6))
    plan = GesturePlan(FRAMES / 30, right=(far,))
    led = moving()
    for _ in range(4):
        led = LedHands(plan, BODY).lead(led)
    _, joints = joint_positions_from_local(led.local_rotations(), BODY)
    shoulder, elbow, wrist = (JOINT_INDEX[f"right_{j}"] for j in ("shoulder", "elbow", "wrist"))
    span = (joints[:, wrist] - joints[:, shoulder]).norm(dim=1)
    straight = (BODY.rest_joints[elbow] - BODY.rest_joints[shoulder]).norm() + (
        BODY.rest_joints[wrist] - BODY.rest_joints[elbow]
    ).norm()
    assert 0.95 * straight < span.min() and span.max() <= LONGEST * straight + 1e-4
    assert np.isfinite(led.poses).all()


def test_hands_that_no_plan_tells_of_are_left_alone(plan):
    before = moving()
    assert LedHands(GesturePlan(8.0), BODY).lead(before) is before
    one = GesturePlan(8.0, right=plan.right)
    after = LedHands(one, BODY).lead(before)
    left = [JOINT_INDEX["left_shoulder"], JOINT_INDEX["left_elbow"]]
    np.testing.assert_array_equal(
        after.poses.reshape(FRAMES, 55, 3)[:, left], before.poses.reshape(FRAMES, 55, 3)[:, left]
    )


def test_pieces_are_led_as_the_whole(plan):
    motion = moving()
    whole = LedHands(plan, BODY).lead(motion)
    hands = LedHands(plan, BODY)
    parts = [hands.lead(motion.part(slice(a, b))) for a, b in ((0, 52), (52, 60), (60, FRAMES))]
    np.testing.assert_allclose(put_together(parts).poses, whole.poses, atol=1e-6)


def test_what_lies_far_from_a_change_of_the_plan_stays_bit_for_bit(plan):
    motion = moving()
    changed = added(plan, "you", 4.0, "right").plan
    one, other = (LedHands(p, BODY).lead(motion).poses for p in (plan, changed))
    same = (one == other).all(axis=1)
    assert same[:80].all() and same[180:].all() and not same[100:115].any()
