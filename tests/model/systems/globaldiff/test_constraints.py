"""The paper's constraints in closed form, and bodies that are led home."""

import torch
from torch import Tensor

from conventions.joints import JOINT_INDEX, PARENTS
from model.motion.kinematics import (
    global_from_local,
    joint_positions_from_global,
    open_body_skeleton,
)
from model.motion.rotations import matrix_from_axis_angle
from model.systems.globaldiff import task as constraints
from model.systems.globaldiff.system import pull_towards_origin
from model.training.losses import points_loss
from tests.helpers import random_local_rotations

ANCHORS = constraints.octahedron_anchors()
TIP = JOINT_INDEX["right_middle3"]


def rotations(seed: int = 0) -> Tensor:
    """Global rotations (2, 3, 55, 3, 3)."""
    return global_from_local(random_local_rotations((2, 3), seed, torch.float32))


def positions_of(R_world_joint: Tensor) -> Tensor:
    return joint_positions_from_global(R_world_joint, open_body_skeleton())


def turned(rotmat: Tensor, axis_angle: list[float], *, joint: int) -> Tensor:
    """With one joint turned further about an axis of its own frame, in sample 1 only."""
    result = rotmat.clone()
    result[1, :, joint] = rotmat[1, :, joint] @ matrix_from_axis_angle(torch.tensor(axis_angle))
    return result


def test_twist_of_a_leaf_joint_is_seen_by_anchors_and_not_by_positions():
    target = rotations()
    twisted = turned(target, [0.5, 0, 0], joint=TIP)
    assert (points_loss(positions_of(twisted), positions_of(target)) == 0).all()
    loss = constraints.joint_structure_loss(twisted, target, ANCHORS)
    # Chord of 0.5 rad for the four anchors off the axis, one joint of 55.
    chord = 2 * 0.05 * torch.sin(torch.tensor(0.25))
    torch.testing.assert_close(loss, torch.stack([torch.tensor(0.0), 4 / 6 * chord**2 / 55]))


def test_skeleton_loss_equals_the_matrices_of_equation_13():
    a, b = positions_of(rotations(0)), positions_of(rotations(1))
    directions = [constraints.bone_directions_and_lengths(p)[0] for p in (a, b)]
    matrices = [each @ each.mT for each in directions]
    squared = (matrices[0] - matrices[1]).square()
    expected = squared.sum((-1, -2)).mean(-1) / (54 * 53)  # the diagonal is 1 in both
    torch.testing.assert_close(constraints.skeleton_structure_loss(a, b), expected)
    assert (constraints.skeleton_structure_loss(a, a) == 0).all()


def test_degenerate_bones_count_in_neither_sum_nor_number():
    a, b = positions_of(rotations(0)), positions_of(rotations(1))
    foot = JOINT_INDEX["left_foot"]
    a[:, :, foot] = a[:, :, PARENTS[foot]]  # a bone without length, in the prediction only
    directions = [constraints.bone_directions_and_lengths(p)[0] for p in (a, b)]
    keep = [joint - 1 for joint in range(1, 55) if joint != foot]
    first, second = (d[..., keep, :] @ d[..., keep, :].mT for d in directions)
    expected = (first - second).square().sum((-1, -2)).mean(-1) / (53 * 52)
    torch.testing.assert_close(constraints.skeleton_structure_loss(a, b), expected)


def test_degenerate_bones_leave_gradients_finite():
    a = torch.zeros(1, 2, 55, 3, requires_grad=True)
    constraints.skeleton_structure_loss(a, positions_of(rotations())[:1, :2]).sum().backward()
    assert a.grad is not None and a.grad.isfinite().all()


def test_temporal_loss_weighs_scales_alike_and_samples_apart():
    zeros = [torch.zeros(2, 30, 4), torch.zeros(2, 15, 4)]
    off = [torch.zeros(2, 30, 4), torch.zeros(2, 15, 4)]
    off[0][0] += 1.0
    off[1][1] += 2.0
    loss = constraints.temporal_structure_loss(off, zeros)
    torch.testing.assert_close(loss, torch.tensor([1.0, 4.0]))


HOME_S = 40.0


def test_a_body_is_led_back_by_its_share_of_the_way_and_only_sideways():
    vectors = torch.randn(2, 60, 168)
    home = pull_towards_origin(vectors, 8, HOME_S)
    torch.testing.assert_close(home[:, :8], vectors[:, :8])
    torch.testing.assert_close(home[..., :-3], vectors[..., :-3])
    torch.testing.assert_close(home[..., -2], vectors[..., -2])  # its height
    away = vectors[:, 7][:, [-3, -1]]
    led = (vectors - home)[..., [-3, -1]]
    torch.testing.assert_close(led[:, -1], away * 52 / 30 / HOME_S, rtol=2e-3, atol=1e-5)
    assert (led.diff(dim=1).sign()[:, 8:] == away.sign()[:, None]).all()
    assert led[:, 8].abs().max() < 1e-4 * away.abs().max()  # it begins and ends without a jerk
    assert (led[:, -1] - led[:, -2]).abs().max() < 1e-4 * away.abs().max()
