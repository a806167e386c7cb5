"""Forward kinematics against a loop over joints, mirrors, and the open body's skeleton."""

import math
from dataclasses import replace

import torch
from torch import Tensor

from conventions.joints import FINGERTIP_JOINTS, JOINT_INDEX, MIRROR_PERMUTATION, PARENTS
from model.motion import kinematics
from model.motion.kinematics import (
    RestSkeleton,
    fingertip_positions,
    forward_kinematics,
    joint_positions_from_global,
    mirror_local,
    open_body_skeleton,
)
from model.motion.rotations import matrix_from_axis_angle
from tests.helpers import mirror_skeleton, random_local_rotations

BATCHES = [(), (1,), (3, 2)]


def assert_exact(found: Tensor, expected: Tensor) -> None:
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)


def double_skeleton() -> RestSkeleton:
    rest = open_body_skeleton()
    return RestSkeleton(rest.rest_joints.double(), rest.tip_offsets.double())


def slow_forward_kinematics(R_parent_joint: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
    """One joint after the other, GlobalDiff eqs. 1 and 2."""
    R_world_joint = [R_parent_joint[..., 0, :, :]]
    positions = [rest[0].expand(*R_parent_joint.shape[:-3], 3)]
    for joint in range(1, 55):
        parent = PARENTS[joint]
        R_world_joint.append(R_world_joint[parent] @ R_parent_joint[..., joint, :, :])
        bone = rest[joint] - rest[parent]
        positions.append(positions[parent] + R_world_joint[parent] @ bone)
    return torch.stack(R_world_joint, dim=-3), torch.stack(positions, dim=-2)


def test_agrees_with_the_joint_by_joint_loop_and_local_and_global_are_inverse():
    skeleton = double_skeleton()
    for batch in BATCHES:
        R_parent_joint = random_local_rotations(batch)
        slow_rot, slow_positions = slow_forward_kinematics(R_parent_joint, skeleton.rest_joints)
        R_world_joint, positions = forward_kinematics(R_parent_joint, skeleton)
        assert_exact(R_world_joint, slow_rot)
        assert_exact(positions, slow_positions)
        assert_exact(joint_positions_from_global(slow_rot, skeleton), slow_positions)
        assert_exact(kinematics.local_from_global(slow_rot), R_parent_joint)


def test_a_raised_left_arm_is_the_left_arm_and_up():
    skeleton = open_body_skeleton()
    R_parent_joint = torch.eye(3).repeat(55, 1, 1)
    R_parent_joint[16] = matrix_from_axis_angle(torch.tensor([0.0, 0.0, math.pi / 2]))
    _, positions = forward_kinematics(R_parent_joint, skeleton)
    moved = (positions - skeleton.rest_joints).norm(dim=-1) > 1e-3
    assert moved.nonzero().flatten().tolist() == [18, 20, *range(25, 40)]
    assert positions[20, 1] > skeleton.rest_joints[20, 1] + 0.4


def test_fingertips_are_rigid_on_the_last_finger_joint():
    skeleton = double_skeleton()
    R_world_joint, positions = forward_kinematics(random_local_rotations((4,)), skeleton)
    tips = fingertip_positions(R_world_joint, positions, skeleton)
    for k, joint in enumerate(FINGERTIP_JOINTS):
        offset = R_world_joint[:, joint] @ skeleton.tip_offsets[k]
        assert_exact(tips[:, k], positions[:, joint] + offset)


def test_gradients_reach_only_the_chain_of_a_tip_also_after_inference_mode():
    kinematics._index.cache_clear()
    skeleton = replace(open_body_skeleton())  # its matrix is not made yet
    with torch.inference_mode():
        forward_kinematics(torch.eye(3).repeat(55, 1, 1), skeleton)
    for to_positions in (
        lambda rot: forward_kinematics(rot, skeleton)[1],
        lambda rot: joint_positions_from_global(rot, skeleton),
    ):
        rot = random_local_rotations((), dtype=torch.float32).requires_grad_(True)
        to_positions(rot)[45].sum().backward()
        assert rot.grad is not None
        touched = (rot.grad.abs().sum((-1, -2)) > 0).nonzero().flatten().tolist()
        assert touched == [0, 3, 6, 9, 14, 17, 19, 21, 43, 44]


def test_mirrored_motion_gives_exactly_the_mirrored_points():
    """On a body that is its own mirror image and on one that is not; two mirrors show the same."""
    one, other = double_skeleton(), mirror_skeleton(double_skeleton())
    symmetric = RestSkeleton(
        (one.rest_joints + other.rest_joints) / 2, (one.tip_offsets + other.tip_offsets) / 2
    )
    poses = torch.randn(5, 165, dtype=torch.float64)
    transl = torch.randn(5, 3, dtype=torch.float64)
    image = torch.tensor([-1.0, 1, 1], dtype=torch.float64)
    R_parent_joint = matrix_from_axis_angle(poses.unflatten(-1, (55, 3)))
    mirrored = mirror_local(R_parent_joint)
    for skeleton, of_mirrored in ((one, other), (symmetric, symmetric)):
        rot, positions = forward_kinematics(R_parent_joint, skeleton, transl)
        seen_rot, seen = forward_kinematics(mirrored, of_mirrored, transl * image)
        expected = (positions * image)[:, list(MIRROR_PERMUTATION)]
        assert_exact(seen, expected)
        tips = fingertip_positions(rot, positions, skeleton)
        seen_tips = fingertip_positions(seen_rot, seen, of_mirrored)
        assert_exact(seen_tips, (tips * image)[:, [5, 6, 7, 8, 9, 0, 1, 2, 3, 4]])
    assert_exact(mirror_local(mirrored), R_parent_joint)


def test_the_open_body_is_a_standing_person_who_faces_z_and_is_symmetric():
    rest = open_body_skeleton()
    joints = rest.rest_joints
    height = joints[JOINT_INDEX["head"], 1] - joints[JOINT_INDEX["left_foot"], 1]
    assert 1.2 < height < 1.8
    assert joints[JOINT_INDEX["left_wrist"], 0] > 0.5 > -0.5 > joints[JOINT_INDEX["right_wrist"], 0]
    assert joints[JOINT_INDEX["left_foot"], 2] > joints[JOINT_INDEX["left_ankle"], 2]
    partner = joints[list(MIRROR_PERMUTATION)] * torch.tensor([-1.0, 1, 1])
    torch.testing.assert_close(partner, joints, rtol=0, atol=1e-4)
    for tip, joint in enumerate(FINGERTIP_JOINTS):
        assert (joints[joint] - joints[PARENTS[joint]]) @ rest.tip_offsets[tip] > 0
        assert 0.01 < rest.tip_offsets[tip].norm() < 0.05
