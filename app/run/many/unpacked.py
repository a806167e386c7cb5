"""Zips and tars of result sets, unpacked so that whoever made them can do no harm.

Before a byte is unpacked every name is judged, and sizes and numbers are held against limits. Then
one file after the other is written, never over another, and never more than it says it has.
Archives in an archive are unpacked as well, within what is left of the limits.
"""

from __future__ import annotations

import gzip
import lzma
import os
import secrets
import shutil
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Any, cast

from app.errors import RunError, disk_full_sentence, is_disk_full
from app.run.many.pairing import is_hidden
from app.run.output.result_folder import UNFINISHED, list_bytes, require_free_space
from app.run.upload_check import PACKED
from conventions.names import printable
from model.storage.files import write_error
from model.storage.npz import MAX_FILE_BYTES

TARS = PACKED[1:]
_MAX_NESTED = 2
"""Archives in archives; deeper ones are refused."""
_MAX_HEADER_BYTES = 1 << 20
"""Of one name or one list of a tar, which is held in memory."""
_MAX_NAME_BYTES, _MAX_PATH_CHARS, _MAX_DEPTH = 200, 1000, 16
_BYTES_AN_ENTRY = 1024
"""Of the list of files at the end of a zip; usual entries have a tenth."""
_DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError),
    *(RuntimeError, UnicodeDecodeError, struct.error, ValueError, tarfile.TarError),
)


@dataclass(frozen=True)
class UnpackLimits:
    """What of a zip is unpacked at most."""

    files: int = 10_000
    """Also of such as are left out."""
    total_bytes: int = 20 * 2**30
    file_bytes: int = MAX_FILE_BYTES


@contextmanager
def unpacked_sets(
    sets: Sequence[tuple[Path, tuple[str, ...]]], out: Path
) -> Iterator[dict[Path, Path]]:
    """Folders in place of those sets that are archives, by the archive's path, for the block.

    They lie in ``out``, where all who measure see them, each under the name of its zip.

    Args:
        sets: zips and folders, each with the endings of the files that are wanted of it.
        out: is there, and held by the caller.

    Raises:
        RunError: as `unpacked`.
    """
    staging = out / f"{UNFINISHED}{os.getpid()}-{secrets.token_hex(4)}"
    try:
        yield unpack_sets(sets, staging)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def unpack_sets(
    sets: Sequence[tuple[Path, tuple[str, ...]]], top: Path, together: UnpackLimits | None = None
) -> dict[Path, Path]:
    """The same below a folder, where they stay.

    Args:
        together: limits of all of them; by default each has its own.
    """
    left, folders = None if together is None else _Left(together), {}
    for path, endings in sets:
        if is_packed(path) and path not in folders:
            folder = top / str(len(folders)) / (printable(stem_of(path)) or "set")
            folder.mkdir(parents=True)
            _unpack_wanted(path, folder, endings, left or _Left(UnpackLimits()))
            folders[path] = folder
    return folders


def is_packed(path: Path) -> bool:
    """Whether a person means a zip or a tar by it."""
    return _ending_of(path.name) is not None and not path.is_dir()


def stem_of(path: Path) -> str:
    """Its name without the ending of an archive."""
    return path.name[: -len(_ending_of(path.name) or "")] if is_packed(path) else path.stem


def _ending_of(name: str) -> str | None:
    return next((each for each in PACKED if name.lower().endswith(each)), None)


def unpacked(
    archive: Path, folder: Path, endings: Sequence[str], limits: UnpackLimits | None = None
) -> int:
    """Unpack the files with these endings from a stranger's zip or tar into an empty folder.

    Their times tell what is in them, not when they were made: the same file unpacked again has the
    same.

    Args:
        limits: by default those of a set on the command line.

    Returns:
        How many files there were.

    Raises:
        RunError: if it is no readable archive, holds links, names that lead elsewhere, one name
            twice, nothing that is wanted, or more than the limits; files that were unpacked before
            it was seen may be left.
    """
    return _unpack_wanted(archive, folder, endings, _Left(limits or UnpackLimits()))


def _unpack_wanted(archive: Path, folder: Path, endings: Sequence[str], left: _Left) -> int:
    before = left.wanted
    _unpack(archive, folder, endings, left, 0)
    if left.wanted == before:
        raise RunError(
            f"{printable(archive.name)} holds none of the files that are looked for: "
            f"{', '.join(endings)}."
        )
    return left.wanted - before


class _Left:
    """What of the limits has not been used yet; of archives in archives, too."""

    def __init__(self, limits: UnpackLimits) -> None:
        self.limits = limits
        self.wanted = 0

    def use(self, files: int, count: int, size: int) -> None:
        self.wanted += count
        old = self.limits
        self.limits = UnpackLimits(old.files - files, old.total_bytes - size, old.file_bytes)


def _unpack(archive: Path, folder: Path, endings: Sequence[str], left: _Left, depth: int) -> None:
    name = printable(archive.name)
    is_tar = _ending_of(archive.name) in TARS
    noun, unpack = ("tar", _unpack_tar) if is_tar else ("zip", _unpack_zip)
    try:
        inner = unpack(archive, name, folder, endings, left)
    except RunError:
        raise
    except FileExistsError as error:
        raise RunError(f"{name} holds two files of one name; it is not unpacked.") from error
    except OSError as error:
        if is_disk_full(error):
            raise RunError(disk_full_sentence(folder)) from error
        if error.filename is not None and Path(error.filename) != archive:
            raise write_error(Path(error.filename), error) from error
        if isinstance(error, gzip.BadGzipFile):
            raise RunError(f"{name} is no readable {noun}; pack it again.") from error
        raise RunError(f"{name} cannot be read: {error.strerror or error}.") from error
    except _DAMAGED as error:
        raise RunError(
            f"{name} is no readable {noun}; pack it again, without a password."
        ) from error
    for path in inner:
        if depth + 1 > _MAX_NESTED:
            raise RunError(
                f"{name} holds {path.name!r}, an archive {depth + 1} deep; at most {_MAX_NESTED} "
                "are unpacked. Pack the files themselves."
            )
        into = path.with_name(stem_of(path) or "set")
        if into.is_file():
            raise RunError(f"{name} holds two files of one name; it is not unpacked.")
        into.mkdir(exist_ok=True)
        _unpack(path, into, endings, left, depth + 1)
        path.unlink()


def _unpack_zip(
    archive: Path, name: str, folder: Path, endings: Sequence[str], left: _Left
) -> list[Path]:
    """Archives that were in it."""
    with archive.open("rb") as file:
        _check_list(file, name, left.limits)
        with zipfile.ZipFile(file) as opened:
            entries = [_zip_entry(entry, name) for entry in opened.infolist()]
            wanted = _wanted(entries, name, endings, left)
            require_free_space(folder, sum(entry.size for entry in wanted.values()))
            for path, entry in wanted.items():
                with opened.open(entry.source) as source:
                    _write(source, entry.size, folder / path)
                os.utime(folder / path, (entry.source.CRC, entry.source.CRC))
    return [folder / path for path in wanted if _ending_of(path.name)]


def _unpack_tar(
    archive: Path, name: str, folder: Path, endings: Sequence[str], left: _Left
) -> list[Path]:
    """Archives that were in it."""
    is_plain = archive.name.lower().endswith(".tar")
    with archive.open("rb") if is_plain else gzip.open(archive) as file:
        capped = _Capped(cast(IO[bytes], file), name, left.limits)
        with tarfile.open(fileobj=cast(IO[bytes], capped), mode="r:") as opened:
            entries = []
            for member in opened:
                entries.append(_tar_entry(member, name))
                if len(entries) > left.limits.files:
                    break  # `_wanted` refuses it
            wanted = _wanted(entries, name, endings, left)
            require_free_space(folder, sum(entry.size for entry in wanted.values()))
            for path, entry in wanted.items():
                source = opened.extractfile(entry.source)
                assert source is not None
                check = _write(source, entry.size, folder / path)
                os.utime(folder / path, (check, check))
    return [folder / path for path in wanted if _ending_of(path.name)]


class _Capped:
    """A stream that is read no further than the limits let a tar reach, nor much at once."""

    def __init__(self, file: IO[bytes], name: str, limits: UnpackLimits) -> None:
        self._file, self._name = file, name
        self._most = limits.total_bytes + limits.files * _BYTES_AN_ENTRY

    def read(self, size: int = -1) -> bytes:
        if not 0 <= size <= _MAX_HEADER_BYTES + tarfile.BLOCKSIZE:
            raise tarfile.ReadError("a header of no usual size")
        self._check(self._file.tell() + size)
        return self._file.read(size)

    def seek(self, place: int, whence: int = 0) -> int:
        self._check(place)
        return self._file.seek(place, whence)

    def tell(self) -> int:
        return self._file.tell()

    def _check(self, place: int) -> None:
        if place > self._most + tarfile.RECORDSIZE:
            raise RunError(
                f"{self._name} would unpack to over {_mib(self._most)}, the most that is read."
            )


@dataclass(frozen=True)
class _Entry:
    """A file or folder of an archive."""

    path: PurePosixPath
    size: int
    is_folder: bool
    source: Any
    """What the archive calls it."""


def _check_list(file: IO[bytes], name: str, limits: UnpackLimits) -> None:
    """See that the list of files is no longer than so many files need, before it is read whole."""
    if list_bytes(file) > _BYTES_AN_ENTRY * limits.files:
        raise RunError(f"{name} holds more files than the {limits.files} that are read; split it.")


def _wanted(
    entries: list[_Entry], name: str, endings: Sequence[str], left: _Left
) -> dict[PurePosixPath, _Entry]:
    """By their path below the folder."""
    limits = left.limits
    if len(entries) > limits.files:
        raise RunError(
            f"{name} holds {len(entries)} files; at most {limits.files} are read. Split it."
        )
    wanted: dict[PurePosixPath, _Entry] = {}
    for entry in entries:
        path = entry.path
        is_wanted = path.suffix.lower() in endings or _ending_of(path.name) is not None
        if entry.is_folder or not is_wanted or is_hidden(path):
            continue
        if path in wanted:
            raise RunError(f"{name} holds {str(path)!r} twice; it is not unpacked.")
        if entry.size > limits.file_bytes and _ending_of(path.name) is None:
            raise RunError(
                f"{name} holds {str(path)!r} of {_mib(entry.size)}; at most "
                f"{_mib(limits.file_bytes)} a file are read."
            )
        wanted[path] = entry
    total = sum(entry.size for entry in wanted.values())
    if total > limits.total_bytes:
        raise RunError(
            f"{name} would unpack to {_mib(total)}; at most {_mib(limits.total_bytes)} are read."
        )
    left.use(len(entries), sum(_ending_of(path.name) is None for path in wanted), total)
    return wanted


def _zip_entry(entry: zipfile.ZipInfo, name: str) -> _Entry:
    """Names that Windows wrote have its backslashes."""
    kind = stat.S_IFMT(entry.external_attr >> 16)
    path = _checked_path(entry.filename.replace("\\", "/"), name, kind in _FILE_KINDS)
    is_folder = entry.filename.endswith(("/", "\\"))
    return _Entry(path, entry.file_size, is_folder, entry)


def _tar_entry(member: tarfile.TarInfo, name: str) -> _Entry:
    if member.size < 0:
        raise tarfile.ReadError("a file of less than nothing")
    is_file = member.isreg() and not member.issparse()
    path = _checked_path(member.name.removeprefix("./") or ".", name, is_file or member.isdir())
    return _Entry(path, member.size, member.isdir(), member)


_FILE_KINDS = (0, stat.S_IFREG, stat.S_IFDIR)


def _checked_path(path: str, name: str, is_usual: bool) -> PurePosixPath:
    """Where an entry would lie.

    Raises:
        RunError: if that is outside, or it is neither a file nor a folder.
    """
    shown = printable(path[:80])
    if not is_usual:
        raise RunError(
            f"{name} holds {shown!r}, which is a link or device; it is not unpacked. Pack the "
            "files themselves."
        )
    parts = path.removesuffix("/").split("/")
    is_plain = (
        len(path) <= _MAX_PATH_CHARS
        and len(parts) <= _MAX_DEPTH
        and all(_is_plain(part) for part in parts)
    )
    if not is_plain and path != ".":
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


def _write(source: IO[bytes], size: int, path: Path) -> int:
    """Checksum of what was written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    left, check = size, 0
    with path.open("xb") as target:
        while block := source.read(min(1 << 20, left + 1)):
            left -= len(block)
            if left < 0:
                raise zipfile.BadZipFile("more than it says")
            check = zlib.crc32(block, check)
            target.write(block)
        if left:
            raise zipfile.BadZipFile("less than it says")
    return check


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"
