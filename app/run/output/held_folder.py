"""One command at a time in a folder of results: who comes second is told who is at work.

The system lets go of a lock when its owner ends, however that was, so that what a killed run left
is no obstacle.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import platform
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import IO

from app.errors import RunError

LOCK_NAME = ".at-work"
_MAX_COMMAND = 200
_NO_LOCKS = {errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL}
"""Of disks that know no locks; there nobody can be told of."""


@contextmanager
def held_folder(folder: Path) -> Iterator[None]:
    """Make the folder where there is none, and keep other commands out of it for the block.

    A folder that was made here and is empty in the end is removed.

    Raises:
        RunError: if another command is at work there, or the folder cannot be written to.
    """
    if folder.exists() and not folder.is_dir():
        raise RunError(f"{folder} is a file; name a folder for the results.")
    was_there = folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = _lock(folder / LOCK_NAME)
    except OSError as error:
        if not was_there:
            _remove_if_empty(folder)
        reason = (error.strerror or type(error).__name__).lower()
        raise RunError(
            f"The folder {folder} cannot be written to ({reason}); choose another."
        ) from error
    try:
        yield
    finally:
        with lock:
            try:
                (folder / LOCK_NAME).unlink(missing_ok=True)
            except OSError:
                pass  # a file that nobody holds is no obstacle
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
            f"Another command is at work in {folder}: process {facts['pid']} on {facts['host']}, "
            f"since {facts['since']}, `{facts['command']}`; {end}"
        )
    except (OSError, ValueError, KeyError, TypeError):  # it has just begun
        return f"Another command is at work in {folder}; {end}"


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError:
        pass  # someone has put something there
