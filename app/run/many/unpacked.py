"""Zips of result sets, unpacked so that whoever made them can do no harm.

Before a byte is unpacked every name is judged, and sizes and numbers are held against limits. Then
one file after the other is written, never over another, and never more than it says it has.
"""

from __future__ import annotations

import lzma
import os
import secrets
import shutil
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from app.errors import RunError, disk_full_sentence, is_disk_full
from app.run.output.result_folder import UNFINISHED, require_free_space
from conventions.names import printable
from model.storage.files import write_error
from model.storage.npz import MAX_FILE_BYTES

ENDING = ".zip"
_MAX_NAME_BYTES, _MAX_PATH_CHARS, _MAX_DEPTH = 200, 1000, 16
_BYTES_AN_ENTRY = 1024
"""Of the list of files at the end of a zip; usual entries have a tenth."""
_END, _END_64, _LOCATOR = b"PK\x05\x06", b"PK\x06\x06", b"PK\x06\x07"
_END_BYTES, _END_64_BYTES, _LOCATOR_BYTES, _MAX_COMMENT = 22, 56, 20, 65535
_DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError),
    *(RuntimeError, UnicodeDecodeError, struct.error, ValueError),
)


@dataclass(frozen=True)
class Limits:
    """What of a zip is unpacked at most."""

    files: int = 10_000
    """Also of such as are left out."""
    total_bytes: int = 20 * 2**30
    file_bytes: int = MAX_FILE_BYTES


@contextmanager
def unpacked_sets(
    sets: Sequence[tuple[Path, tuple[str, ...]]], out: Path, limits: Limits | None = None
) -> Iterator[dict[Path, Path]]:
    """Folders in place of those sets that are zips, by the zip's path, for the block.

    They lie in ``out``, where all who measure see them, each under the name of its zip.

    Args:
        sets: zips and folders, each with the endings of the files that are wanted of it.
        out: is there, and held by the caller.

    Raises:
        RunError: as `unpacked`.
    """
    staging = out / f"{UNFINISHED}{os.getpid()}-{secrets.token_hex(4)}"
    zips = {path: endings for path, endings in sets if is_zip(path)}
    folders = {
        path: staging / str(place) / (printable(path.stem) or "set")
        for place, path in enumerate(zips)
    }
    try:
        for path, folder in folders.items():
            folder.mkdir(parents=True)
            unpacked(path, folder, zips[path], limits)
        yield folders
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def is_zip(path: Path) -> bool:
    """Whether a person means a zip by it."""
    return path.suffix.lower() == ENDING and not path.is_dir()


def unpacked(
    archive: Path, folder: Path, endings: Sequence[str], limits: Limits | None = None
) -> int:
    """Unpack the files with these endings from a stranger's zip into an empty folder.

    Their times tell what is in them, not when they were made: the same file unpacked again has the
    same.

    Args:
        limits: by default those of a set on the command line.

    Returns:
        How many files there were.

    Raises:
        RunError: if it is no readable zip, holds links, names that lead elsewhere, one name twice,
            or more than the limits; files that were unpacked before it was seen may be left.
    """
    limits = limits or Limits()
    name = printable(archive.name)
    try:
        with archive.open("rb") as file:
            _check_list(file, name, limits)
            with zipfile.ZipFile(file) as opened:
                wanted = _wanted(opened.infolist(), name, endings, limits)
                require_free_space(folder, sum(entry.file_size for entry in wanted.values()))
                for path, entry in wanted.items():
                    _write(opened, entry, folder / path)
    except RunError:
        raise
    except FileExistsError as error:
        raise RunError(f"{name} holds two files of one name; it is not unpacked.") from error
    except OSError as error:
        if is_disk_full(error):
            raise RunError(disk_full_sentence(folder)) from error
        if error.filename is not None and Path(error.filename) != archive:
            raise write_error(Path(error.filename), error) from error
        raise RunError(f"{name} cannot be read: {error.strerror or error}.") from error
    except _DAMAGED as error:
        raise RunError(f"{name} is no readable zip; pack it again, without a password.") from error
    return len(wanted)


def _check_list(file: IO[bytes], name: str, limits: Limits) -> None:
    """See that the list of files is no longer than so many files need, before it is read whole."""
    size = file.seek(0, os.SEEK_END)
    start = max(0, size - _MAX_COMMENT - _END_BYTES - _LOCATOR_BYTES - _END_64_BYTES)
    file.seek(start)
    tail = file.read()
    end = len(tail) - _END_BYTES
    if tail[end : end + 4] != _END or tail[-2:] != b"\0\0":  # behind it stands a comment
        end = tail.rfind(_END)
    if end < 0 or len(tail) - end < _END_BYTES:
        raise RunError(f"{name} is no readable zip; pack it again.")
    (length,) = struct.unpack("<L", tail[end + 12 : end + 16])
    locator = end - _LOCATOR_BYTES
    if tail[max(0, locator) : max(0, locator) + 4] == _LOCATOR:
        big = locator - _END_64_BYTES
        if big < 0 or tail[big : big + 4] != _END_64:
            raise RunError(f"{name} is no readable zip; pack it again.")
        (length,) = struct.unpack("<Q", tail[big + 40 : big + 48])
    if length > _BYTES_AN_ENTRY * limits.files:
        raise RunError(f"{name} holds more files than the {limits.files} that are read; split it.")


def _wanted(
    entries: list[zipfile.ZipInfo], name: str, endings: Sequence[str], limits: Limits
) -> dict[PurePosixPath, zipfile.ZipInfo]:
    """By their path below the folder."""
    if len(entries) > limits.files:
        raise RunError(
            f"{name} holds {len(entries)} files; at most {limits.files} are read. Split it."
        )
    wanted: dict[PurePosixPath, zipfile.ZipInfo] = {}
    for entry in entries:
        path = _checked_path(entry, name)
        if entry.is_dir() or path.suffix not in endings or _is_hidden(path):
            continue
        if path in wanted:
            raise RunError(f"{name} holds {str(path)!r} twice; it is not unpacked.")
        if entry.file_size > limits.file_bytes:
            raise RunError(
                f"{name} holds {str(path)!r} of {_mib(entry.file_size)}; at most "
                f"{_mib(limits.file_bytes)} a file are read."
            )
        wanted[path] = entry
    total = sum(entry.file_size for entry in wanted.values())
    if total > limits.total_bytes:
        raise RunError(
            f"{name} would unpack to {_mib(total)}; at most {_mib(limits.total_bytes)} are read."
        )
    if not wanted:
        raise RunError(f"{name} holds none of the files that are looked for: {', '.join(endings)}.")
    return wanted


def _checked_path(entry: zipfile.ZipInfo, name: str) -> PurePosixPath:
    """Where an entry would lie.

    Raises:
        RunError: if that is outside, or it is neither a file nor a folder.
    """
    shown = printable(entry.filename[:80])
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        raise RunError(
            f"{name} holds {shown!r}, which is a link or device; it is not unpacked. Pack the "
            "files themselves."
        )
    parts = entry.filename.removesuffix("/").split("/")
    is_plain = (
        len(entry.filename) <= _MAX_PATH_CHARS
        and len(parts) <= _MAX_DEPTH
        and all(_is_plain(part) for part in parts)
    )
    if not is_plain:
        raise RunError(
            f"{name} holds {shown!r}, a name that leads out of its folder or is no plain one; it "
            "is not unpacked. Rename it and pack again."
        )
    return PurePosixPath(*parts)


def _is_plain(part: str) -> bool:
    return (
        part not in ("", ".", "..")
        and part.isprintable()
        and not set(part) & set('\\:*?"<>|')
        and len(part.encode()) <= _MAX_NAME_BYTES
    )


def _is_hidden(path: PurePosixPath) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in path.parts)


def _write(opened: zipfile.ZipFile, entry: zipfile.ZipInfo, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with opened.open(entry) as source, path.open("xb") as target:
        left = entry.file_size
        while block := source.read(min(1 << 20, left + 1)):
            left -= len(block)
            if left < 0:
                raise zipfile.BadZipFile("more than it says")
            target.write(block)
        if left:
            raise zipfile.BadZipFile("less than it says")
    os.utime(path, (entry.CRC, entry.CRC))


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"
