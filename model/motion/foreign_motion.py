"""Motion files as other people's tools write them, read as far as that can be done honestly.

`model.motion.motion.load_motion` takes BEAT2's format and nothing else. Here what is missing or
different
is made up for, and every such change is told in a sentence.
"""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from model.motion.motion import (
    NUM_BETAS,
    NUM_EXPRESSIONS,
    Motion,
    check_length,
    read_basis,
)
from model.motion.retiming import motion_at_speed
from model.motion.skeleton import FACE, NUM_JOINTS
from model.motion.timing import FPS
from model.storage.npz import (
    Header,
    MotionError,
    listed,
    opened_archive,
    read_headers,
    read_numbers,
)

SMPLX_COLUMNS = 3 * NUM_JOINTS
SMPLH_COLUMNS = SMPLX_COLUMNS - 3 * len(FACE)
REQUIRED = ("poses", "trans")
RATE_KEYS = ("mocap_frame_rate", "mocap_framerate")
"""BEAT2's name for it, and AMASS's."""
LOWEST_FPS, HIGHEST_FPS = 29.0, 240.0
"""Fewer frames would have to be invented, and the invented ones have no jitter."""
CENTIMETRES_FROM = 20.0
"""Metres from the origin where nobody is filmed, but where centimetres begin."""
MOST_RADIANS = 4 * np.pi
"""A turn of more than two full circles is a number of degrees."""


@dataclass(frozen=True)
class ReadMotion:
    """A motion, and what was done to the file's numbers to get it."""

    motion: Motion
    notes: tuple[str, ...]
    """Sentences for a person, each naming the file."""


def read_any_motion(path: str | Path) -> ReadMotion:
    """Read a BEAT2 npz, or one that differs from it in what can be made up for.

    Taken: 52-joint SMPL-H poses (jaw and eyes stay at rest), missing or short ``betas``, missing
    ``expressions``, arrays of different length (cut to the shortest), 29 to 240 frames per second
    (resampled to 30), centimetres.

    Raises:
        MotionError: for all else; one sentence that names the file.
    """
    path = Path(path)
    with opened_archive(path) as archive:
        return _Reader(archive, path.name).read()


class _Reader:
    """One file and what has been said of it so far."""

    def __init__(self, archive: zipfile.ZipFile, name: str) -> None:
        self._archive = archive
        self._name = name
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
        if fps != FPS:
            motion = motion_at_speed(motion, fps / FPS)
            self._note(f"has {fps:g} frames per second and was resampled to {FPS}")
        return ReadMotion(motion, tuple(self._notes))

    def _check_keys(self) -> None:
        missing = [key for key in REQUIRED if key not in self._headers]
        if not any(key in self._headers for key in RATE_KEYS):
            missing.append(RATE_KEYS[0])
        if missing:
            raise MotionError(
                f"{self._name} lacks {listed(missing)}; it holds "
                f"{listed(sorted(self._headers)) or 'nothing'}, but a motion file needs "
                f"{listed((*REQUIRED, RATE_KEYS[0]))}."
            )

    def _frame_rate(self) -> float:
        key = next(key for key in RATE_KEYS if key in self._headers)
        array = self._array(key)
        if array.size != 1:
            raise MotionError(f"{self._name}: `{key}` must be one number.")
        fps = float(array.reshape(-1)[0])
        if not LOWEST_FPS <= fps <= HIGHEST_FPS:
            raise MotionError(
                f"{self._name} has {fps:g} frames per second; {LOWEST_FPS:g} to {HIGHEST_FPS:g} "
                f"can be resampled to {FPS}."
            )
        return fps

    def _poses(self) -> Float32[np.ndarray, "T 165"]:
        poses = self._rows("poses", SMPLX_COLUMNS, SMPLH_COLUMNS)
        turn = float(np.linalg.norm(poses.reshape(len(poses), -1, 3), axis=-1).max())
        if turn > MOST_RADIANS:
            raise MotionError(
                f"{self._name} turns a joint by {turn:.0f}; `poses` must be in radians, not "
                "degrees."
            )
        if poses.shape[1] == SMPLX_COLUMNS:
            return poses
        self._note("has the 52 joints of SMPL-H; jaw and eyes, which it lacks, stay at rest")
        before_face = 3 * min(FACE)
        return np.insert(poses, [before_face] * 3 * len(FACE), 0.0, axis=1)

    def _trans(self) -> Float32[np.ndarray, "T 3"]:
        trans = self._rows("trans", 3)
        if trans.shape[1] != 3:
            raise MotionError(
                f"{self._name}: `trans` must have 3 columns; it has {trans.shape[1]}."
            )
        distance = float(np.median(np.abs(trans).max(axis=1)))
        if distance <= CENTIMETRES_FROM:
            return trans
        self._note(
            f"stands {distance:.0f} from the origin, so its `trans` was taken as centimetres and "
            "divided by 100"
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

    def _rows(self, key: str, *columns: int) -> Float32[np.ndarray, "T columns"]:
        """An array with one row for each frame and one of these numbers of columns."""
        shape, _ = self._headers[key]
        if len(shape) != 2 or shape[1] not in columns:
            wanted = " or ".join(f"(frames, {count})" for count in columns)
            raise MotionError(
                f"{self._name}: `{key}` must have the shape {wanted}; it has {shape}."
            )
        if shape[0] == 0:
            raise MotionError(f"{self._name} has no frames in `{key}`; at least 1 is needed.")
        check_length(shape[0], self._name)
        return self._array(key)

    def _array(self, key: str) -> Float32[np.ndarray, "*shape"]:
        _, dtype = self._headers[key]
        if dtype.kind not in "fiu":
            raise MotionError(f"{self._name}: `{key}` must hold numbers; it holds {dtype}.")
        return read_numbers(self._archive, key, self._name)

    def _note(self, what: str) -> None:
        self._notes.append(f"{self._name} {what}.")
