"""Motion as the app passes it around, and BEAT2 npz files in and out.

The file format is documented in ``docs/formats.md``. Files come from strangers: their headers are
read and judged before any array is.
"""

import math
import tokenize
import zipfile
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from model.files import written_atomically
from model.rotations import matrix_from_axis_angle
from model.skeleton import NUM_JOINTS
from model.timing import FPS

ExpressionBasis = Literal["flame100", "arkit52"]

NUM_EXPRESSIONS = 100
NUM_BETAS = 300
MAX_FRAMES = 60 * 60 * FPS
"""One hour; longer files are refused before their arrays are read."""
MAX_BYTES = 512 * 2**20
"""Largest size of a file's arrays once unpacked."""
MAX_ABS_VALUE = 1000.0
"""No radian, metre or coefficient of a real motion is near it."""

_COLUMNS = {"poses": NUM_JOINTS * 3, "trans": 3, "expressions": NUM_EXPRESSIONS}
_REQUIRED = ("poses", "trans", "expressions", "betas", "mocap_frame_rate")
_MAX_ENTRIES = 64


class MotionError(ValueError):
    """A motion or motion file that cannot be used; the message is one sentence for a person."""


@dataclass(frozen=True, eq=False)
class Motion:
    """One person's motion at 30 fps.

    Raises:
        MotionError: if the arrays differ in length, are empty or are not finite.
    """

    poses: Float32[np.ndarray, "T 165"]
    """Local axis-angle of the 55 SMPL-X joints, radians; zero is the flat hand."""
    trans: Float32[np.ndarray, "T 3"]
    """Translation of the body in metres, y up (``transl`` of SMPL-X)."""
    expressions: Float32[np.ndarray, "T 100"]
    """Coefficients of ``expression_basis``; arkit52 fills the first 52 columns."""
    expression_basis: ExpressionBasis
    betas: Float32[np.ndarray, " 300"]
    """Shape coefficients of SMPL-X."""

    def __post_init__(self) -> None:
        num_frames = len(self.poses)
        if num_frames == 0:
            raise MotionError("The motion has no frames; at least 1 is needed.")
        wanted = {name: (num_frames, columns) for name, columns in _COLUMNS.items()}
        for name, shape in {**wanted, "betas": (NUM_BETAS,)}.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise MotionError(f"`{name}` must have the shape {shape}; it has {array.shape}.")
            if not np.isfinite(array).all():
                raise MotionError(f"`{name}` holds values that are not finite (NaN or infinite).")
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

    def local_rotations(self) -> Float[Tensor, "T 55 3 3"]:
        """Rotation of each joint relative to its parent."""
        poses = torch.tensor(self.poses)  # a copy: the arrays may be read-only
        return matrix_from_axis_angle(poses.unflatten(-1, (NUM_JOINTS, 3)))


def first_frames(motion: Motion, num_frames: int) -> Motion:
    """The start of a motion."""
    return replace(
        motion,
        poses=motion.poses[:num_frames],
        trans=motion.trans[:num_frames],
        expressions=motion.expressions[:num_frames],
    )


def save_motion(motion: Motion, path: str | Path) -> None:
    """Write BEAT2's npz plus ``expression_basis``; the file appears whole or not at all.

    Raises:
        WriteError: if the file cannot be written; the message says why.
    """
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
        )


def load_motion(path: str | Path) -> Motion:
    """Read a BEAT2 npz file. Without ``expression_basis`` it is taken as flame100.

    Raises:
        MotionError: if the file is missing, is no such file, or holds what a motion cannot; the
            message is one sentence that names the file.
    """
    path = Path(path)
    if not path.is_file():
        kind = "is a folder, not a motion file" if path.is_dir() else "does not exist"
        raise MotionError(f"{path.name} {kind}; give a BEAT2 motion file (.npz).")
    try:
        with zipfile.ZipFile(path) as archive:
            return _read_archive(archive, path.name)
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        NotImplementedError,
        RuntimeError,
        UnicodeDecodeError,
    ) as error:
        raise MotionError(
            f"{path.name} is not a readable npz file; give a BEAT2 motion file (.npz)."
        ) from error
    except OSError as error:
        raise MotionError(f"{path.name} could not be read: {error.strerror or error}.") from error


def _read_archive(archive: zipfile.ZipFile, name: str) -> Motion:
    headers = _read_headers(archive, name)
    missing = [key for key in _REQUIRED if key not in headers]
    if missing:
        raise MotionError(
            f"{name} lacks {_listed(missing)}; it holds {_listed(sorted(headers)) or 'nothing'}, "
            f"but a BEAT2 motion file needs {_listed(_REQUIRED)}."
        )
    _check_headers(headers, name)
    fps = float(_read_array(archive, "mocap_frame_rate").reshape(-1)[0])
    if fps != FPS:
        raise MotionError(f"{name} has {fps:g} frames per second; resample it to {FPS} first.")
    arrays: dict[str, np.ndarray] = {}
    for key in (*_COLUMNS, "betas"):
        array = _read_array(archive, key)
        if not np.isfinite(array).all():
            where = "" if array.ndim < 2 else f" in frame {_first_bad_frame(array)}"
            raise MotionError(
                f"{name} holds values that are not finite (NaN or infinite) in `{key}`{where}; "
                "repair the file first."
            )
        largest = float(np.abs(array).max())
        if largest > MAX_ABS_VALUE:
            raise MotionError(
                f"{name} holds {largest:.3g} in `{key}`, beyond {MAX_ABS_VALUE:g}; radians and "
                "metres are expected."
            )
        arrays[key] = np.ascontiguousarray(array, dtype=np.float32)
    basis = "flame100"
    if "expression_basis" in headers:
        basis = str(_read_array(archive, "expression_basis").reshape(-1)[0])
        if basis not in get_args(ExpressionBasis):
            raise MotionError(
                f"{name} has the expression basis '{basis[:40]}'; flame100 and arkit52 are known."
            )
    return Motion(expression_basis=cast(ExpressionBasis, basis), **arrays)


Header = tuple[tuple[int, ...], np.dtype]


def _read_headers(archive: zipfile.ZipFile, name: str) -> dict[str, Header]:
    """Shape and dtype of every array; nothing is unpacked but the first bytes of each."""
    entries = archive.infolist()
    size = sum(entry.file_size for entry in entries)
    if len(entries) > _MAX_ENTRIES or size > MAX_BYTES:
        raise MotionError(
            f"{name} would unpack to {size / 2**20:.0f} MiB in {len(entries)} arrays; at most "
            f"{MAX_BYTES // 2**20} MiB in {_MAX_ENTRIES} arrays are read."
        )
    headers: dict[str, Header] = {}
    for entry in entries:
        key = entry.filename.removesuffix(".npy")
        if key == entry.filename:
            raise MotionError(
                f"{name} holds `{key[:40]}`, which is not an array; give a BEAT2 motion file."
            )
        with archive.open(entry) as file:
            header = _read_npy_header(cast(zipfile.ZipExtFile, file))
            header_bytes = file.tell()
        if header is None:
            raise MotionError(f"{name} is damaged: `{key[:40]}` is not an array.")
        shape, dtype = header
        if dtype.hasobject:
            raise MotionError(
                f"{name} holds pickled Python objects in `{key[:40]}`, which are never loaded; "
                "save it again with plain number arrays."
            )
        if math.prod(shape) * dtype.itemsize + header_bytes != entry.file_size:
            raise MotionError(f"{name} is damaged: `{key[:40]}` does not have its stated size.")
        headers[key] = header
    return headers


def _read_npy_header(file: zipfile.ZipExtFile) -> Header | None:
    """Shape and dtype of one array, or None where the bytes are no npy header."""
    try:
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        else:
            shape, _, dtype = np.lib.format.read_array_header_2_0(file)
    except (ValueError, TypeError, SyntaxError, tokenize.TokenError, RecursionError, MemoryError):
        return None  # numpy parses the header as Python source, which fails in all these ways
    return shape, dtype


def _check_headers(headers: dict[str, Header], name: str) -> None:
    num_frames = headers["poses"][0][0] if headers["poses"][0] else 0
    if headers["poses"][0][:1] == (0,):
        raise MotionError(f"{name} has no frames; at least 1 is needed.")
    if num_frames > MAX_FRAMES:
        raise MotionError(
            f"{name} has {num_frames} frames; at most {MAX_FRAMES} "
            f"({MAX_FRAMES // FPS // 60} minutes) are read. Cut it first."
        )
    for key in (*_COLUMNS, "betas", "mocap_frame_rate"):
        shape, dtype = headers[key]
        if dtype.kind not in "fiu":
            raise MotionError(f"{name}: `{key}` must hold numbers; it holds {dtype}.")
        if key in _COLUMNS:
            is_right = len(shape) == 2 and shape[1] == _COLUMNS[key]
            wanted = f"(frames, {_COLUMNS[key]})"
        elif key == "betas":
            is_right, wanted = shape == (NUM_BETAS,), f"({NUM_BETAS},)"
        else:
            is_right, wanted = math.prod(shape) == 1, "()"
        if not is_right:
            raise MotionError(f"{name}: `{key}` must have the shape {wanted}; it has {shape}.")
        if key in _COLUMNS and shape[0] != num_frames:
            raise MotionError(
                f"{name}: `{key}` has {shape[0]} frames but `poses` has {num_frames}; they must "
                "be equal."
            )
    if "expression_basis" in headers:
        shape, dtype = headers["expression_basis"]
        if math.prod(shape) != 1 or dtype.kind != "U":
            raise MotionError(f"{name}: `expression_basis` must be one text.")


def _read_array(archive: zipfile.ZipFile, key: str) -> np.ndarray:
    with archive.open(f"{key}.npy") as file:
        try:
            return np.lib.format.read_array(file, allow_pickle=False)
        except ValueError as error:
            raise zipfile.BadZipFile(f"`{key}` is damaged") from error


def _first_bad_frame(array: np.ndarray) -> int:
    return int(np.argmin(np.isfinite(array).all(axis=1)))


def _listed(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(name[:40] for name in names[:12])
