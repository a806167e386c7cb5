"""Motion in a mirror: exact on a symmetric body, and what is nearly right fails."""

import numpy as np
import pytest
import torch
from torch import Tensor

from conventions.joints import MIRROR_PERMUTATION
from model.motion.kinematics import (
    RestSkeleton,
    joint_positions_from_local,
    mirror_face_units,
    mirror_poses,
    mirror_transl,
    open_body_skeleton,
)
from model.motion.rotations import matrix_from_axis_angle
from tests.helpers import mirror_skeleton
from tools.corpus.people.rig import open_body_rig


def symmetric_skeleton() -> RestSkeleton:
    one, other = open_body_skeleton(), mirror_skeleton(open_body_skeleton())
    return RestSkeleton(
        (one.rest_joints.double() + other.rest_joints) / 2,
        (one.tip_offsets.double() + other.tip_offsets) / 2,
    )


def positions(poses: Tensor, transl: Tensor, skeleton: RestSkeleton) -> Tensor:
    rotmat = matrix_from_axis_angle(poses.unflatten(-1, (55, 3)))
    return joint_positions_from_local(rotmat, skeleton, transl)[1]


@pytest.fixture
def motion() -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    poses = torch.randn(4, 7, 165, generator=generator, dtype=torch.float64)
    return poses, torch.randn(4, 7, 3, generator=generator, dtype=torch.float64)


def reflected(places: Tensor) -> Tensor:
    return mirror_transl(places)[..., list(MIRROR_PERMUTATION), :]


def test_positions_are_reflected_and_joints_swapped(motion):
    poses, transl = motion
    skeleton = symmetric_skeleton()
    seen = positions(mirror_poses(poses), mirror_transl(transl), skeleton)
    expected = reflected(positions(poses, transl, skeleton))
    torch.testing.assert_close(seen, expected, rtol=0, atol=1e-12)
    assert (expected - positions(poses, transl, skeleton)).norm(dim=-1).mean() > 0.1


def test_the_open_body_is_symmetric_enough(motion):
    poses, transl = motion
    seen = positions(mirror_poses(poses), mirror_transl(transl), open_body_skeleton())
    expected = reflected(positions(poses, transl, open_body_skeleton()))
    assert (seen - expected).norm(dim=-1).max() < 0.002


def swap_only(poses: Tensor) -> Tensor:
    return poses.unflatten(-1, (55, 3))[..., list(MIRROR_PERMUTATION), :].flatten(-2)


def flip_x(poses: Tensor) -> Tensor:
    return (swap_only(poses).unflatten(-1, (55, 3)) * poses.new_tensor([-1, 1, 1])).flatten(-2)


def flip_without_swap(poses: Tensor) -> Tensor:
    return (poses.unflatten(-1, (55, 3)) * poses.new_tensor([1, -1, -1])).flatten(-2)


def central_joints_left_as_they_are(poses: Tensor) -> Tensor:
    central = [j for j, partner in enumerate(MIRROR_PERMUTATION) if j == partner]
    mirrored = mirror_poses(poses).unflatten(-1, (55, 3)).clone()
    mirrored[..., central, :] = poses.unflatten(-1, (55, 3))[..., central, :]
    return mirrored.flatten(-2)


@pytest.mark.parametrize(
    "wrong", [swap_only, flip_x, flip_without_swap, central_joints_left_as_they_are]
)
def test_plausible_mistakes_would_be_seen(wrong, motion):
    poses, transl = motion
    skeleton = symmetric_skeleton()
    seen = positions(wrong(poses), mirror_transl(transl), skeleton)
    expected = reflected(positions(poses, transl, skeleton))
    assert (seen - expected).norm(dim=-1).mean() > 0.05


def test_two_mirrors_show_the_same(motion):
    poses, transl = motion
    assert torch.equal(mirror_poses(mirror_poses(poses)), poses)
    assert torch.equal(mirror_transl(mirror_transl(transl)), transl)
    units = torch.rand(3, 52)
    assert torch.equal(mirror_face_units(mirror_face_units(units)), units)


def test_face_units_change_sides():
    names = open_body_rig().expression_names
    pairs = {
        "eyeBlinkLeft": "eyeBlinkRight",
        "eyeLookInLeft": "eyeLookInRight",  # towards the nose stays towards the nose
        "eyeLookOutRight": "eyeLookOutLeft",
        "jawLeft": "jawRight",
        "mouthRight": "mouthLeft",
        "mouthSmileLeft": "mouthSmileRight",
        "jawOpen": "jawOpen",
        "browInnerUp": "browInnerUp",
    }
    for name, partner in pairs.items():
        units = torch.from_numpy(np.eye(52)[names.index(name)])
        assert names[int(mirror_face_units(units).argmax())] == partner
    fixed = torch.arange(52.0)
    assert int((mirror_face_units(fixed) == fixed).sum()) == sum(
        not name.endswith(("Left", "Right")) for name in names
    )
