"""Feet that stand where a plan plants them."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float

from conventions.joints import JOINT_INDEX, JOINT_NAMES
from model.generation.limbs import ANKLE_M, LIFT_M, Footing, HeldFeet
from model.motion.kinematics import RestSkeleton, joint_positions_from_local, open_body_skeleton
from model.motion.motion import Motion, put_together
from model.plan.plan import Planted, Side

BODY = open_body_skeleton()
FRAMES = 150
ANKLES = [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
LEG = [
    JOINT_INDEX[f"{side}_{joint}"]
    for side in ("left", "right")
    for joint in ("hip", "knee", "ankle")
]
STANDS = (
    Planted(0.0, 2.0, "left"),
    Planted(2.5, 5.0, "left"),
    Planted(0.0, 5.0, "right"),
)


def moving(seed: int = 0, high: float = 0.0) -> Motion:
    """Someone whose legs tremble and whose body drifts, with the ankles about where they belong."""
    rng = np.random.default_rng(seed)
    poses = np.cumsum(rng.normal(0, 0.004, (FRAMES, 55, 3)), axis=0)
    poses[:, [JOINT_INDEX["left_knee"], JOINT_INDEX["right_knee"]], 0] += 0.2
    trans = np.cumsum(rng.normal(0, 0.001, (FRAMES, 3)), axis=0)
    trans[:, 1] += ANKLE_M - float(BODY.rest_joints[ANKLES[0], 1]) - 0.02 + high
    return Motion(
        poses=poses.reshape(FRAMES, 165).astype(np.float32),
        trans=trans.astype(np.float32),
        expressions=np.zeros((FRAMES, 100), np.float32),
        expression_basis="arkit52",
        betas=np.zeros(300, np.float32),
    )


def joints(motion: Motion, skeleton: RestSkeleton = BODY) -> Float[np.ndarray, "T 55 3"]:
    trans = torch.from_numpy(motion.trans)
    return joint_positions_from_local(motion.local_rotations(), skeleton, trans)[1].numpy()


def soles(motion: Motion) -> Float[np.ndarray, "T 2 3"]:
    turned, _ = joint_positions_from_local(motion.local_rotations(), BODY)
    return turned[:, ANKLES, :, 1].numpy()


def test_a_planted_foot_stays_to_a_tenth_of_a_millimetre_with_its_sole_flat() -> None:
    before = moving()
    after = HeldFeet(STANDS, BODY).hold(before)
    left, right = joints(after)[:, ANKLES[0]], joints(after)[:, ANKLES[1]]
    for path in (right, left[:60], left[75 + 6 :]):
        assert np.abs(path - path[0]).max() < 1e-4
        np.testing.assert_allclose(path[:, 1], ANKLE_M, atol=1e-4)
    np.testing.assert_allclose(soles(after)[:, 1], np.tile([0, 1, 0], (FRAMES, 1)), atol=1e-4)
    assert np.ptp(joints(before)[:, ANKLES[1]], axis=0).max() > 0.02  # it had not


def test_it_stands_where_it_was_and_lands_where_the_network_led_it() -> None:
    before = moving()
    after = HeldFeet(STANDS, BODY).hold(before)
    was, now = joints(before)[:, ANKLES[0]], joints(after)[:, ANKLES[0]]
    np.testing.assert_allclose(now[0, [0, 2]], was[0, [0, 2]], atol=1e-4)
    np.testing.assert_allclose(now[90, [0, 2]], was[75, [0, 2]], atol=1e-4)


def test_a_step_is_lifted_once_and_no_frame_jumps() -> None:
    after = HeldFeet(STANDS, BODY).hold(moving())
    height = joints(after)[:, ANKLES[0], 1] - ANKLE_M
    assert height[60:75].max() == pytest.approx(LIFT_M, rel=0.05)
    assert np.abs(np.diff(joints(after)[:, ANKLES[0]], axis=0)).max() < 0.03


def test_the_rest_of_the_body_is_left_alone() -> None:
    before = moving()
    after = HeldFeet(STANDS, BODY).hold(before)
    others = [joint for joint in range(len(JOINT_NAMES)) if joint not in LEG]
    one, other = (m.poses.reshape(-1, 55, 3)[:, others] for m in (before, after))
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(before.trans[:, [0, 2]], after.trans[:, [0, 2]])


def test_a_body_that_stands_too_high_is_let_down_until_its_legs_reach() -> None:
    high = moving(high=0.1)
    after = HeldFeet(STANDS, BODY).hold(high)
    np.testing.assert_allclose(joints(after)[:, ANKLES[1], 1], ANKLE_M, atol=1e-4)
    assert (high.trans[:, 1] - after.trans[:, 1]).min() > 0.05


def test_a_foot_that_is_never_planted_is_left_to_the_network() -> None:
    before = moving()
    assert HeldFeet((), BODY).hold(before) is before
    after = HeldFeet(STANDS[:2], BODY).hold(before)
    right = [joint for joint in LEG if JOINT_NAMES[joint].startswith("right")]
    one, other = (m.poses.reshape(-1, 55, 3)[:, right] for m in (before, after))
    np.testing.assert_array_equal(one, other)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, FRAMES - 1), max_size=5, unique=True), st.integers(0, 5))
def test_pieces_of_any_length_are_the_whole(cuts: list[int], seed: int) -> None:
    motion = moving(seed)
    whole = HeldFeet(STANDS, BODY).hold(motion)
    held = HeldFeet(STANDS, BODY)
    edges = [0, *sorted(cuts), FRAMES]
    pieces = put_together([held.hold(motion.part(slice(*edge))) for edge in pairwise(edges)])
    np.testing.assert_allclose(pieces.poses, whole.poses, atol=1e-6)
    np.testing.assert_allclose(pieces.trans, whole.trans, atol=1e-6)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_known_footing_is_kept(side: Side) -> None:
    stand = Planted(1.0, 4.0, side)
    held = HeldFeet((stand,), BODY, {stand: Footing(0.3, 0.1, 0.2)})
    at = joints(held.hold(moving()))[40:110, JOINT_INDEX[f"{side}_ankle"]]
    np.testing.assert_allclose(at, np.tile([0.3, ANKLE_M, 0.1], (70, 1)), atol=1e-4)
    assert held.found == {stand: Footing(0.3, 0.1, 0.2)}


def test_stands_that_round_to_no_frame_or_lie_behind_the_motion_do_no_harm() -> None:
    stands = (Planted(1.0, 1.001, "left"), Planted(40.0, 50.0, "left"))
    assert np.isfinite(HeldFeet(stands, BODY).hold(moving()).poses).all()
