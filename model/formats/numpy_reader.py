"""Numpy files: archives of BEAT2, AMASS or SMPL-X, and bare arrays."""

import zipfile
from pathlib import Path

import numpy as np
from jaxtyping import Float32

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
from model.motion.motion import (
    NUM_BETAS,
    NUM_EXPRESSIONS,
    Motion,
    check_length,
    read_basis,
)
from model.storage.npz import (
    MAX_ABS_VALUE,
    MAX_FILE_BYTES,
    Header,
    MotionError,
    listed,
    opened_archive,
    read_headers,
    read_npy_file,
    read_numbers,
)

TRANSLATIONS = ("trans", "transl")
RATE_KEYS = ("mocap_frame_rate", "mocap_framerate", "fps")
"""BEAT2's name for it, AMASS's, and a usual one."""
CENTIMETRES_FROM = 20.0
"""Metres from the origin where nobody is filmed, but where centimetres begin."""
PARTS = {
    "global_orient": 1,
    "body_pose": 21,
    "jaw_pose": 1,
    "leye_pose": 1,
    "reye_pose": 1,
    "left_hand_pose": 15,
    "right_hand_pose": 15,
}
"""SMPL-X's own parameters, in the order of its joints, and how many joints each has."""
NEEDED_PARTS = ("global_orient", "body_pose")


def read_npz(path: Path, options: ReadOptions) -> ReadMotion:
    """Read a BEAT2 npz, or one that differs from it in what can be made up for.

    Raises:
        MotionError: for all else; one sentence that names the file.
    """
    with opened_archive(path) as archive:
        return _Reader(archive, path.name, options).read()


class _Reader:
    """One file and what has been said of it so far."""

    def __init__(self, archive: zipfile.ZipFile, name: str, options: ReadOptions) -> None:
        self._archive = archive
        self._name = name
        self._options = options
        self._headers: dict[str, Header] = read_headers(archive, name)
        self._notes: list[str] = []

    def read(self) -> ReadMotion:
        self._check_keys()
        fps = self._frame_rate()
        poses, trans, expressions = self._cut_alike(
            self._poses(), self._trans(), self._expressions()
        )
        if expressions is None:
            expressions = np.zeros((len(poses), NUM_EXPRESSIONS), np.float32)
        motion = Motion(
            poses=poses,
            trans=trans,
            expressions=expressions,
            expression_basis=read_basis(self._archive, self._headers, self._name),
            betas=self._betas(),
        )
        motion = at_30_fps(motion, fps, self._name, self._notes)
        return ReadMotion(motion, tuple(self._notes))

    def _check_keys(self) -> None:
        has_parts = all(part in self._headers for part in NEEDED_PARTS)
        missing = [] if has_parts or "poses" in self._headers else ["poses"]
        if not any(key in self._headers for key in TRANSLATIONS):
            missing.append("trans")
        if self._options.fps is None and not any(key in self._headers for key in RATE_KEYS):
            missing.append(RATE_KEYS[0])
        if missing:
            raise MotionError(
                f"{self._name} lacks {listed(missing)}; it holds "
                f"{listed(sorted(self._headers)) or 'nothing'}, but a motion file needs "
                f"{listed(('poses', 'trans', RATE_KEYS[0]))} (the rate can be given: --fps)."
            )

    def _frame_rate(self) -> float:
        if self._options.fps is not None:
            self._note(f"was read at {self._options.fps:g} frames per second, as you say")
            return check_fps(self._options.fps, self._name)
        key = next(key for key in RATE_KEYS if key in self._headers)
        array = self._array(key)
        if array.size != 1:
            raise MotionError(f"{self._name}: `{key}` must be one number.")
        return check_fps(float(array.reshape(-1)[0]), self._name)

    def _poses(self) -> Float32[np.ndarray, "T 165"]:
        if "poses" not in self._headers:
            return self._poses_of_parts()
        shape, _ = self._headers["poses"]
        self._check_frames("poses", shape)
        return joint_rotations(
            self._array("poses"), self._name, self._options.rotations, self._notes
        )

    def _poses_of_parts(self) -> Float32[np.ndarray, "T 165"]:
        """SMPL-X's parameters side by side; what is not there stays at rest."""
        found: dict[str, np.ndarray] = {}
        for part, joints in PARTS.items():
            if part not in self._headers:
                continue
            shape, _ = self._headers[part]
            self._check_frames(part, shape)
            array = self._array(part)
            array = array[0] if array.ndim > 2 and shape[0] == 1 else array
            array = array.reshape(len(array), -1)
            if array.shape[1] != 3 * joints:
                raise MotionError(
                    f"{self._name}: `{part}` must have {3 * joints} numbers a frame (axis-angle,"
                    f" no principal components); it has the shape {shape}."
                )
            found[part] = array
        frames = min(len(array) for array in found.values())
        lacking = [part for part in PARTS if part not in found]
        rest = f"; {listed(lacking)} stay at rest" if lacking else ""
        self._note(f"has its joints under {listed(list(found))}, laid side by side{rest}")
        columns = [
            found[part][:frames] if part in found else np.zeros((frames, 3 * joints), np.float32)
            for part, joints in PARTS.items()
        ]
        poses = np.concatenate(columns, axis=1).astype(np.float32)
        assert poses.shape[1] == 3 * NUM_JOINTS
        return joint_rotations(poses, self._name, "axis-angle", self._notes)

    def _check_frames(self, key: str, shape: tuple[int, ...]) -> None:
        if len(shape) == 0:
            raise MotionError(f"{self._name}: `{key}` must have a row for each frame; it has ().")
        if 0 in shape[:2]:
            raise MotionError(f"{self._name} has no frames in `{key}`; at least 1 is needed.")
        has_batch = len(shape) > 2 and shape[0] == 1
        check_length(shape[int(has_batch)], self._name)

    def _trans(self) -> Float32[np.ndarray, "T 3"]:
        key = next(key for key in TRANSLATIONS if key in self._headers)
        trans = self._rows(key, 3)
        distance = float(np.median(np.abs(trans).max(axis=1)))
        if distance <= CENTIMETRES_FROM:
            return trans
        self._note(
            f"stands {distance:.0f} from the origin, so its translation was taken as centimetres"
            " and divided by 100"
        )
        return trans / 100

    def _expressions(self) -> Float32[np.ndarray, "T 100"] | None:
        if "expressions" not in self._headers:
            self._note("has no `expressions`; the face stays at rest")
            return None
        return self._rows("expressions", NUM_EXPRESSIONS)

    def _betas(self) -> Float32[np.ndarray, " 300"]:
        betas = np.zeros(NUM_BETAS, np.float32)
        if "betas" in self._headers:
            given = self._array("betas")
            if given.ndim != 1 or len(given) > NUM_BETAS:
                raise MotionError(
                    f"{self._name}: `betas` must be up to {NUM_BETAS} numbers; it has the shape "
                    f"{given.shape}."
                )
            betas[: len(given)] = given
        return betas

    def _cut_alike(
        self,
        poses: Float32[np.ndarray, "P 165"],
        trans: Float32[np.ndarray, "Q 3"],
        expressions: Float32[np.ndarray, "R 100"] | None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        arrays = {"poses": poses, "trans": trans, "expressions": expressions}
        lengths = {key: len(array) for key, array in arrays.items() if array is not None}
        shortest = min(lengths.values())
        if shortest < max(lengths.values()):
            found = ", ".join(f"{length} of `{key}`" for key, length in lengths.items())
            self._note(f"has frames of different number ({found}); the first {shortest} were used")
        cut = None if expressions is None else expressions[:shortest]
        return poses[:shortest], trans[:shortest], cut

    def _rows(self, key: str, columns: int) -> Float32[np.ndarray, "T columns"]:
        """An array with one row for each frame."""
        shape, _ = self._headers[key]
        has_batch = len(shape) == 3 and shape[0] == 1
        shape = shape[1:] if has_batch else shape
        if len(shape) != 2 or shape[1] != columns:
            raise MotionError(
                f"{self._name}: `{key}` must have the shape (frames, {columns}); it has {shape}."
            )
        if shape[0] == 0:
            raise MotionError(f"{self._name} has no frames in `{key}`; at least 1 is needed.")
        check_length(shape[0], self._name)
        return self._array(key).reshape(shape)

    def _array(self, key: str) -> Float32[np.ndarray, "*shape"]:
        _, dtype = self._headers[key]
        if dtype.kind not in "fiu":
            raise MotionError(f"{self._name}: `{key}` must hold numbers; it holds {dtype}.")
        return read_numbers(self._archive, key, self._name)

    def _note(self, what: str) -> None:
        self._notes.append(f"{self._name} {what}.")


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
