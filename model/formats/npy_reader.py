"""Bare arrays: rotations, or rows as TalkSHOW and DiffSHEG write them."""

from pathlib import Path

import numpy as np

from conventions.joints import HANDS, JOINT_INDEX, JOINT_NAMES, NUM_JOINTS
from conventions.rates import FPS
from model.formats.numbers import (
    ReadMotion,
    ReadOptions,
    at_30_fps,
    check_fps,
    joint_rotations,
    plain_motion,
)
from model.motion.motion import check_length
from model.storage.npz import MAX_ABS_VALUE, MAX_FILE_BYTES, MotionError, read_npy_file

TALKSHOW_COLUMNS = 265
_BODY, _JAW, _EYES, _HANDS = slice(9, 75), slice(0, 3), slice(3, 9), slice(75, 165)
"""Of TalkSHOW: jaw 3, eyes 6, global orientation 3 and body 63, hands 90, expression 100."""
DIFFSHEG_COLUMNS = 232
_DIFFSHEG_JOINTS = (
    *("spine1", "spine2", "spine3", "neck", "left_collar", "right_collar", "head"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    *(JOINT_NAMES[joint] for joint in HANDS),
    "jaw",
)
"""Of DiffSHEG on TalkSHOW's data, behind which come 100 of expression."""
_NOT_READ = {
    104: "is of Audio2Photoreal's form: 104 angles of a skeleton that is told only by the model "
    "that comes with its checkpoints, with no public list of which angle turns which joint, so "
    "they cannot be laid onto SMPL-X's joints",
    141: "is of the form of DiffSHEG on BEAT: 141 Euler angles less a mean and over a spread that "
    "lie with its data, not in the file; give the .bvh that it writes beside",
}
"""Widths of which no motion can be made, and why."""


def read_npy(path: Path, options: ReadOptions) -> ReadMotion:
    """A motion without translation, at the rate that the user says, or 30.

    Raises:
        MotionError: as `model.formats.read.read_any_motion`.
    """
    array, notes, name = _load(path), [], path.name
    fps = check_fps(float(FPS) if options.fps is None else options.fps, name)
    if options.fps is None:
        notes.append(f"{name} tells no frame rate; {FPS} was taken (say another with --fps).")
    expressions = None
    width = array.shape[-1]
    if array.ndim < 4 and width in _NOT_READ:
        raise MotionError(f"{name} {_NOT_READ[width]}.")
    if array.ndim == 3 and len(array) == 1 and width in (TALKSHOW_COLUMNS, DIFFSHEG_COLUMNS):
        array = array[0]
    if array.ndim == 2 and width == DIFFSHEG_COLUMNS:
        check_length(len(array), name)
        notes.append(
            f"{name} has {DIFFSHEG_COLUMNS} columns and was read as DiffSHEG's on TalkSHOW's data: "
            "upper body, hands, jaw, expression; pelvis, legs and eyes stay at rest."
        )
        array, expressions = _laid_by_joint(array)
    if array.ndim == 2 and width == TALKSHOW_COLUMNS:
        check_length(len(array), name)
        notes.append(
            f"{name} has {TALKSHOW_COLUMNS} columns and was read as TalkSHOW's: jaw, eyes, global"
            " orientation, body, hands, expression."
        )
        expressions = np.ascontiguousarray(array[:, 165:])
        order = [array[:, part] for part in (_BODY, _JAW, _EYES, _HANDS)]
        array = np.concatenate(order, axis=1)
    poses = joint_rotations(array, name, options.rotations, notes)
    if expressions is None:
        notes.append(f"{name} has no `expressions`; the face stays at rest.")
    notes.append(f"{name} has no translation; the body stays in its place.")
    motion = at_30_fps(plain_motion(poses, None, expressions), fps, name, notes)
    return ReadMotion(motion, tuple(notes))


def _laid_by_joint(array: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """DiffSHEG's columns as poses (T, 165), and its expressions (T, 100)."""
    poses = np.zeros((len(array), NUM_JOINTS, 3), array.dtype)
    count = len(_DIFFSHEG_JOINTS)
    joints = [JOINT_INDEX[name] for name in _DIFFSHEG_JOINTS]
    poses[:, joints] = array[:, : 3 * count].reshape(len(array), count, 3)
    return poses.reshape(len(array), -1), np.ascontiguousarray(array[:, 3 * count :])


def _load(path: Path) -> np.ndarray:
    if not path.is_file():
        raise MotionError(f"{path.name} does not exist; give a motion file.")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise MotionError(
            f"{path.name} has {path.stat().st_size / 2**20:.0f} MiB; at most"
            f" {MAX_FILE_BYTES // 2**20} MiB are read. Cut it first."
        )
    try:
        array = read_npy_file(path)
    except OSError as error:
        raise MotionError(f"{path.name} could not be read: {error.strerror or error}.") from error
    if array is None:
        raise MotionError(
            f"{path.name} is no plain array of numbers (pickled objects are never loaded)."
        )
    if array.dtype.kind not in "fiu" or array.ndim < 2:
        raise MotionError(f"{path.name} is no plain array of numbers with a row for each frame.")
    if not np.isfinite(array).all() or np.abs(array).max(initial=0.0) > MAX_ABS_VALUE:
        raise MotionError(
            f"{path.name} holds values that are not finite, or beyond {MAX_ABS_VALUE:g}."
        )
    return array.astype(np.float32)
