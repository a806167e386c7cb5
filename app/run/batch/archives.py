"""Safe extraction of untrusted zip and tar archives of result sets.

All names, sizes and counts are checked against limits before anything is written. Then the files
are written one by one, never over another, and never more than the stated size. Archives within an
archive are extracted as well, within the remaining limits.
"""

from __future__ import annotations

import gzip
import lzma
import os
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import IO, cast

from app.errors import DiskFullError, RunError, disk_full_sentence, is_disk_full
from app.run.batch.pairing import is_hidden
from app.run.output.result_folder import require_free_space
from app.run.upload_check import ARCHIVE_SUFFIXES
from conventions.names import printable, safe_file_stem
from model.storage.files import ZipDirectoryTooLargeError, open_limited_zip, write_error
from model.storage.npz import MAX_FILE_BYTES

TARS = ARCHIVE_SUFFIXES[1:]
UNPACKED = "unpacked"
"""Folder of the results with a visitor's unpacked sets."""
_MAX_NESTED = 2
"""Maximum depth of archives in archives."""
_MAX_HEADER_BYTES = 1 << 20
"""Maximum size (bytes) of a header of a tar, which is held in memory."""
_MAX_NAME_BYTES, _MAX_PATH_CHARS, _MAX_DEPTH = 200, 1000, 16
_BYTES_AN_ENTRY = 1024
"""Maximum size (bytes) of an entry in a zip's directory; usual entries have a tenth."""
_DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError),
    *(RuntimeError, UnicodeDecodeError, struct.error, ValueError, tarfile.TarError),
)


@dataclass
class UnpackBudget:
    """Budget of one or several extractions, reduced by what has been extracted."""

    max_files: int = 10_000
    """Maximum number of files, ignored ones included."""
    max_total_bytes: int = 20 * 2**30
    max_file_bytes: int = MAX_FILE_BYTES
    min_free_bytes: int = 0
    """Disk space (bytes) that stays free."""


def unpack_archives(
    inputs: Sequence[tuple[Path, tuple[str, ...]]],
    target: Path,
    shared_limits: UnpackBudget | None = None,
) -> dict[Path, Path]:
    """Extract the archives among some inputs into ``target``, and return their folders by archive.

    Args:
        inputs: archives, and other files and folders, which are skipped, each with the suffixes of
            the required files.
        shared_limits: limits of all archives; by default each has its own.

    Raises:
        RunError: as `unpack_archive`.
    """
    folders: dict[Path, Path] = {}
    for path, endings in inputs:
        if is_archive(path) and path not in folders:
            folder = target / str(len(folders)) / safe_file_stem(archive_stem(path))
            folder.mkdir(parents=True)
            unpack_archive(path, folder, endings, shared_limits)
            folders[path] = folder
    return folders


def is_archive(path: Path) -> bool:
    """Check whether a path is named like an archive, and is not a folder."""
    return _ending_of(path.name) is not None and not path.is_dir()


def archive_stem(path: Path) -> str:
    """Return the name of a file without the suffix of an archive."""
    return path.name[: -len(_ending_of(path.name) or "")] if is_archive(path) else path.stem


def _ending_of(name: str) -> str | None:
    return next((each for each in ARCHIVE_SUFFIXES if name.lower().endswith(each)), None)


def unpack_archive(
    archive: Path,
    folder: Path,
    endings: Sequence[str],
    limits: UnpackBudget | None = None,
    is_selected: Callable[[str], bool] | None = None,
) -> int:
    """Extract the files with some suffixes from an untrusted archive into an empty folder.

    Their modification times are checksums of their content: the same file always gets the same.

    Args:
        limits: limits of extraction; by default those of a set on the command line.
        is_selected: selects paths in the archive, without nested archives; by default all.

    Returns:
        The number of files.

    Raises:
        RunError: if the archive is unreadable, contains links, unsafe names, a name twice, no
            required file, or more than the limits. Files extracted until then may remain.
    """
    count = _Archive(archive, endings, limits or UnpackBudget(), is_selected).unpack(folder)
    if not count and is_selected is None:
        raise RunError(
            f"{printable(archive.name)} contains no supported files ({', '.join(endings)})."
        )
    return count


@dataclass(frozen=True)
class _Entry:
    """File or folder of an archive."""

    path: PurePosixPath
    size: int
    is_folder: bool
    open_file: Callable[[], IO[bytes] | None]


class _Archive:
    """Archive that is being extracted."""

    def __init__(
        self,
        path: Path,
        endings: Sequence[str],
        limits: UnpackBudget,
        is_selected: Callable[[str], bool] | None = None,
        depth: int = 0,
    ) -> None:
        self._path, self._endings, self._limits, self._depth = path, endings, limits, depth
        self._is_selected = is_selected
        self._name = printable(path.name)

    def unpack(self, folder: Path) -> int:
        """Extract the required files, nested archives included, and return their number."""
        name, noun = self._name, "tar" if _ending_of(self._path.name) in TARS else "zip"
        try:
            with self._tar() if noun == "tar" else self._zip() as entries:
                wanted = self._wanted(entries)
                needed_bytes = sum(entry.size for entry in wanted)
                require_free_space(folder, needed_bytes + self._limits.min_free_bytes)
                for entry in wanted:
                    source = entry.open_file()
                    assert source is not None
                    with source:
                        check = _write(source, entry.size, folder / entry.path)
                    os.utime(folder / entry.path, (check, check))
        except RunError:
            raise
        except FileExistsError as error:
            raise RunError(
                f"{name} contains two files with the same name and was not extracted; rename one."
            ) from error
        except OSError as error:
            if is_disk_full(error):
                raise DiskFullError(disk_full_sentence(folder)) from error
            if error.filename is not None and Path(error.filename) != self._path:
                raise write_error(Path(error.filename), error) from error
            if isinstance(error, gzip.BadGzipFile):
                raise RunError(f"{name} is not a readable {noun}; pack it again.") from error
            raise RunError(f"{name} cannot be read: {error.strerror or error}.") from error
        except _DAMAGED as error:
            raise RunError(
                f"{name} is not a readable {noun}; pack it again, without a password."
            ) from error
        within = [folder / entry.path for entry in wanted if _ending_of(entry.path.name)]
        return len(wanted) - len(within) + sum(map(self._unpack_within, within))

    def _unpack_within(self, path: Path) -> int:
        depth = self._depth + 1
        if depth > _MAX_NESTED:
            raise RunError(
                f"{self._name} contains {path.name!r}, an archive nested {depth} levels deep; at "
                f"most {_MAX_NESTED} levels are unpacked. Pack the files without inner archives."
            )
        into = path.with_name(archive_stem(path) or "set")
        if into.is_file():
            raise RunError(
                f"{self._name} contains two files with the same name and was not extracted; "
                "rename one."
            )
        into.mkdir(exist_ok=True)
        count = _Archive(path, self._endings, self._limits, None, depth).unpack(into)
        path.unlink()
        return count

    @contextmanager
    def _zip(self) -> Iterator[list[_Entry]]:
        """List the entries of a zip; backslashes of Windows are converted."""
        most = self._limits.max_files
        try:
            with open_limited_zip(self._path, _BYTES_AN_ENTRY * most) as opened:
                yield [
                    _Entry(
                        self._checked(
                            entry.filename.replace("\\", "/"),
                            stat.S_IFMT(entry.external_attr >> 16) in _FILE_KINDS,
                        ),
                        entry.file_size,
                        entry.filename.endswith(("/", "\\")),
                        partial(opened.open, entry),
                    )
                    for entry in opened.infolist()
                ]
        except ZipDirectoryTooLargeError:
            raise RunError(
                f"{self._name} contains too many files; the limit is {most}. Split the archive."
            ) from None

    @contextmanager
    def _tar(self) -> Iterator[list[_Entry]]:
        is_plain = self._path.name.lower().endswith(".tar")
        with self._path.open("rb") if is_plain else gzip.open(self._path) as file:
            capped = _CappedStream(cast(IO[bytes], file), self._name, self._limits)
            with tarfile.open(fileobj=cast(IO[bytes], capped), mode="r:") as opened:
                entries: list[_Entry] = []
                for member in islice(opened, self._limits.max_files + 1):
                    if member.size < 0:
                        raise tarfile.ReadError("negative file size")
                    is_usual = member.isdir() or (member.isreg() and not member.issparse())
                    path = self._checked(member.name.removeprefix("./") or ".", is_usual)
                    opening = partial(opened.extractfile, member)
                    entries.append(_Entry(path, member.size, member.isdir(), opening))
                yield entries

    def _wanted(self, entries: list[_Entry]) -> list[_Entry]:
        """Return the entries of required files, and subtract their sizes from the limits."""
        name, left = self._name, self._limits
        if len(entries) > left.max_files:
            raise RunError(
                f"{name} contains {len(entries)} files; the limit is {left.max_files}. Split the "
                "archive."
            )
        wanted: dict[PurePosixPath, _Entry] = {}
        for entry in entries:
            path, is_nested = entry.path, _ending_of(entry.path.name) is not None
            is_wanted = path.suffix.lower() in self._endings or is_nested
            if self._is_selected is not None:
                is_wanted = not is_nested and is_wanted and self._is_selected(path.as_posix())
            if entry.is_folder or not is_wanted or is_hidden(path):
                continue
            if path in wanted:
                raise RunError(
                    f"{name} contains {str(path)!r} twice and was not extracted; remove one."
                )
            if entry.size > left.max_file_bytes and not is_nested:
                raise RunError(
                    f"The file {str(path)!r} in {name} is {_mib(entry.size)}; the limit for a "
                    f"file is {_mib(left.max_file_bytes)}."
                )
            wanted[path] = entry
        total = sum(entry.size for entry in wanted.values())
        if total > left.max_total_bytes:
            raise RunError(
                f"The files in {name} take {_mib(total)} in total; the limit is "
                f"{_mib(left.max_total_bytes)}. Split the archive."
            )
        left.max_files -= len(entries)
        left.max_total_bytes -= total
        return list(wanted.values())

    def _checked(self, path: str, is_usual: bool) -> PurePosixPath:
        """Return the path of an entry; raises RunError if it is unsafe, or no file or folder."""
        shown = printable(path[:80])
        if not is_usual:
            raise RunError(
                f"{self._name} was not extracted, because {shown!r} in it is a link or device. "
                "Pack the files themselves."
            )
        parts = path.removesuffix("/").split("/")
        is_plain = (
            len(path) <= _MAX_PATH_CHARS
            and len(parts) <= _MAX_DEPTH
            and all(_is_plain(part) for part in parts)
        )
        if not is_plain and path != ".":
            raise RunError(
                f"{self._name} contains {shown!r}, an unsafe path. The archive was not extracted; "
                "rename the file and pack it again."
            )
        return PurePosixPath(*parts)


class _CappedStream:
    """Stream that cannot be read beyond the limits of a tar, nor in large pieces."""

    def __init__(self, file: IO[bytes], name: str, limits: UnpackBudget) -> None:
        self._file, self._name = file, name
        self._most = limits.max_total_bytes + limits.max_files * _BYTES_AN_ENTRY

    def read(self, size: int = -1) -> bytes:
        if not 0 <= size <= _MAX_HEADER_BYTES + tarfile.BLOCKSIZE:
            raise tarfile.ReadError("unusual header size")
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
                f"The files in {self._name} exceed the limit of {_mib(self._most)} in total. "
                "Split the archive."
            )


_FILE_KINDS = (0, stat.S_IFREG, stat.S_IFDIR)


def _is_plain(part: str) -> bool:
    return (
        part not in ("", ".", "..")
        and part.isprintable()
        and not set(part) & set('\\:*?"<>|')
        and len(part.encode()) <= _MAX_NAME_BYTES
    )


def _write(source: IO[bytes], size: int, path: Path) -> int:
    """Write a file, and return the CRC-32 checksum of its content."""
    path.parent.mkdir(parents=True, exist_ok=True)
    left, check = size, 0
    with path.open("xb") as target:
        while block := source.read(min(1 << 20, left + 1)):
            left -= len(block)
            if left < 0:
                raise zipfile.BadZipFile("a file is longer than its stated size")
            check = zlib.crc32(block, check)
            target.write(block)
        if left:
            raise zipfile.BadZipFile("a file is shorter than its stated size")
    return check


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"
