"""Faults to plant in a motion, each with the kind that must be found and what must be beside it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.signal import butter, sosfiltfilt

from conventions.joints import JOINT_INDEX, LEFT_HAND, MIRROR_PERMUTATION
from conventions.rates import SAMPLE_RATE
from model.measures.lag import heard_of
from model.motion.altered import motion_at_speed
from model.motion.kinematics import mirror_poses
from model.motion.motion import Motion

FPS = 30
Fault = Callable[[Motion], Motion]


def _joints(motion: Motion) -> np.ndarray:
    return motion.poses.copy().reshape(-1, 55, 3)


def _with(motion: Motion, joints: np.ndarray) -> Motion:
    return replace(motion, poses=joints.reshape(-1, 165).astype(np.float32))


def low_passed(motion: Motion) -> Motion:
    low = butter(4, 2.0, fs=FPS, output="sos")
    return replace(
        motion,
        poses=sosfiltfilt(low, motion.poses, axis=0).astype(np.float32),
        trans=sosfiltfilt(low, motion.trans, axis=0).astype(np.float32),
    )


def scaled(factor: float) -> Fault:
    def plant(motion: Motion) -> Motion:
        mean = motion.poses.mean(axis=0)
        return replace(motion, poses=(mean + factor * (motion.poses - mean)).astype(np.float32))

    return plant


def frozen(motion: Motion) -> Motion:
    frames = np.arange(motion.num_frames)
    frames[300:360] = 300
    return motion.part(frames)


def still(motion: Motion) -> Motion:
    return motion.part(np.zeros(motion.num_frames, int))


def popping(motion: Motion) -> Motion:
    joints = _joints(motion)
    joints[[200, 350, 500], JOINT_INDEX["right_elbow"], 0] += 1.0
    return _with(motion, joints)


def noisy(motion: Motion) -> Motion:
    joints = _joints(motion)
    joints[:, JOINT_INDEX["right_wrist"]] += 0.02 * np.random.default_rng(0).standard_normal(
        (len(joints), 3)
    )
    return _with(motion, joints)


def shaking(motion: Motion) -> Motion:
    """7 Hz of the arms, faint enough to be no noise of single frames."""
    joints = _joints(motion)
    wave = 0.02 * np.sin(2 * np.pi * 7 * np.arange(len(joints)) / FPS)
    for joint in ("left_shoulder", "right_shoulder", "left_elbow", "right_elbow"):
        joints[:, JOINT_INDEX[joint]] += wave[:, None]
    return _with(motion, joints)


def jumping(motion: Motion) -> Motion:
    joints = _joints(motion)
    joints[:, :, 0] += 0.04 * ((np.arange(len(joints)) + 47) // 52 % 2)[:, None]
    return _with(motion, joints)


def lifted(motion: Motion) -> Motion:
    return replace(motion, trans=motion.trans + np.array([0, 0.2, 0], np.float32))


def lifted_a_while(motion: Motion) -> Motion:
    up = np.zeros_like(motion.trans)
    up[300:360, 1] = 0.2 * np.hanning(60)
    return replace(motion, trans=motion.trans + up)


def foot_through_floor(motion: Motion) -> Motion:
    down = np.zeros_like(motion.trans)
    down[300:330, 1] = -0.12 * np.hanning(30)
    return replace(motion, trans=motion.trans + down)


def sliding(motion: Motion) -> Motion:
    away = np.zeros_like(motion.trans)
    away[:, 0] = 0.3 * np.arange(len(away)) / FPS
    return replace(motion, trans=motion.trans + away)


def z_up(motion: Motion) -> Motion:
    """Turned by 90 degrees about x: y becomes z, as files have it whose up is z."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_euler("x", 90, degrees=True)
    joints = _joints(motion)
    joints[:, 0] = (turn * Rotation.from_rotvec(joints[:, 0])).as_rotvec()
    turned = _with(motion, joints)
    return replace(turned, trans=turn.apply(motion.trans).astype(np.float32))


def nailed_down(motion: Motion) -> Motion:
    return replace(motion, trans=np.zeros_like(motion.trans))


def still_face(motion: Motion) -> Motion:
    joints = _joints(motion)
    joints[:, JOINT_INDEX["jaw"]] = joints[0, JOINT_INDEX["jaw"]]
    return replace(_with(motion, joints), expressions=np.zeros_like(motion.expressions))


def still_jaw(motion: Motion) -> Motion:
    joints = _joints(motion)
    joints[:, JOINT_INDEX["jaw"]] = 0.0
    expressions = motion.expressions.copy()
    if motion.expression_basis == "arkit52":
        from model.measures.face import unit_columns

        expressions[:, unit_columns("jawOpen")] = 0.0
    return replace(_with(motion, joints), expressions=expressions)


def other_body(motion: Motion) -> Motion:
    """Another motion with the same face."""
    backwards = motion.part(np.arange(motion.num_frames)[::-1])
    return replace(backwards, expressions=motion.expressions)


def mirrored(motion: Motion) -> Motion:
    return replace(motion, poses=mirror_poses(torch.from_numpy(motion.poses.copy())).numpy())


def swapped(motion: Motion) -> Motion:
    return _with(motion, _joints(motion)[:, list(MIRROR_PERMUTATION)])


def doubled_frames(motion: Motion) -> Motion:
    frames = np.arange(motion.num_frames)
    frames[50::40] -= 1
    return motion.part(frames)


def dropped_frames(motion: Motion) -> Motion:
    return motion.part(np.delete(np.arange(motion.num_frames), np.arange(50, 800, 25)))


def stretched(motion: Motion) -> Motion:
    return motion_at_speed(motion_at_speed(motion, 2.0), 0.5)


def repeated_from_15(motion: Motion) -> Motion:
    return motion.part(np.arange(motion.num_frames) // 2 * 2)


def delayed(motion: Motion) -> Motion:
    return motion.part(np.maximum(np.arange(motion.num_frames) - 15, 0))


def finger_backwards(motion: Motion) -> Motion:
    joints = _joints(motion)
    joints[:, JOINT_INDEX["right_index2"]] = (0, 0, -1.0)
    return _with(motion, joints)


def frozen_hand(motion: Motion) -> Motion:
    joints = _joints(motion)
    joints[:, list(LEFT_HAND)] = joints[0, list(LEFT_HAND)]
    return _with(motion, joints)


def hand_in_body(motion: Motion) -> Motion:
    """The right forearm bent straight through the belly for a second."""
    joints = _joints(motion)
    frames = slice(400, 430)
    joints[frames, JOINT_INDEX["right_collar"]] = 0.0
    joints[frames, JOINT_INDEX["right_shoulder"]] = (0, 0, 1.25)  # the arm hangs
    joints[frames, JOINT_INDEX["right_elbow"]] = (0, 0, 2.0)  # sideways, into the trunk
    joints[frames, JOINT_INDEX["right_wrist"]] = 0.0
    for spine in ("spine1", "spine2", "spine3"):
        joints[frames, JOINT_INDEX[spine]] = 0.0
    return _with(motion, joints)


@dataclass(frozen=True)
class Planted:
    name: str
    kind: str
    plant: Fault
    beside: str = ""
    """``reference`` or ``speech`` where it can only be found beside that."""


PLANTED = (
    Planted("2 Hz low-pass", "jerk", low_passed),
    Planted("2 Hz low-pass", "high_frequency", low_passed),
    Planted("amplitude x .4", "amplitude", scaled(0.4)),
    Planted("amplitude x .4", "speed", scaled(0.4), "reference"),
    Planted("freeze of 2 s", "frozen", frozen),
    Planted("one pose", "still", still),
    Planted("one-frame pops of 1 rad", "pops", popping),
    Planted("noise on a joint", "joint_noise", noisy),
    Planted("7 Hz in the arms", "high_frequency", shaking),
    Planted("jumps every 52 frames", "period", jumping),
    Planted("jumps every 52 frames, windows known", "seams", jumping),
    Planted("lift of 20 cm", "lifted", lifted, "reference"),
    Planted("lift of 20 cm for 2 s", "floating", lifted_a_while),
    Planted("foot through the floor", "through_floor", foot_through_floor),
    Planted("sliding", "foot_slide", sliding),
    Planted("z up", "lying", z_up),
    Planted("trans that never changes", "still_translation", nailed_down),
    Planted("still jaw and face", "still_face", still_face),
    Planted("still jaw", "still_face", still_jaw),
    Planted("copied expressions", "copied_face", other_body, "reference"),
    Planted("identical to the reference", "identical", lambda motion: motion, "reference"),
    Planted("mirrored", "swapped_sides", mirrored, "reference"),
    Planted("swapped left and right", "swapped_sides", swapped),
    Planted("frames doubled", "copied_frames", doubled_frames),
    Planted("frames dropped", "skipped_frames", dropped_frames),
    Planted("15 fps stretched to 30", "stretched_rate", stretched),
    Planted("15 fps, every frame twice", "stretched_rate", repeated_from_15),
    Planted("half a second late", "time_shift", delayed, "reference"),
    Planted("half a second late", "time_shift", delayed, "speech"),
    Planted("a finger bent backwards", "finger_range", finger_backwards),
    Planted("a frozen hand", "frozen_hand", frozen_hand),
    Planted("hand in the body", "hand_in_body", hand_in_body),
)


def loudness(waveform: np.ndarray) -> np.ndarray:
    assert len(waveform) > SAMPLE_RATE
    return heard_of(waveform)
