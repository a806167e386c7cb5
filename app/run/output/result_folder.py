"""Folder or zip of results that is published atomically, and locked for one command at a time.

The operating system releases a lock when its owner ends, however that happens, so a killed run does
not block later ones.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import platform
import secrets
import shlex
import shutil
import sys
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import IO

from app.errors import DiskFullError, RunError, disk_full_sentence, is_disk_full

LOCK_NAME = ".at-work"
_MAX_COMMAND = 200
_NO_LOCKS = {errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL}
"""Error numbers of file systems without locks, where other commands cannot be detected."""


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock a folder for the block, creating it if needed.

    A folder that was created here and is empty in the end is removed. Raises RunError if another
    command has locked it, or if it cannot be written to.
    """
    if folder.exists() and not folder.is_dir():
        raise RunError(f"{folder} is a file; give a folder for the results.")
    was_there = folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = _lock(folder / LOCK_NAME)
    except OSError as error:
        if not was_there:
            _remove_if_empty(folder)
        raise _unwritable(folder, error) from error
    try:
        yield
    finally:
        with lock:
            try:
                (folder / LOCK_NAME).unlink(missing_ok=True)
            except OSError:
                pass  # an unlocked file does not block other commands
        if not was_there:
            _remove_if_empty(folder)


def _lock(path: Path) -> IO[str]:
    while True:
        file = path.open("a+", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            with file:
                raise RunError(_who(path.parent, file)) from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                file.close()
                raise
        if _is_same(path, file):
            break
        file.close()  # its owner has just removed it
    command = shlex.join(sys.orig_argv)[:_MAX_COMMAND]
    facts = {
        "pid": os.getpid(),
        "host": platform.node(),
        "since": datetime.now().astimezone().isoformat(" ", "seconds"),
        "command": command,
    }
    file.truncate(0)
    file.write(json.dumps(facts) + "\n")
    file.flush()
    return file


def _is_same(path: Path, file: IO[str]) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def _who(folder: Path, file: IO[str]) -> str:
    end = "wait until it has ended, stop it, or choose another folder."
    try:
        file.seek(0)
        facts = json.loads(file.read(10_000))
        return (
            f"Another command is already writing to {folder}: process {facts['pid']} on "
            f"{facts['host']}, since {facts['since']}, `{facts['command']}`; {end}"
        )
    except (OSError, ValueError, KeyError, TypeError):  # the other command has just started
        return f"Another command is already writing to {folder}; {end}"


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError:
        pass  # it is not empty


UNFINISHED = ".unfinished-"
"""Prefix of staging folders, which are removed if a killed run left them."""
_ALREADY_SMALL = {".mp4", ".png", ".npz", ".pdf", ".glb"}
_NO_TIME = (2000, 1, 1, 0, 0, 0)


class ResultFolder:
    """Staging folder for results, which are moved to their final folder when all are complete.

    Files of an earlier run with the same names are replaced only then; an interrupted run removes
    its files, and the folder too if it created it. The folder is locked meanwhile. A disk that
    becomes full raises `DiskFullError`.

    Example:
        >>> import tempfile
        >>> temp = tempfile.TemporaryDirectory()
        >>> with ResultFolder(Path(temp.name) / "run") as folder:
        ...     _ = folder.new_path("notes.txt").write_text("two motions")
        ...     [path] = folder.publish()
        >>> path.parent.name, path.read_text()
        ('run', 'two motions')
        >>> temp.cleanup()
    """

    def __init__(self, out: Path, *, is_incremental: bool = False) -> None:
        """Prepare the staging folder of a run.

        If incremental, each file is published as soon as it is complete and kept if the run fails;
        by default all files are published at the end, or none.
        """
        self.out = out
        self.is_incremental = is_incremental
        self._names: list[str] = []
        self._held = lock_folder(out)
        self._staging = out / f"{UNFINISHED}{os.getpid()}-{secrets.token_hex(4)}"

    def __enter__(self) -> ResultFolder:
        self._held.__enter__()
        try:
            for left in self.out.glob(f"{UNFINISHED}*"):  # of killed runs: this one has the lock
                shutil.rmtree(left, ignore_errors=True)
            self._staging.mkdir(mode=0o700)
        except OSError as error:
            self._held.__exit__(None, None, None)
            raise _unwritable(self.out, error) from error
        return self

    def new_path(self, name: str, *, grows: bool = False) -> Path:
        """Register the result ``name`` to be published, and return the path to write it at.

        ``grows`` says whether the file is useful before it is complete.
        """
        if name not in self._names:
            self._names.append(name)
        path = (self.out if grows and self.is_incremental else self._staging) / name
        path.parent.mkdir(exist_ok=True)
        return path

    def mark_complete(self, path: Path) -> str:
        """Mark a file written at `new_path` as complete, and return its name."""
        below = self._staging if path.is_relative_to(self._staging) else self.out
        name = path.relative_to(below).as_posix()
        if self.is_incremental and below == self._staging:
            self._move(name)
        return name

    def current_path(self, name: str) -> Path:
        """Return the current path of a written file."""
        path = self._staging / name
        return path if path.exists() else self.out / name

    def _move(self, name: str) -> None:
        (self.out / name).parent.mkdir(exist_ok=True)
        os.replace(self._staging / name, self.out / name)

    def scratch(self, name: str) -> Path:
        """Return a path for a temporary file of the run."""
        return self._staging / f".{name}"

    def publish(self) -> tuple[Path, ...]:
        """Move every file to its final path, and return these paths."""
        for name in self._names:
            if not self.is_incremental or (self._staging / name).exists():
                self._move(name)
        return tuple(self.out / name for name in self._names)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        shutil.rmtree(self._staging, ignore_errors=True)
        self._held.__exit__(None, None, None)
        if is_disk_full(error) and not isinstance(error, RunError):
            raise DiskFullError(disk_full_sentence(self.out)) from error


def zip_files(
    files: Iterable[Path],
    out: Path,
    relative_to: Path | None = None,
    *,
    keeps_metadata: bool = True,
) -> Path:
    """Write files into a zip atomically.

    Names in the zip are relative to ``relative_to``; without it, all files are in one folder with
    the name of the zip. Modification times and permissions are kept on request.
    """
    partial = out.with_name(f".{out.name}.partial")
    try:
        with zipfile.ZipFile(partial, "w") as archive:
            for file in files:
                name = file.relative_to(relative_to) if relative_to else Path(out.stem, file.name)
                info = zipfile.ZipInfo.from_file(file, name.as_posix())
                if not keeps_metadata:
                    info.date_time, info.external_attr = _NO_TIME, 0o644 << 16
                is_small = file.suffix in _ALREADY_SMALL
                info.compress_type = zipfile.ZIP_STORED if is_small else zipfile.ZIP_DEFLATED
                with file.open("rb") as source, archive.open(info, "w", force_zip64=True) as target:
                    shutil.copyfileobj(source, target, 1 << 20)
        os.replace(partial, out)
    finally:
        partial.unlink(missing_ok=True)
    return out


def zip_folder(folder: Path, out: Path) -> Path:
    """Zip all files of a folder under its name, without times and in order of their names."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return zip_files(files, out, relative_to=folder.parent, keeps_metadata=False)


def require_free_space(folder: Path, needed_bytes: int) -> None:
    """Check that the disk has space for a run; raises DiskFullError with free and needed space."""
    free_bytes = shutil.disk_usage(folder).free
    if free_bytes < needed_bytes:
        raise DiskFullError(
            f"The disk at {folder} has {free_bytes / 1e6:.0f} MB free and this run needs about "
            f"{needed_bytes / 1e6:.0f} MB; free some space or write to another folder."
        )


def _unwritable(folder: Path, error: OSError) -> RunError:
    reason = (error.strerror or type(error).__name__).lower()
    return RunError(f"The folder {folder} cannot be written to ({reason}); choose another.")
