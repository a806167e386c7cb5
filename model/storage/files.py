"""Atomic writing and size-limited reading of files, with error messages for the user."""

import errno
import hashlib
import io
import json
import math
import os
import re
import secrets
import tomllib
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any


class WriteError(OSError):
    """A file that could not be written; the message is one sentence for the user.

    ``errno`` is that of the cause, also after transfer from another process.
    """

    def __init__(self, sentence: str, errno: int | None = None) -> None:
        super().__init__(sentence)
        self.errno = errno

    def __reduce__(self) -> tuple[type["WriteError"], tuple[str, int | None]]:
        return type(self), (str(self), self.errno)


_REASONS = {
    errno.ENOSPC: "the disk is full; free some space or choose another folder",
    errno.EDQUOT: "your disk quota is used up; free some space or choose another folder",
    errno.EFBIG: "it would exceed the largest file size allowed here",
    errno.EACCES: "permission denied; choose a folder you may write to",
    errno.EPERM: "permission denied; choose a folder you may write to",
    errno.EROFS: "the disk is read-only; choose another folder",
    errno.ENOENT: "its folder does not exist; create it first",
    errno.ENOTDIR: "part of its path is a file, not a folder; choose another folder",
    errno.EISDIR: "a folder has that name; choose another name",
    errno.EEXIST: "a file has that name; choose another name",
}


def write_error(path: Path, error: OSError) -> WriteError:
    """Make the error that says why ``path`` could not be written and what to do."""
    reason = _REASONS.get(error.errno or 0, error.strerror or str(error))
    return WriteError(f"{path} could not be written: {reason}.", error.errno)


@contextmanager
def written_atomically(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder that becomes ``path`` if the block succeeds.

    If the block raises, the temporary file is removed and an older ``path`` is unchanged. Raises
    WriteError in place of any other `OSError`, with the reason in one sentence.
    """
    path = Path(path)
    temporary = path.with_name(f".{secrets.token_hex(6)}.part{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except WriteError:
        raise
    except OSError as error:
        raise write_error(path, error) from error
    finally:
        try:
            temporary.unlink(missing_ok=True)
        except OSError:  # an unreachable folder, which the error above already names
            pass


def write_atomically(path: str | Path, content: str | bytes) -> None:
    """Write a file atomically, text in UTF-8 as it is; raises WriteError."""
    with written_atomically(path) as part:
        part.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


def read_within_limit(path: Path, max_bytes: int, error: type[ValueError]) -> bytes:
    """Read a file's content; raises ``error`` with one sentence if it is missing or too large."""
    if path.exists() and not path.is_file():  # a pipe would never end, nor a device
        raise error(f"{path.name} could not be read: it is not a regular file.")
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as cause:
        reason = (cause.strerror or str(cause)).lower()
        raise error(f"{path.name} could not be read: {reason}.") from cause
    if len(data) > max_bytes:
        limit = f"{max_bytes // 2**20} MiB" if max_bytes >= 2**20 else f"{max_bytes // 1000} kB"
        raise error(f"{path.name} is larger than the limit of {limit}.")
    return data


MAX_KEY_PARTS = 32
_STRINGS_AND_COMMENTS = re.compile(
    r'''"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5})?|"(?:[^"\\\n]|\\.)*+"?|#[^\n]*'''
    r"""|'''(?:[^']|'(?!''))*+(?:'{3,5})?|'[^'\n]*+'?""",
    re.DOTALL,
)
_TOO_MANY_PARTS = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{MAX_KEY_PARTS}}}")


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML that JSON can hold; raises `ValueError` with the reason.

    `tomllib` keeps every prefix of a dotted key: one of 50,000 parts (100 kB) takes 10 GB.
    """
    if _TOO_MANY_PARTS.search(_STRINGS_AND_COMMENTS.sub("s", text)):
        raise ValueError(f"a key has more than {MAX_KEY_PARTS} parts")
    try:
        document = tomllib.loads(text)
        json.dumps(document, default=str)
        return document
    except RecursionError as error:
        raise ValueError("tables or arrays are nested too deeply") from error


def file_sha256(path: Path) -> str:
    """Compute the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


FileStamps = tuple[tuple[str, int, int], ...]
"""Path, size and time of change of files: a key by which a cache sees that one was replaced."""


def file_stamps(paths: Iterable[Path]) -> FileStamps:
    """Return the stamps of the files that exist among ``paths``, in the order of their paths."""
    stamps = []
    for path in sorted(paths):
        with suppress(OSError):  # it may be replaced meanwhile
            state = path.stat()
            stamps.append((str(path), state.st_size, state.st_mtime_ns))
    return tuple(stamps)


class ZipDirectoryTooLargeError(zipfile.BadZipFile):
    """A zip with a central directory longer than its reader allows."""


class _LimitedReader(io.BufferedReader):
    max_read: float = math.inf

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > self.max_read:
            raise ZipDirectoryTooLargeError(f"the zip's directory is too large ({size} bytes)")
        return super().read(size)


@contextmanager
def open_limited_zip(path: Path, max_directory_bytes: int) -> Iterator[zipfile.ZipFile]:
    """Open a zip; its directory, which `zipfile` reads whole and at once, is of limited length.

    Raises ZipDirectoryTooLargeError if it is longer, having read nothing of it; else as
    `zipfile.ZipFile`.
    """
    with path.open("rb", buffering=0) as raw, _LimitedReader(raw) as file:
        file.max_read = max_directory_bytes
        with zipfile.ZipFile(file) as archive:
            file.max_read = math.inf
            yield archive
