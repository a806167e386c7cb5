import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from conventions.joints import MIRROR_PERMUTATION, PARENTS
from model.motion import kinematics
from model.motion.kinematics import RestSkeleton, open_body_skeleton
from model.motion.rotations import matrix_from_axis_angle
from tests.helpers import mirror_skeleton, random_local_rotations

BATCHES = [(), (1,), (3, 2)]
EXACT = {"rtol": 0, "atol": 1e-12}


def double_skeleton() -> RestSkeleton:
    rest = open_body_skeleton()
    return RestSkeleton(rest.rest_joints.double(), rest.tip_offsets.double())


def slow_forward_kinematics(local_rot: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
    """One joint after the other, GlobalDiff eqs. 1 and 2."""
    global_rot = [local_rot[..., 0, :, :]]
    positions = [rest[0].expand(*local_rot.shape[:-3], 3)]
    for joint in range(1, 55):
        parent = PARENTS[joint]
        global_rot.append(global_rot[parent] @ local_rot[..., joint, :, :])
        bone = rest[joint] - rest[parent]
        positions.append(positions[parent] + global_rot[parent] @ bone)
    return torch.stack(global_rot, dim=-3), torch.stack(positions, dim=-2)


@pytest.mark.parametrize("batch", BATCHES)
def test_agrees_with_the_joint_by_joint_loop(batch):
    skeleton = double_skeleton()
    local_rot = random_local_rotations(batch)
    slow_rot, slow_positions = slow_forward_kinematics(local_rot, skeleton.rest_joints)
    global_rot, positions = kinematics.joint_positions_from_local(local_rot, skeleton)
    torch.testing.assert_close(global_rot, slow_rot, **EXACT)
    torch.testing.assert_close(positions, slow_positions, **EXACT)
    additive = kinematics.joint_positions_from_global(slow_rot, skeleton)
    torch.testing.assert_close(additive, slow_positions, **EXACT)


@pytest.mark.parametrize("batch", BATCHES)
def test_local_and_global_are_inverse(batch):
    rot = random_local_rotations(batch)
    back = kinematics.local_from_global(kinematics.global_from_local(rot))
    torch.testing.assert_close(back, rot, **EXACT)
    back = kinematics.global_from_local(kinematics.local_from_global(rot))
    torch.testing.assert_close(back, rot, **EXACT)


def test_identity_is_the_rest_pose():
    skeleton = open_body_skeleton()
    identity = torch.eye(3).expand(4, 55, 3, 3)
    transl = torch.tensor([0.1, 1.2, -0.3]).expand(4, 3)
    global_rot, positions = kinematics.joint_positions_from_local(identity, skeleton, transl)
    torch.testing.assert_close(global_rot, identity)
    expected = (skeleton.rest_joints + transl[0]).expand(4, 55, 3)
    torch.testing.assert_close(positions, expected, rtol=0, atol=1e-6)


def test_turning_the_root_turns_everything_about_the_pelvis():
    skeleton = double_skeleton()
    local_rot = random_local_rotations((5,))
    turn = matrix_from_axis_angle(torch.tensor([0.3, -1.0, 0.2], dtype=torch.float64))
    turned_local = local_rot.clone()
    turned_local[:, 0] = turn @ local_rot[:, 0]
    rot, positions = kinematics.joint_positions_from_local(local_rot, skeleton)
    turned_rot, turned_positions = kinematics.joint_positions_from_local(turned_local, skeleton)
    torch.testing.assert_close(turned_rot, turn @ rot, **EXACT)
    pelvis = skeleton.rest_joints[0]
    expected = (positions - pelvis) @ turn.T + pelvis
    torch.testing.assert_close(turned_positions, expected, **EXACT)


def test_a_raised_left_arm_is_the_left_arm_and_up():
    skeleton = open_body_skeleton()
    local_rot = torch.eye(3).repeat(55, 1, 1)
    local_rot[16] = matrix_from_axis_angle(torch.tensor([0.0, 0.0, math.pi / 2]))
    _, positions = kinematics.joint_positions_from_local(local_rot, skeleton)
    moved = (positions - skeleton.rest_joints).norm(dim=-1) > 1e-3
    assert moved.nonzero().flatten().tolist() == [18, 20, *range(25, 40)]
    assert positions[20, 1] > skeleton.rest_joints[20, 1] + 0.4


def test_bone_lengths_stay():
    skeleton = double_skeleton()
    # Any global rotations, also ones no anatomy allows, keep every bone's length.
    positions = kinematics.joint_positions_from_global(random_local_rotations((6,)), skeleton)
    bones = positions[:, 1:] - positions[:, list(PARENTS[1:])]
    expected = skeleton.bone_offsets().norm(dim=-1).expand(6, 54)
    torch.testing.assert_close(bones.norm(dim=-1), expected, **EXACT)


def test_fingertips_are_rigid_on_the_last_finger_joint():
    skeleton = double_skeleton()
    global_rot, positions = kinematics.joint_positions_from_local(
        random_local_rotations((4,)), skeleton
    )
    tips = kinematics.fingertip_positions(global_rot, positions, skeleton)
    assert tips.shape == (4, 10, 3)
    right_middle = positions[:, 45] + global_rot[:, 45] @ skeleton.tip_offsets[6]
    torch.testing.assert_close(tips[:, 6], right_middle, **EXACT)


def test_mirrored_motion_gives_exactly_the_mirrored_points():
    skeleton = double_skeleton()
    mirrored_skeleton = mirror_skeleton(skeleton)
    local_rot = random_local_rotations((5,))
    transl = torch.randn(5, 3, dtype=torch.float64)
    rot, positions = kinematics.joint_positions_from_local(local_rot, skeleton, transl)
    tips = kinematics.fingertip_positions(rot, positions, skeleton)
    mirrored_rot, mirrored_positions = kinematics.joint_positions_from_local(
        kinematics.mirror_local(local_rot), mirrored_skeleton, kinematics.mirror_transl(transl)
    )
    mirrored_tips = kinematics.fingertip_positions(
        mirrored_rot, mirrored_positions, mirrored_skeleton
    )
    image = torch.tensor([-1.0, 1, 1], dtype=torch.float64)
    expected = (positions * image)[:, list(MIRROR_PERMUTATION)]
    torch.testing.assert_close(mirrored_positions, expected, **EXACT)
    expected_tips = (tips * image)[:, [5, 6, 7, 8, 9, 0, 1, 2, 3, 4]]
    torch.testing.assert_close(mirrored_tips, expected_tips, **EXACT)


def test_mirror_of_axis_angle_flips_y_and_z():
    vector = torch.randn(55, 3, dtype=torch.float64)
    mirrored = kinematics.mirror_local(matrix_from_axis_angle(vector))
    flipped = (vector * torch.tensor([1.0, -1, -1]))[list(MIRROR_PERMUTATION)]
    torch.testing.assert_close(mirrored, matrix_from_axis_angle(flipped), **EXACT)
    torch.testing.assert_close(
        kinematics.mirror_local(mirrored), matrix_from_axis_angle(vector), **EXACT
    )


def test_gradients_reach_only_the_chain_of_a_tip():
    skeleton = open_body_skeleton()
    for to_positions in (
        lambda rot: kinematics.joint_positions_from_local(rot, skeleton)[1],
        lambda rot: kinematics.joint_positions_from_global(rot, skeleton),
    ):
        rot = random_local_rotations((), dtype=torch.float32).requires_grad_(True)
        to_positions(rot)[45].sum().backward()
        assert rot.grad is not None
        touched = (rot.grad.abs().sum((-1, -2)) > 0).nonzero().flatten().tolist()
        assert touched == [0, 3, 6, 9, 14, 17, 19, 21, 43, 44]


def test_training_still_works_after_a_first_call_in_inference_mode():
    kinematics._index.cache_clear()
    skeleton = replace(open_body_skeleton())  # its matrix is not made yet
    with torch.inference_mode():
        kinematics.joint_positions_from_local(torch.eye(3).repeat(55, 1, 1), skeleton)
    rot = torch.eye(3).repeat(55, 1, 1).requires_grad_(True)
    kinematics.joint_positions_from_local(rot, skeleton)[1].sum().backward()
    assert rot.grad is not None
