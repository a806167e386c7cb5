"""Reading of untrusted numpy archives: headers are checked before any array is loaded."""

import io
import lzma
import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import cast

import numpy as np

from conventions.names import printable

MAX_BYTES = 512 * 2**20
"""Largest size of a file's arrays once unpacked (bytes)."""
MAX_FILE_BYTES = 160 * 2**20
"""Largest file that is opened at all (bytes); an hour of BEAT2's uncompressed arrays is 153 MiB."""
MAX_ABS_VALUE = 1000.0
"""Largest absolute value in a motion; real radians, metres and coefficients are far below."""

_MAX_ENTRIES = 64

Header = tuple[tuple[int, ...], np.dtype]


class MotionError(ValueError):
    """A motion or motion file that cannot be used; the message is one sentence for the user."""


def check_size(path: Path) -> None:
    """Check that a file is small enough to be opened; raises MotionError if it is too large."""
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise MotionError(
            f"{path.name} is {size / 2**20:.0f} MiB; the limit is {MAX_FILE_BYTES // 2**20} MiB. "
            "Shorten the motion first."
        )


@contextmanager
def open_archive(path: Path, content: io.BytesIO | None = None) -> Iterator[zipfile.ZipFile]:
    """Open ``path`` or ``content``; raises MotionError, also while it is being read."""
    if not path.is_file():
        kind = "is a folder, not a motion file" if path.is_dir() else "does not exist"
        raise MotionError(f"{path.name} {kind}; give a BEAT2 motion file (.npz).")
    check_size(path)
    try:
        with zipfile.ZipFile(content or path) as archive:
            yield archive
    except (
        zipfile.BadZipFile,
        zlib.error,
        lzma.LZMAError,
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


def read_headers(
    archive: zipfile.ZipFile, name: str, allow_objects: bool = False
) -> dict[str, Header]:
    """Read the shape and dtype of every array; nothing is unpacked but the first bytes of each.

    Arrays of Python objects, which are never loaded, are listed on request. Raises MotionError for
    too many or too large arrays, and for members that are not arrays.
    """
    entries = archive.infolist()
    size = sum(entry.file_size for entry in entries)
    if len(entries) > _MAX_ENTRIES or size > MAX_BYTES:
        raise MotionError(
            f"{name} would unpack to {size / 2**20:.0f} MiB in {len(entries)} arrays; the limits "
            f"are {MAX_BYTES // 2**20} MiB and {_MAX_ENTRIES} arrays."
        )
    headers: dict[str, Header] = {}
    for entry in entries:
        key = entry.filename.removesuffix(".npy")
        shown = printable(key[:40])
        if key == entry.filename:
            raise MotionError(
                f"{name} holds `{shown}`, which is not an array; give a BEAT2 motion file."
            )
        with archive.open(entry) as file:
            header = _read_npy_header(cast(io.BufferedIOBase, file))
            header_bytes = file.tell()
        if header is None:
            raise MotionError(f"{name} is damaged: `{shown}` is not an array.")
        shape, dtype = header
        if dtype.hasobject and not allow_objects:
            raise MotionError(
                f"{name} holds pickled Python objects in `{shown}`, which are never loaded; "
                "save it again with plain number arrays."
            )
        size_is = math.prod(shape) * dtype.itemsize + header_bytes
        if not dtype.hasobject and size_is != entry.file_size:
            raise MotionError(f"{name} is damaged: `{shown}` does not have its stated size.")
        headers[key] = header
    return headers


def read_array(archive: zipfile.ZipFile, key: str) -> np.ndarray:
    """Read an array; raises BadZipFile if it is damaged or holds Python objects."""
    with archive.open(f"{key}.npy") as file:
        try:
            return np.lib.format.read_array(file, allow_pickle=False)
        except (ValueError, TypeError, OverflowError) as error:
            raise zipfile.BadZipFile(f"`{key}` is damaged") from error


def read_npy_file(path: Path) -> np.ndarray | None:
    """Read the array of an npy file without Python objects; None for any other file."""
    with path.open("rb") as file:
        header = _read_npy_header(file)
        if header is None or header[1].hasobject:
            return None
        shape, dtype = header
        if math.prod(shape) * dtype.itemsize + file.tell() != path.stat().st_size:
            return None
        file.seek(0)
        return np.lib.format.read_array(file, allow_pickle=False)


def format_names(names: tuple[str, ...] | list[str]) -> str:
    """Format at most 12 names for a sentence, each at most 40 characters."""
    return ", ".join(printable(name[:40]) for name in names[:12])


def _read_npy_header(file: io.BufferedIOBase) -> Header | None:
    """Read the shape and dtype of one array; None if the bytes are not an npy header."""
    try:
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        else:
            shape, _, dtype = np.lib.format.read_array_header_2_0(file)
    except (ValueError, TypeError, SyntaxError, tokenize.TokenError, RecursionError, MemoryError):
        return None  # numpy parses the header as Python source, which fails in all these ways
    if any(type(length) is not int or length < 0 for length in shape):
        return None  # numpy takes True for a length
    return shape, dtype
