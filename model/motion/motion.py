"""The `Motion` class, and reading and writing of BEAT2 npz files.

The file format is documented in ``docs/formats.md``. Files of other tools are read by
`model.formats.read`.
"""

import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
import torch
from jaxtyping import Float, Float32, Shaped
from torch import Tensor

from conventions.joints import NUM_JOINTS
from conventions.rates import FPS
from model.motion.rotations import matrix_from_axis_angle
from model.storage.files import written_atomically
from model.storage.npz import (
    MAX_ABS_VALUE,
    Header,
    MotionError,
    format_names,
    open_archive,
    read_array,
    read_headers,
)

ExpressionBasis = Literal["flame100", "arkit52"]

NUM_EXPRESSIONS = 100
NUM_BETAS = 300
NUM_FACE_UNITS = 52
MAX_FRAMES = 60 * 60 * FPS
"""Largest number of frames, one hour; longer files are refused before their arrays are read."""

_COLUMNS = {"poses": NUM_JOINTS * 3, "trans": 3, "expressions": NUM_EXPRESSIONS}
_REQUIRED = ("poses", "trans", "expressions", "betas", "mocap_frame_rate")


@dataclass(frozen=True, eq=False)
class Motion:
    """One person's motion at 30 fps.

    Raises:
        MotionError: if the arrays differ in length, are empty or are not finite.

    Example:
        >>> import numpy as np
        >>> motion = Motion(
        ...     poses=np.zeros((60, 165), np.float32),
        ...     trans=np.zeros((60, 3), np.float32),
        ...     expressions=np.zeros((60, 100), np.float32),
        ...     expression_basis="arkit52",
        ...     betas=np.zeros(300, np.float32),
        ... )
        >>> motion.duration_s, motion.part(slice(15)).num_frames
        (2.0, 15)
        >>> motion.local_rotations().shape
        torch.Size([60, 55, 3, 3])
    """

    poses: Float32[np.ndarray, "T 165"]
    """Local axis-angle (T, 165) of the 55 SMPL-X joints in radians; zero is the flat hand."""
    trans: Float32[np.ndarray, "T 3"]
    """Translation (T, 3) of the body in metres, y up (``transl`` of SMPL-X)."""
    expressions: Float32[np.ndarray, "T 100"]
    """Coefficients (T, 100) of ``expression_basis``; arkit52 fills the first 52 columns."""
    expression_basis: ExpressionBasis
    betas: Float32[np.ndarray, " 300"]
    """Shape coefficients (300,) of SMPL-X."""

    def __post_init__(self) -> None:
        _check(vars(self))
        if self.expression_basis not in get_args(ExpressionBasis):
            raise MotionError(
                f"The expression basis must be flame100 or arkit52; it is {self.expression_basis}."
            )

    @property
    def num_frames(self) -> int:
        return len(self.poses)

    @property
    def duration_s(self) -> float:
        return self.num_frames / FPS

    def part(self, frames: slice | Shaped[np.ndarray, " N"]) -> "Motion":
        """Return a selection of the frames as a motion."""
        return replace(
            self,
            poses=self.poses[frames],
            trans=self.trans[frames],
            expressions=self.expressions[frames],
        )

    def local_rotations(self) -> Float[Tensor, "T 55 3 3"]:
        """Return the rotation of each joint relative to its parent."""
        poses = torch.tensor(self.poses)  # a copy: the arrays may be read-only
        return matrix_from_axis_angle(poses.unflatten(-1, (NUM_JOINTS, 3)))


def concatenate(parts: Sequence[Motion]) -> Motion:
    """Concatenate consecutive motions of one body."""
    first = parts[0]
    poses, trans, expressions = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("poses", "trans", "expressions")
    )
    return replace(first, poses=poses, trans=trans, expressions=expressions)


def first_frames(motion: Motion, num_frames: int) -> Motion:
    """Return the first ``num_frames`` frames of a motion."""
    return motion.part(slice(num_frames))


def arkit_weights_or_zeros(motion: Motion) -> Float32[np.ndarray, "T 52"]:
    """Return the 52 face units; all zero for a motion with FLAME coefficients."""
    if motion.expression_basis == "arkit52":
        return motion.expressions[:, :NUM_FACE_UNITS].astype(np.float32)
    return np.zeros((motion.num_frames, NUM_FACE_UNITS), np.float32)


def remove_lag(motion: Motion, lag_s: float) -> Motion:
    """Move a motion earlier by its lag, repeating the first pose if < 0; may raise ValueError."""
    shift = round(lag_s * FPS)
    if abs(shift) >= motion.num_frames:
        raise ValueError(
            f"The lag must be shorter than the motion ({motion.duration_s:.1f} s); got {lag_s:g} s."
        )
    return motion.part(np.maximum(np.arange(shift, motion.num_frames), 0))


def save_motion(motion: Motion, path: str | Path, **texts: str) -> None:
    """Write BEAT2's npz atomically, with ``expression_basis`` and ``texts``; raises WriteError.

    Other readers ignore these two.
    """
    further: dict[str, Any] = {key: np.array(text) for key, text in texts.items()}
    with written_atomically(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(
            file,
            poses=motion.poses,
            trans=motion.trans,
            betas=motion.betas,
            expressions=motion.expressions,
            expression_basis=np.array(motion.expression_basis),
            mocap_frame_rate=np.array(FPS, dtype=np.int32),
            gender=np.array("neutral"),
            model=np.array("smplx2020"),
            **further,
        )


def load_motion(path: str | Path) -> Motion:
    """Load a BEAT2 npz, as flame100 without ``expression_basis``; raises MotionError."""
    name = Path(path).name
    with open_archive(Path(path)) as archive:
        headers = read_headers(archive, name)
        missing = [key for key in _REQUIRED if key not in headers]
        if missing:
            raise MotionError(
                f"{name} lacks {format_names(missing)}; it holds "
                f"{format_names(sorted(headers)) or 'nothing'}, "
                f"but a BEAT2 motion file needs {format_names(_REQUIRED)}."
            )
        check_num_frames((headers["poses"][0] or (0,))[0], name)
        basis = read_basis(archive, headers, name)
        arrays = {key: read_array(archive, key) for key in _REQUIRED}
    for key, array in arrays.items():
        if array.dtype.kind not in "fiu":
            raise MotionError(f"{name}: `{key}` must hold numbers; it holds {array.dtype}.")
        largest = float(np.abs(array).max(initial=0.0))
        if MAX_ABS_VALUE < largest < math.inf:
            raise MotionError(
                f"{name} contains the value {largest:.3g} in `{key}`, above the limit of "
                f"{MAX_ABS_VALUE:g}; use radians and metres."
            )
    fps = [f"{each:g}" for each in arrays.pop("mocap_frame_rate").flat[:2]]
    if fps != [f"{FPS}"]:
        rates = f"{' and '.join(fps) or 'an unknown number of'} frames per second"
        raise MotionError(f"{name} has {rates}; resample it to {FPS} first.")
    numbers = {key: np.ascontiguousarray(array, np.float32) for key, array in arrays.items()}
    try:
        _check(numbers)
    except MotionError as error:
        raise MotionError(f"{name}: {error}") from None
    return Motion(expression_basis=basis, **numbers)


def _check(arrays: Mapping[str, Any]) -> None:
    """Check that the arrays are of one motion, and finite."""
    frames = arrays["poses"].shape[:1]
    if frames == (0,):
        raise MotionError("The motion has no frames; at least 1 is needed.")
    wanted = {name: (*frames, columns) for name, columns in _COLUMNS.items()}
    for name, shape in {**wanted, "betas": (NUM_BETAS,)}.items():
        array = arrays[name]
        if array.shape != shape:
            raise MotionError(f"`{name}` must have the shape {shape}; it has {array.shape}.")
        if not np.isfinite(array).all():
            frame = np.argwhere(~np.isfinite(array))[0][0]
            where = f", first in frame {frame}" if array.ndim > 1 else ""
            raise MotionError(
                f"`{name}` holds values that are not finite (NaN or infinite){where}."
            )


def read_basis(archive: zipfile.ZipFile, headers: dict[str, Header], name: str) -> ExpressionBasis:
    """Read a file's expression basis, by default flame100; raises MotionError if unknown."""
    if "expression_basis" not in headers:
        return "flame100"
    shape, dtype = headers["expression_basis"]
    if math.prod(shape) != 1 or dtype.kind != "U":
        raise MotionError(f"{name}: `expression_basis` must be a single string.")
    basis = str(read_array(archive, "expression_basis").reshape(-1)[0])
    if basis not in get_args(ExpressionBasis):
        raise MotionError(
            f"{name} has the expression basis '{basis[:40]}'; flame100 and arkit52 are known."
        )
    return cast(ExpressionBasis, basis)


def check_num_frames(num_frames: int, name: str) -> None:
    """Refuse a motion of more than an hour; raises MotionError naming the limit."""
    if num_frames > MAX_FRAMES:
        raise MotionError(
            f"{name} has {num_frames} frames; at most {MAX_FRAMES} "
            f"({MAX_FRAMES // FPS // 60} minutes) are read. Cut it first."
        )
