"""Motions that tremble more, are turned by noise, or go at another speed."""

import numpy as np
import pytest
import torch

from conventions.joints import FACE, JOINT_INDEX, NUM_JOINTS
from conventions.views import MAX_EXAGGERATED_RAD
from model.motion.kinematics import global_from_local
from model.motion.motion import Motion
from model.motion.rotations import geodesic_angle
from model.motion.tracks import kinematic_chain
from model.motion.transforms import (
    change_motion_speed,
    exaggerate_tremor,
    with_local_and_global_noise,
)
from tests.helpers import smooth_motion_example
from tests.model.motion.made import about, along, posed

TIME_S = np.arange(150) / 30
SLOW = 0.6 * np.sin(2 * np.pi * 0.5 * TIME_S)
FAST = 0.01 * np.sin(2 * np.pi * 10 * TIME_S)
INSIDE = slice(15, -15)
"""Away from the ends, where the filter sees half of what it needs."""


def turning(angles: np.ndarray, joint: str = "left_elbow") -> Motion:
    return posed(len(angles), **{joint: about(1, angles)})


def angles_of(motion: Motion, joint: str = "left_elbow") -> np.ndarray:
    return motion.poses[:, 3 * JOINT_INDEX[joint] + 1]


@pytest.mark.parametrize("factor", [5, 20])
def test_tremble_is_multiplied_and_the_gesture_stays(factor):
    shown = exaggerate_tremor(turning(SLOW + FAST), factor)
    error = np.abs(angles_of(shown) - SLOW - factor * FAST)[INSIDE]
    assert error.max() < 0.04 * factor * 0.01, "the filter has a slope: 10 Hz passes almost whole"
    others = np.delete(shown.poses, 3 * JOINT_INDEX["left_elbow"] + 1, axis=1)
    assert np.abs(others).max() < 1e-5
    calm = turning(SLOW)
    assert np.abs(exaggerate_tremor(calm, factor).poses - calm.poses)[INSIDE].max() < 2e-3


def test_the_body_s_own_place_trembles_too_and_no_joint_turns_over():
    shown = exaggerate_tremor(posed(150, trans=along(1, 0.1 * FAST)), 5)
    assert np.ptp(shown.trans[INSIDE, 1]) == pytest.approx(0.5 * np.ptp(FAST[INSIDE]), rel=0.04)
    wild = angles_of(exaggerate_tremor(turning(30 * FAST), 20))
    assert 0.9 * MAX_EXAGGERATED_RAD < np.abs(wild[INSIDE]).max() < 1.1 * MAX_EXAGGERATED_RAD


def test_speech_gaze_short_clips_and_a_factor_of_one_stay_as_they_are():
    for joint in ("jaw", "left_eye"):
        motion = turning(FAST, joint)
        assert np.array_equal(exaggerate_tremor(motion, 20).poses, motion.poses)
    assert exaggerate_tremor(motion, 1) is motion
    for num_frames in (1, 3, 4, 7):
        motion = turning(FAST[:num_frames])
        shown = exaggerate_tremor(motion, 5)
        assert shown.num_frames == num_frames and (shown is motion) == (num_frames < 4)


NOISE_RAD = 0.05
MOTION = smooth_motion_example(60)
OTHERS = [joint for joint in range(NUM_JOINTS) if joint not in FACE]


def errors_rad(motion: Motion, is_global: bool) -> torch.Tensor:
    """Angle of each joint, frame by frame, from where the motion has it."""
    local = [each.local_rotations().double() for each in (motion, MOTION)]
    return geodesic_angle(*([global_from_local(each) for each in local] if is_global else local))


def spread(errors: torch.Tensor) -> float:
    return errors.square().mean().sqrt().item()


def test_noise_is_the_same_turns_on_local_and_on_global_rotations():
    """Local noise adds up along the chain and global noise does not, at a price: an angle between
    neighbours holds the noise of both."""
    on_local, on_global = with_local_and_global_noise(MOTION, NOISE_RAD)
    local_error = errors_rad(on_local, is_global=False)[:, OTHERS]
    global_error = errors_rad(on_global, is_global=True)[:, OTHERS]
    torch.testing.assert_close(local_error, global_error, atol=1e-3, rtol=0)
    assert spread(local_error) == pytest.approx(NOISE_RAD * np.sqrt(3), rel=0.05)
    finger, depth = JOINT_INDEX["right_middle3"], len(kinematic_chain("right_middle"))
    sums = spread(errors_rad(on_local, is_global=True)[:, finger])
    assert sums == pytest.approx(NOISE_RAD * np.sqrt(3 * depth), rel=0.2)
    between = spread(errors_rad(on_global, is_global=False)[:, finger])
    assert between == pytest.approx(NOISE_RAD * np.sqrt(6), rel=0.2)
    for motion in (on_local, on_global):
        assert errors_rad(motion, is_global=False)[:, list(FACE)].max() < 1e-3
        assert np.array_equal(motion.trans, MOTION.trans)
        assert np.array_equal(motion.expressions, MOTION.expressions)
    again, other = (
        with_local_and_global_noise(MOTION, NOISE_RAD, seed)[0].poses for seed in (0, 1)
    )
    assert np.array_equal(again, on_local.poses) and not np.array_equal(other, on_local.poses)


@pytest.mark.parametrize("speed", [0.9, 1.0, 1.07])
def test_velocities_scale_with_speed(speed):
    """The pelvis turns by 170 degrees a second about a slanted axis, and moves along a line."""
    angle = np.radians(170.0) * np.arange(91) / 30
    angle = (angle + np.pi) % (2 * np.pi) - np.pi  # as files have it: at most half a turn
    pelvis = angle[:, None] * [0.6, 0.0, 0.8]
    fast = change_motion_speed(
        posed(91, np.linspace([0, 1, 0], [3, 1, -3], 91), pelvis=pelvis), speed
    )
    rotmat = fast.local_rotations()[:, 0].double()
    steps = torch.rad2deg(geodesic_angle(rotmat[:-1], rotmat[1:])) * 30
    np.testing.assert_allclose(steps, 170.0 * speed, rtol=1e-3)
    np.testing.assert_allclose(np.diff(fast.trans, axis=0)[:, 0], speed * 3 / 90, rtol=1e-3)


@pytest.mark.parametrize(
    ("frames", "speed", "wanted"), [(91, 0.9, 101), (91, 1.1, 82), (1, 1.1, 1), (60, 1.0, 60)]
)
def test_the_path_is_walked_to_its_end(frames, speed, wanted):
    motion = smooth_motion_example(frames)
    fast = change_motion_speed(motion, speed)
    assert fast.num_frames == wanted
    assert frames - 1 - speed < (wanted - 1) * speed <= frames - 1 + 1e-9
    new = min(10, wanted - 1)  # frame 10 of the new shows frame 10 * speed
    for name in ("poses", "expressions"):
        shown, old = getattr(fast, name)[new], getattr(motion, name)[round(new * speed)]
        np.testing.assert_allclose(shown, old, atol=1e-5)


def test_what_lies_between_two_frames_is_between_them():
    half = change_motion_speed(MOTION, 0.5)
    for name in ("trans", "expressions"):
        rows = getattr(MOTION, name)
        np.testing.assert_allclose(getattr(half, name)[1::2], (rows[:-1] + rows[1:]) / 2, atol=1e-6)
