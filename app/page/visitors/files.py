"""Every byte that visitors leave, in one folder of this process, and gone after a while.

A process that is killed leaves its folder behind; the next one to start removes it. Uploads and
copies for download lie in ``gradio``, the folders of runs in ``jobs``, researchers' parts in
``private``.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

SWEEP_EVERY_S = 60.0
_LOCK = ".lock"
_held: list[Any] = []
"""Open lock files, for as long as the process lives."""


def claim_folder(parent: Path) -> Path:
    """A new folder of this process in ``parent``; what ended processes left there is removed."""
    parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    parent.chmod(0o700)
    with (parent / _LOCK).open("w") as gate:
        fcntl.flock(gate, fcntl.LOCK_EX)
        for other in parent.iterdir():
            if other.is_dir() and not _is_held(other / _LOCK):
                shutil.rmtree(other, ignore_errors=True)
        folder = parent / secrets.token_hex(8)
        folder.mkdir(mode=0o700)
        lock = (folder / _LOCK).open("w")
        fcntl.flock(lock, fcntl.LOCK_EX)
        _held.append(lock)
    return folder


def _is_held(lock: Path) -> bool:
    try:
        with lock.open("r+") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def uploads_of(values: Iterable[Any], cache: Path) -> list[Path]:
    """The folders in which Gradio keeps the uploads among a form's values, each its own."""
    found: list[Path] = []
    for value in values:
        if isinstance(value, list):
            found += uploads_of(value, cache)
        elif isinstance(value, str) and value.startswith(f"{cache}{os.sep}"):
            found += [cache / part for part in Path(value).relative_to(cache).parts[:1]]
    return found


def touch(folders: Iterable[Path]) -> None:
    """Keep them as if they had come now."""
    for folder in folders:
        with suppress(OSError, ValueError):  # a reader says that it is gone
            os.utime(folder)


def sweep(root: Path, keep_s: float, in_use: Iterable[Path] = ()) -> None:
    """Delete what was last touched longer ago than it is kept, but for what is in use."""
    before, kept = time.time() - keep_s, set(in_use)
    for entry in (each for part in ("jobs", "private", "gradio") for each in _entries(root / part)):
        if entry not in kept and _last_touched(entry) < before:
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink(missing_ok=True)


def keep_swept(root: Path, keep_s: float, in_use: Callable[[], Iterable[Path]]) -> None:
    """Sweep now and then for as long as the process lives."""
    every_s = min(SWEEP_EVERY_S, keep_s / 4)

    def sweep_for_ever() -> None:
        while True:
            sweep(root, keep_s, in_use())
            time.sleep(every_s)

    threading.Thread(target=sweep_for_ever, name="sweep", daemon=True).start()


def _entries(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if folder.is_dir() else []


def _last_touched(path: Path) -> float:
    """What is gone already was touched in no time to come."""
    try:
        return path.lstat().st_mtime
    except OSError:
        return float("inf")
