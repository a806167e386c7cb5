"""Motion at another speed: paths stay, velocities scale."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from model.motion.altered import motion_at_speed
from model.motion.rotations import geodesic_angle
from tests.helpers import smooth_motion_example


def turning_motion():
    """The pelvis turns by 170 degrees a second about a slanted axis, and moves along a line."""
    motion = smooth_motion_example(91)
    poses = motion.poses.copy()
    angle = np.radians(170.0) * np.arange(91) / 30
    angle = (angle + np.pi) % (2 * np.pi) - np.pi  # as files have it: at most half a turn
    poses[:, :3] = angle[:, None] * [0.6, 0.0, 0.8]
    trans = np.linspace([0, 1, 0], [3, 1, -3], 91)
    return replace(motion, poses=poses.astype(np.float32), trans=trans.astype(np.float32))


@pytest.mark.parametrize("speed", [0.9, 0.95, 1.07, 1.1])
def test_velocities_scale_with_speed(speed):
    motion = turning_motion()
    fast = motion_at_speed(motion, speed)
    rotmat = fast.local_rotations()[:, 0].double()
    steps = torch.rad2deg(geodesic_angle(rotmat[:-1], rotmat[1:])) * 30
    np.testing.assert_allclose(steps, 170.0 * speed, rtol=1e-3)
    np.testing.assert_allclose(
        np.diff(fast.trans, axis=0)[:, 0] * 30, speed * 3 * 30 / 90, rtol=1e-3
    )


@pytest.mark.parametrize(
    ("frames", "speed", "wanted"), [(91, 0.9, 101), (91, 1.1, 82), (1, 1.1, 1), (60, 1.0, 60)]
)
def test_the_path_is_walked_to_its_end(frames, speed, wanted):
    motion = smooth_motion_example(frames)
    fast = motion_at_speed(motion, speed)
    assert fast.num_frames == wanted
    np.testing.assert_allclose(fast.poses[0], motion.poses[0], atol=1e-5)
    last = (wanted - 1) * speed
    assert frames - 1 - speed < last <= frames - 1 + 1e-9
    k = round(10 * speed) if frames == 91 else 0  # frame 10 of the new shows frame 10 * speed
    np.testing.assert_allclose(fast.expressions[10 if k else 0], motion.expressions[k], atol=1e-5)


def test_speed_one_changes_nothing():
    motion = turning_motion()
    same = motion_at_speed(motion, 1.0)
    np.testing.assert_allclose(same.trans, motion.trans, atol=1e-6)
    angle = geodesic_angle(same.local_rotations().double(), motion.local_rotations().double())
    assert float(angle.max()) < 1e-5
