"""Faults to plant in a motion, each with the kind that must be found and what must be beside it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX, JOINT_NAMES, LEFT_HAND, MIRROR_PERMUTATION, RIGHT_HAND
from model.generation.base import Windowing
from model.metrics.face import blendshape_columns
from model.motion.motion import Motion
from model.motion.transforms import change_motion_speed

FPS = 30
Fault = Callable[[Motion], Motion]


def on_joints(change: Callable[[np.ndarray], None]) -> Fault:
    """What is done to a copy of all axis-angles (T, 55, 3)."""

    def plant(motion: Motion) -> Motion:
        joints = motion.poses.copy().reshape(-1, 55, 3)
        change(joints)
        return replace(motion, poses=joints.reshape(-1, 165))

    return plant


def moved_by(way: Callable[[np.ndarray], Any], axis: int) -> Fault:
    """Along an axis, by so many metres at each frame."""

    def plant(motion: Motion) -> Motion:
        away = np.zeros_like(motion.trans)
        away[:, axis] = way(np.arange(len(away)))
        return replace(motion, trans=motion.trans + away)

    return plant


def frames(which: Callable[[np.ndarray], np.ndarray]) -> Fault:
    """Some of the frames in place of all."""
    return lambda motion: motion.part(which(np.arange(motion.num_frames)))


def bump(first: int, count: int, height: float) -> Callable[[np.ndarray], np.ndarray]:
    bell = height * np.hanning(count)
    return lambda frame: np.pad(bell, (first, len(frame) - first - count))


def low_passed(hertz: float) -> Fault:
    low = butter(4, hertz, fs=FPS, output="sos")

    def plant(motion: Motion) -> Motion:
        poses, trans = (sosfiltfilt(low, rows, axis=0) for rows in (motion.poses, motion.trans))
        return replace(motion, poses=poses.astype(np.float32), trans=trans.astype(np.float32))

    return plant


@on_joints
def smaller(joints: np.ndarray) -> None:
    joints[:] = joints.mean(axis=0) + 0.4 * (joints - joints.mean(axis=0))


@on_joints
def popping(joints: np.ndarray) -> None:
    joints[[200, 280, 350], JOINT_INDEX["right_elbow"], 0] += 1.0


def snapping(joint: str) -> Fault:
    """Elsewhere until the third frame, by 2.3 rad."""

    def change(joints: np.ndarray) -> None:
        joints[:3, JOINT_INDEX[joint], 1] += 2.3

    return on_joints(change)


def noisy(*names: str) -> Fault:
    def change(joints: np.ndarray) -> None:
        noise = np.random.default_rng(0).standard_normal((len(joints), len(names), 3))
        joints[:, [JOINT_INDEX[name] for name in names]] += 0.02 * noise

    return on_joints(change)


@on_joints
def shaking(joints: np.ndarray) -> None:
    """7 Hz of the arms, faint enough to be no noise of single frames."""
    wave = 0.02 * np.sin(2 * np.pi * 7 * np.arange(len(joints)) / FPS)
    for joint in ("left_shoulder", "right_shoulder", "left_elbow", "right_elbow"):
        joints[:, JOINT_INDEX[joint]] += wave[:, None]


@on_joints
def jumping(joints: np.ndarray) -> None:
    joints[:, :, 0] += 0.04 * ((np.arange(len(joints)) + 47) // 52 % 2)[:, None]


def z_up(motion: Motion) -> Motion:
    """Turned by 90 degrees about x: y becomes z, as files have it whose up is z."""
    turn = Rotation.from_euler("x", 90, degrees=True)

    @on_joints
    def turned(joints: np.ndarray) -> None:
        joints[:, 0] = (turn * Rotation.from_rotvec(joints[:, 0])).as_rotvec()

    return replace(turned(motion), trans=turn.apply(motion.trans).astype(np.float32))


@on_joints
def stiff_jaw(joints: np.ndarray) -> None:
    joints[:, JOINT_INDEX["jaw"]] = joints[0, JOINT_INDEX["jaw"]]


def still_jaw(motion: Motion) -> Motion:
    expressions = motion.expressions.copy()
    if motion.expression_basis == "arkit52":
        expressions[:, blendshape_columns("jawOpen")] = 0.0
    return replace(stiff_jaw(motion), expressions=expressions)


def still_face(motion: Motion) -> Motion:
    return replace(stiff_jaw(motion), expressions=np.zeros_like(motion.expressions))


def other_body(motion: Motion) -> Motion:
    """Another motion with the same face."""
    backwards = motion.part(np.arange(motion.num_frames)[::-1])
    return replace(backwards, expressions=motion.expressions)


def mirrored(motion: Motion) -> Motion:
    """An axis is an axial vector: sides change places, and y and z their sign."""
    axes = motion.poses.reshape(-1, 55, 3)[:, list(MIRROR_PERMUTATION)] * (1, -1, -1)
    return replace(motion, poses=axes.reshape(motion.poses.shape).astype(np.float32))


@on_joints
def swapped(joints: np.ndarray) -> None:
    joints[:] = joints[:, list(MIRROR_PERMUTATION)]


def stretched(motion: Motion) -> Motion:
    return change_motion_speed(change_motion_speed(motion, 2.0), 0.5)


def frozen(frame: np.ndarray) -> np.ndarray:
    return np.where((frame >= 300) & (frame < 360), 300, frame)


def doubled(frame: np.ndarray) -> np.ndarray:
    return frame - ((frame >= 50) & ((frame - 50) % 40 == 0))


@on_joints
def finger_backwards(joints: np.ndarray) -> None:
    joints[:, JOINT_INDEX["right_index2"]] = (0, 0, -1.0)


def frozen_hand(hand: tuple[int, ...]) -> Fault:
    def change(joints: np.ndarray) -> None:
        joints[:, list(hand)] = joints[0, list(hand)]

    return on_joints(change)


@on_joints
def hand_in_body(joints: np.ndarray) -> None:
    """The right forearm bent straight through the belly for a second."""
    second = slice(350, 380)
    for name in ("right_collar", "right_wrist", "spine1", "spine2", "spine3"):
        joints[second, JOINT_INDEX[name]] = 0.0
    joints[second, JOINT_INDEX["right_shoulder"]] = (0, 0, 1.25)  # the arm hangs
    joints[second, JOINT_INDEX["right_elbow"]] = (0, 0, 2.0)  # sideways, into the trunk


@dataclass(frozen=True)
class Planted:
    name: str
    kind: str
    plant: Fault
    beside: str = ""
    """``reference`` or ``speech`` where it can only be found beside that."""
    says: str = ""
    """What the sentence holds, and the numbers behind it, in the example clip."""
    numbers: Mapping[str, Any] = field(default_factory=dict)
    also: frozenset[str] = frozenset()
    """What else is true of the example clip then."""
    windows: Windowing | None = None
    first: str = ""
    """What is told first, where a consequence shows more than the fault itself."""


def planted(name: str, kind: str, plant: Fault, also: str = "", **more: Any) -> Planted:
    return Planted(name, kind, plant, also=frozenset(also.split()), **more)


LATE = frames(lambda frame: np.maximum(frame - 15, 0))
EVERY_52 = {"period_frames": 52, "frame_in_period": 5}
PLANTED = (
    planted("1 Hz low-pass", "jerk", low_passed(1.0), says="as if low-pass filtered"),
    planted("2 Hz low-pass", "high_frequency", low_passed(2.0), says="as if low-pass filtered"),
    planted("amplitude x .4", "amplitude", smaller, says="Little variation of posture"),
    planted("amplitude x .4", "speed", smaller, "copied_face amplitude jerk",
            beside="reference", numbers={"ratio": 0.4}, first="copied_face"),
    planted("freeze of 2 s", "frozen", frames(frozen), "snap", says="0:10.0",
            numbers={"times": 1, "longest_s": 2.0, "total_s": 2.0}),
    planted("one pose", "still", frames(np.zeros_like)),
    planted("one-frame pops of 1 rad", "pops", popping, "jerk",
            numbers={"frames_popping": 3, "joint": "right_elbow"}),
    planted("a snap of one frame", "snap", snapping("head"), says="132° (head, at 0:00.1",
            numbers={"snaps": 1, "joint": "head", "snap_deg": 132.0}),
    planted("bobbing by 11 cm", "floating",
            moved_by(lambda frame: 0.055 * np.sin(2 * np.pi * frame / 105), 1),
            says="Both feet are above the floor by up to 11 cm", numbers={"height_m": 0.11}),
    planted("bobbing by 30 cm", "floating",
            moved_by(lambda frame: 0.15 * np.sin(2 * np.pi * frame / 105), 1),
            says="Both feet are above the floor by up to 30 cm", numbers={"height_m": 0.3}),
    planted("noise on a joint", "rotation_noise", noisy("right_wrist"), "jerk",
            says="Rotation noise, in the right wrist (1.1°)",
            numbers={"attributed_joint": "right_wrist"}),
    planted("noise on a joint that is not followed", "rotation_noise", noisy("left_middle1"),
            numbers={"attributed_joint": None}),
    planted("noise everywhere", "rotation_noise", noisy(*JOINT_NAMES),
            "jerk foot_slide speed",
            says="in 55 of the 55 joints", first="jerk"),
    planted("7 Hz in the arms", "jerk", shaking, "rotation_noise period", says="Jittery hands"),
    planted("jumps every 52 frames", "period", jumping, "jerk",
            says="every 52 frames (1.73 s)", numbers=EVERY_52),
    planted("jumps every 52 frames, windows of 60", "period", jumping, "jerk",
            windows=Windowing(68, 8), says="every 52 frames (1.73 s)", numbers=EVERY_52),
    planted("jumps every 52 frames, windows known", "seams", jumping, "jerk",
            windows=Windowing(60, 8), says="every 52 frames (1.73 s)",
            numbers={"window_advance_frames": 52, "frame_in_period": 5}),
    planted("lift of 20 cm", "lifted", moved_by(lambda _: 0.2, 1), "copied_face",
            beside="reference", says="20 cm above", numbers={"height_m": 0.2}),
    planted("lift of 20 cm for 2 s", "floating", moved_by(bump(300, 60, 0.2), 1),
            numbers={"height_m": 0.2}),
    planted("foot through the floor", "through_floor", moved_by(bump(300, 30, -0.12), 1),
            says="up to 12 cm below the floor",
            numbers={"depth_m": 0.12}),
    planted("2 s through the floor", "through_floor", moved_by(bump(300, 60, -0.12), 1),
            numbers={"depth_m": 0.12}),
    planted("sliding", "foot_slide", moved_by(lambda frame: 0.01 * frame, 0),
            says="33 cm/s", numbers={"foot_slide_m_s": 0.325}),
    planted("z up", "lying", z_up, numbers={"spine_tilt_deg": 85.6}),
    planted("trans that never changes", "still_translation",
            lambda motion: replace(motion, trans=np.zeros_like(motion.trans)),
            says="The translation is all zero", numbers={"trans_m": [0.0, 0.0, 0.0]}),
    planted("still jaw and face", "still_face", still_face, says="neither jaw nor expression"),
    planted("still jaw", "still_face", still_jaw, says="The jaw never moves, though"),
    planted("copied expressions", "copied_face", other_body, beside="reference",
            says="100 %", numbers={"copied_share": 1.0}),
    planted("identical to the reference", "identical", lambda motion: motion, beside="reference"),
    planted("mirrored", "swapped_sides", mirrored, "copied_face", beside="reference",
            says="as a mirror image", numbers={"way": "mirrored", "error_swapped_deg": 0.0}),
    planted("swapped left and right", "swapped_sides", swapped, "finger_range",
            says="both elbows bend backwards", numbers={"way": "swapped"}),
    planted("frames doubled", "copied_frames", frames(doubled), "period high_frequency",
            says="10 frames (", numbers={"copies": 10}),
    planted("frames dropped", "skipped_frames",
            frames(lambda frame: np.delete(frame, np.arange(50, 400, 25))), "period"),
    planted("15 fps stretched to 30", "stretched_rate", stretched, "jerk"),
    planted("15 fps, every frame twice", "stretched_rate", frames(lambda frame: frame // 2 * 2),
            "rotation_noise frozen_hand jerk", numbers={"change_ratio": 0.0}),
    planted("half a second late", "time_shift", LATE, "frozen copied_face", beside="reference",
            says="0.50 s later", numbers={"lag_frames": 15}),
    planted("half a second late", "time_shift", LATE, "frozen", beside="speech",
            says="moves 0.50 s late", numbers={"lag_frames": 15}),
    planted("a finger bent backwards", "finger_range", finger_backwards,
            says="right index joint 2 (100 %)", numbers={"joints": {"right_index2": 1.0}}),
    planted("a frozen right hand", "frozen_hand", frozen_hand(RIGHT_HAND), says="the right hand"),
    planted("noise on the other elbow", "rotation_noise", noisy("left_elbow"), "jerk",
            says="Rotation noise, in the left elbow (1.0°)", first="jerk"),
    planted("20 cm too low", "lifted", moved_by(lambda _: -0.2, 1), "copied_face",
            beside="reference", says="20 cm below", numbers={"height_m": -0.2}),
    planted("half a second early", "time_shift",
            frames(lambda frame: np.minimum(frame + 15, frame[-1])), "frozen copied_face",
            beside="reference", says="0.50 s earlier", numbers={"lag_frames": -15}),
    planted("sliding forwards", "foot_slide", moved_by(lambda frame: 0.01 * frame, 2),
            says="33 cm/s"),
    planted("a frozen hand", "frozen_hand", frozen_hand(LEFT_HAND),
            says="the left hand are frozen in 100 %",
            numbers={"side": "left", "still_share": 1.0}),
    planted("hand in the body", "hand_in_body", hand_in_body, "jerk snap",
            says="The right hand penetrates", numbers={"side": "right"}, first="snap"),
)  # fmt: skip
