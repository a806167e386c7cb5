import torch
from torch import Tensor

from conventions.joints import JOINT_INDEX, PARENTS
from model.motion.kinematics import (
    global_from_local,
    joint_positions_from_global,
    open_body_skeleton,
)
from model.motion.rotations import matrix_from_axis_angle
from model.systems.globaldiff import constraints
from model.training.losses import position_loss
from tests.helpers import random_local_rotations

ANCHORS = constraints.octahedron_anchors()
TIP = JOINT_INDEX["right_middle3"]


def rotations(seed: int = 0) -> Tensor:
    """Global rotations (2, 3, 55, 3, 3)."""
    return global_from_local(random_local_rotations((2, 3), seed, torch.float32))


def positions_of(global_rot: Tensor) -> Tensor:
    return joint_positions_from_global(global_rot, open_body_skeleton())


def turned(rotmat: Tensor, axis_angle: list[float], *, joint: int) -> Tensor:
    """With one joint turned further about an axis of its own frame, in sample 1 only."""
    result = rotmat.clone()
    result[1, :, joint] = rotmat[1, :, joint] @ matrix_from_axis_angle(torch.tensor(axis_angle))
    return result


def test_twist_of_a_leaf_joint_is_seen_by_anchors_and_not_by_positions():
    target = rotations()
    twisted = turned(target, [0.5, 0, 0], joint=TIP)
    assert (position_loss(positions_of(twisted), positions_of(target)) == 0).all()
    loss = constraints.joint_structure_loss(twisted, target, ANCHORS)
    # Chord of 0.5 rad for the four anchors off the axis, one joint of 55.
    chord = 2 * 0.05 * torch.sin(torch.tensor(0.25))
    torch.testing.assert_close(loss, torch.stack([torch.tensor(0.0), 4 / 6 * chord**2 / 55]))


def test_anchor_gradient_of_a_twist_is_about_its_axis():
    target = rotations()
    angle = torch.tensor(0.3, requires_grad=True)
    twist = matrix_from_axis_angle(torch.stack([angle, angle * 0, angle * 0]))
    rotmat = target.clone()
    rotmat[:, :, TIP] = target[:, :, TIP] @ twist
    constraints.joint_structure_loss(rotmat, target, ANCHORS).sum().backward()
    assert angle.grad is not None and angle.grad > 1e-6


def test_the_six_anchors_span_space():
    assert torch.linalg.matrix_rank(ANCHORS) == 3
    assert ANCHORS.shape == (6, 3)
    torch.testing.assert_close(ANCHORS.norm(dim=-1), torch.full((6,), 0.05))


def test_collinear_anchors_would_miss_a_twist_about_their_line():
    line = 0.05 * torch.tensor([[1.0, 0, 0], [-1, 0, 0]])
    target = rotations()
    twisted = turned(target, [0.5, 0, 0], joint=TIP)
    loss = constraints.joint_structure_loss(twisted, target, line)
    torch.testing.assert_close(loss, torch.zeros(2), atol=1e-12, rtol=0)


def test_skeleton_loss_equals_the_matrices_of_equation_13():
    a, b = positions_of(rotations(0)), positions_of(rotations(1))
    directions = [constraints.bone_directions(p)[0] for p in (a, b)]
    matrices = [each @ each.mT for each in directions]
    squared = (matrices[0] - matrices[1]).square()
    expected = squared.sum((-1, -2)).mean(-1) / (54 * 53)  # the diagonal is 1 in both
    torch.testing.assert_close(constraints.skeleton_structure_loss(a, b), expected)
    assert (constraints.skeleton_structure_loss(a, a) == 0).all()


def test_skeleton_loss_is_blind_to_a_global_turn_and_sees_one_bent_joint():
    target = rotations()
    turn = matrix_from_axis_angle(torch.tensor([0.4, -1.0, 0.7]))
    whole = constraints.skeleton_structure_loss(positions_of(turn @ target), positions_of(target))
    torch.testing.assert_close(whole, torch.zeros(2), atol=1e-6, rtol=0)
    elbow = JOINT_INDEX["left_elbow"]
    bent = turned(target, [0, 0.5, 0], joint=elbow)
    part = constraints.skeleton_structure_loss(positions_of(bent), positions_of(target))
    assert part[0] == 0 and part[1] > 1e-3


def test_degenerate_bones_count_in_neither_sum_nor_number():
    a, b = positions_of(rotations(0)), positions_of(rotations(1))
    foot = JOINT_INDEX["left_foot"]
    a[:, :, foot] = a[:, :, PARENTS[foot]]  # a bone without length, in the prediction only
    directions = [constraints.bone_directions(p)[0] for p in (a, b)]
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


def _position_gradients(noise: float) -> tuple[Tensor, Tensor]:
    """Length of the position loss's gradient to a small turn of each joint: local, global FK.

    Both see the same wrong pose: local rotations with independent errors of ``noise`` radians.
    """
    skeleton = open_body_skeleton()
    local = torch.eye(3).expand(200, 1, 55, 3, 3)
    generator = torch.Generator().manual_seed(0)
    error = noise * torch.randn(200, 1, 55, 3, generator=generator)
    wrong = matrix_from_axis_angle(error)
    target = joint_positions_from_global(local, skeleton)

    def lengths(rotmat: Tensor, to_global) -> Tensor:
        turn = torch.zeros(200, 1, 55, 3, requires_grad=True)
        moved = to_global(rotmat @ matrix_from_axis_angle(turn))
        positions = joint_positions_from_global(moved, skeleton)
        position_loss(positions, target).sum().backward()
        assert turn.grad is not None
        return turn.grad.norm(dim=-1).mean((0, 1))

    return lengths(wrong, global_from_local), lengths(global_from_local(wrong), lambda r: r)


def test_position_gradients_are_more_even_over_joints_with_global_rotations():
    """The paper's stability claim: local FK piles the whole body's error onto the root's gradient.

    Joints whose gradient is zero in both (the leaves) are left out.
    """
    local, other = _position_gradients(0.1)
    inner = (local > 1e-9) & (other > 1e-9)
    assert int(inner.sum()) == len({parent for parent in PARENTS if parent >= 0})
    spread = [float(g[inner].max() / g[inner].median()) for g in (local, other)]
    assert spread[0] > 3 * spread[1]  # 283 and 60 at 0.1 rad
    chain = [JOINT_INDEX[n] for n in ("pelvis", "spine2", "right_shoulder", "right_wrist")]
    assert (local[chain].diff() < 0).all()  # falls with depth
