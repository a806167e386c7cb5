import torch

from conventions.joints import FINGERTIP_JOINTS, JOINT_INDEX, MIRROR_PERMUTATION, PARENTS
from model.motion.kinematics import open_body_skeleton


def test_open_body_is_a_standing_person_facing_z():
    rest = open_body_skeleton()
    joints = rest.rest_joints
    height = joints[JOINT_INDEX["head"], 1] - joints[JOINT_INDEX["left_foot"], 1]
    assert 1.2 < height < 1.8
    assert joints[JOINT_INDEX["left_wrist"], 0] > 0.5 > -0.5 > joints[JOINT_INDEX["right_wrist"], 0]
    assert joints[JOINT_INDEX["left_foot"], 2] > joints[JOINT_INDEX["left_ankle"], 2]
    partner = joints[list(MIRROR_PERMUTATION)] * torch.tensor([-1.0, 1, 1])
    torch.testing.assert_close(partner, joints, rtol=0, atol=1e-4)


def test_tips_lengthen_their_fingers():
    rest = open_body_skeleton()
    for tip, joint in enumerate(FINGERTIP_JOINTS):
        bone = rest.rest_joints[joint] - rest.rest_joints[PARENTS[joint]]
        assert bone @ rest.tip_offsets[tip] > 0
        assert 0.01 < rest.tip_offsets[tip].norm() < 0.05
