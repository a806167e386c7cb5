from dataclasses import replace

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.motion.altered import MAX_TURN_RAD, exaggerate
from tests.app.fakes import made_motion

NUM_FRAMES = 150
TIME_S = np.arange(NUM_FRAMES) / 30
SLOW = 0.6 * np.sin(2 * np.pi * 0.5 * TIME_S)
FAST = 0.01 * np.sin(2 * np.pi * 10 * TIME_S)
INSIDE = slice(15, -15)
"""Away from the ends, where the filter sees half of what it needs."""


def turning(joint: str, angles: np.ndarray):
    motion = made_motion(len(angles), tremble=0.0)
    poses = motion.poses.copy()
    poses[:, 3 * JOINT_INDEX[joint] + 1] = angles
    return replace(motion, poses=poses)


def angles_of(motion, joint: str) -> np.ndarray:
    return motion.poses[:, 3 * JOINT_INDEX[joint] + 1]


@pytest.mark.parametrize("factor", [5, 20])
def test_tremble_is_multiplied_and_the_gesture_stays(factor):
    shown = exaggerate(turning("left_elbow", SLOW + FAST), factor)
    fast = angles_of(shown, "left_elbow") - SLOW
    error = np.abs(fast - factor * FAST)[INSIDE]
    assert error.max() < 0.04 * factor * 0.01, "the filter has a slope: 10 Hz passes almost whole"
    others = np.delete(shown.poses, 3 * JOINT_INDEX["left_elbow"] + 1, axis=1)
    assert np.abs(others).max() < 1e-5


def test_what_is_slower_than_the_cut_off_is_left_alone():
    calm = turning("left_elbow", SLOW)
    assert np.abs(exaggerate(calm, 20).poses - calm.poses)[INSIDE].max() < 2e-3


def test_the_body_s_own_place_trembles_too():
    motion = made_motion(NUM_FRAMES, tremble=0.0)
    trans = np.zeros((NUM_FRAMES, 3), np.float32)
    trans[:, 1] = 0.1 * FAST
    shown = exaggerate(replace(motion, trans=trans), 5)
    assert np.ptp(shown.trans[INSIDE, 1]) == pytest.approx(5 * np.ptp(trans[INSIDE, 1]), rel=0.04)


def test_no_joint_turns_over():
    wild = turning("right_wrist", 30 * FAST)
    shown = angles_of(exaggerate(wild, 20), "right_wrist")
    assert 0.9 * MAX_TURN_RAD < np.abs(shown[INSIDE]).max() < 1.1 * MAX_TURN_RAD


def test_speech_and_gaze_stay_as_they_are():
    for joint in ("jaw", "left_eye"):
        motion = turning(joint, FAST)
        assert np.array_equal(exaggerate(motion, 20).poses, motion.poses)


@pytest.mark.parametrize("num_frames", [1, 3, 4, 7])
def test_short_clips(num_frames):
    motion = turning("left_elbow", FAST[:num_frames])
    shown = exaggerate(motion, 5)
    assert shown.num_frames == num_frames
    assert (shown is motion) == (num_frames < 4)


def test_a_factor_of_one_is_the_motion_itself():
    motion = turning("left_elbow", FAST)
    assert exaggerate(motion, 1) is motion
