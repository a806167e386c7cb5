"""Figures of a clip's motion, the same for real and for procedural clips."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks, welch
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.motion import load_motion
from tools.corpus.people.rig import Rig, forward_kinematics, matrices

LEFT_WRIST, RIGHT_WRIST = JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]
LONG_FINGERS = [
    JOINT_INDEX[f"{side}_{finger}{k}"]
    for side in ("left", "right")
    for finger in ("index", "middle", "pinky", "ring")
    for k in (1, 2, 3)
]
RIGHT_MIDDLE_TIP_JOINT = JOINT_INDEX["right_middle3"]
STROKE_M_S, STROKE_PROMINENCE_M_S = 0.25, 0.15
PLANTED_WITHIN_M = 0.012  # of the ankle's lowest height


@dataclass(frozen=True)
class PosedClip:
    """A clip on the corpus's own skeleton, whatever body it was recorded on."""

    local_rot: Float[np.ndarray, "T 55 3 3"]
    global_rot: Float[np.ndarray, "T 55 3 3"]
    positions: Float[np.ndarray, "T 55 3"]
    right_tip: Float[np.ndarray, "T 3"]


def read_posed_clip(path: Path, rig: Rig) -> PosedClip:
    """Read a motion file in BEAT2's layout.

    Raises:
        MotionError: if it cannot be used.
    """
    motion = load_motion(path)
    local_rot = matrices(motion.poses.astype(np.float64).reshape(-1, 55, 3))
    global_rot, positions = forward_kinematics(rig, local_rot, motion.trans.astype(np.float64))
    offset = rig.tip_offsets[rig.tip_joints.index(RIGHT_MIDDLE_TIP_JOINT)]
    tip = positions[:, RIGHT_MIDDLE_TIP_JOINT] + global_rot[:, RIGHT_MIDDLE_TIP_JOINT] @ offset
    return PosedClip(local_rot, global_rot, positions, tip)


def clip_statistics(clip: PosedClip) -> dict[str, float]:
    """Named figures of one clip; the names hold the units."""
    left, right = (derivative(clip.positions[:, wrist], 1) for wrist in (LEFT_WRIST, RIGHT_WRIST))
    shoulders = turning_deg_s(
        clip.local_rot[:, [JOINT_INDEX["left_shoulder"], JOINT_INDEX["right_shoulder"]]]
    )
    wrists = turning_deg_s(clip.local_rot[:, [LEFT_WRIST, RIGHT_WRIST]])
    wrist = in_chest(clip, RIGHT_WRIST)
    return {
        "right wrist speed, m/s": float(right.mean()),
        "right wrist jerk, m/s^3": float(derivative(clip.positions[:, RIGHT_WRIST], 3).mean()),
        "right fingertip jerk, m/s^3": float(derivative(clip.right_tip, 3).mean()),
        "fingertip velocity power above 5 Hz, share": _power_above(clip.right_tip, 5.0),
        "strokes per second, right": _strokes_per_s(right),
        "finger joint speed, deg/s": float(turning_deg_s(clip.local_rot[:, LONG_FINGERS]).mean()),
        "wrist joint speed, deg/s": float(wrists.mean()),
        "shoulder speed, 99th percentile, deg/s": float(np.percentile(shoulders, 99)),
        "head speed, deg/s": float(turning_deg_s(clip.global_rot[:, [JOINT_INDEX["head"]]]).mean()),
        "chest speed, deg/s": float(
            turning_deg_s(clip.global_rot[:, [JOINT_INDEX["spine3"]]]).mean()
        ),
        "pelvis speed, cm/s": float(100 * derivative(clip.positions[:, 0], 1).mean()),
        "knee bend, median, deg": float(np.median(_bend_deg(clip, ("left_knee", "right_knee")))),
        "elbow bend, median, deg": float(np.median(_bend_deg(clip, ("left_elbow", "right_elbow")))),
        "right wrist height over chest, median, m": float(np.median(wrist[:, 1])),
        "left-right speed correlation": float(np.corrcoef(_smooth(left), _smooth(right))[0, 1]),
        "planted ankle slip, cm/s": _slip_cm_s(clip),
    }


def derivative(positions: Float[np.ndarray, "T D"], order: int) -> Float[np.ndarray, " S"]:
    """Length of the time derivative of this order, by finite differences."""
    return np.linalg.norm(np.diff(positions, order, axis=0), axis=-1) * FPS**order


def turning_deg_s(rotmat: Float[np.ndarray, "T J 3 3"]) -> Float[np.ndarray, "S J"]:
    """Angular speed of each joint between frames."""
    step = np.swapaxes(rotmat[:-1], -1, -2) @ rotmat[1:]
    angle = Rotation.from_matrix(step.reshape(-1, 3, 3)).magnitude()
    return np.degrees(angle).reshape(step.shape[:2]) * FPS


def _bend_deg(clip: PosedClip, names: tuple[str, ...]) -> Float[np.ndarray, " N"]:
    """Rotation from the rest pose, all joints and frames in one row."""
    rotmat = clip.local_rot[:, [JOINT_INDEX[name] for name in names]].reshape(-1, 3, 3)
    return np.degrees(Rotation.from_matrix(rotmat).magnitude())


def in_chest(clip: PosedClip, joint: int) -> Float[np.ndarray, "T 3"]:
    """A joint's place as seen from the chest: metres to its left, up and forward."""
    chest = JOINT_INDEX["spine3"]
    offset = clip.positions[:, joint] - clip.positions[:, chest]
    return np.einsum("tba,tb->ta", clip.global_rot[:, chest], offset)


def _smooth(speed: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    return gaussian_filter1d(speed, 1.0)


def _power_above(positions: Float[np.ndarray, "T 3"], hz: float) -> float:
    velocity = np.diff(positions, axis=0) * FPS
    frequency, power = welch(velocity, FPS, nperseg=min(128, len(velocity)), axis=0)
    return float(power[frequency > hz].sum() / power.sum())


def _strokes_per_s(speed: Float[np.ndarray, " T"]) -> float:
    peaks, _ = find_peaks(_smooth(speed), height=STROKE_M_S, prominence=STROKE_PROMINENCE_M_S)
    return len(peaks) / (len(speed) / FPS)


def _slip_cm_s(clip: PosedClip) -> float:
    slips = []
    for ankle in (JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]):
        place = clip.positions[:, ankle]
        planted = place[:-1, 1] < place[:, 1].min() + PLANTED_WITHIN_M
        slips.append(derivative(place * [1.0, 0.0, 1.0], 1)[planted].mean())
    return float(100 * np.mean(slips))
