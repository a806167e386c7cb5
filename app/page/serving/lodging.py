"""Every byte that visitors leave, in one folder of this process: bounded, and gone after a while.

A process that is killed leaves its folder behind; the next one to start removes it. Uploads and
copies for download lie in ``gradio``, the folders of runs in ``jobs``, researchers' parts in
``private``.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
import stat
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol

from app import text
from app.errors import RunError

SWEEP_EVERY_S = 60.0
_LOCK = ".lock"
_held: list[Any] = []
"""Open lock files, for as long as the process lives."""


class Bounds(Protocol):
    """What a lodging allows, as `app.config.AppConfig` has it."""

    @property
    def temp(self) -> Path: ...
    @property
    def keep_results_s(self) -> float: ...
    @property
    def max_kept_bytes(self) -> int: ...
    @property
    def max_kept_bytes_each(self) -> int: ...
    @property
    def min_free_bytes(self) -> int: ...


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


class Lodging:
    """What all visitors have left here. Safe to use from several threads."""

    def __init__(self, bounds: Bounds) -> None:
        self._bounds = bounds
        self.root = bounds.temp
        self._lock = threading.Lock()
        self._left: dict[str, deque[tuple[float, int]]] = defaultdict(deque)
        """By address: when how many bytes came."""

    def admit(self, address: str, num_bytes: int = 0) -> None:
        """See that there is room for so many bytes more.

        Raises:
            RunError: if there is none, for this visitor or for anyone.
        """
        each, whole = self._bounds.max_kept_bytes_each, self._bounds.max_kept_bytes
        if self._left_by(address) + num_bytes > each:
            raise RunError(text.TOO_MUCH_KEPT.format(limit=each / 1e9, minutes=self._minutes))
        free = shutil.disk_usage(self.root).free
        if free < self._bounds.min_free_bytes + num_bytes or self.size() + num_bytes > whole:
            raise RunError(text.DISK_FULL)

    def charge(self, address: str, num_bytes: int) -> None:
        """Remember what a visitor has left."""
        with self._lock:
            self._left[address].append((time.time(), num_bytes))

    def size(self) -> int:
        """All that is there, in bytes."""
        return size_of(self.root)

    def uploads_of(self, values: Iterable[Any]) -> list[Path]:
        """The uploads among a form's values."""
        cache = self.root / "gradio"
        found: list[Path] = []
        for value in values:
            if isinstance(value, list):
                found += self.uploads_of(value)
            elif isinstance(value, str) and value.startswith(f"{cache}{os.sep}"):
                found.append(Path(value))
        return found

    def touch(self, uploads: Iterable[Path]) -> None:
        """Keep them as if they had come now."""
        for upload in uploads:
            try:
                os.utime(upload)
            except (OSError, ValueError):
                continue  # a reader says that it is gone

    def sweep(self, in_use: Iterable[Path] = ()) -> None:
        """Delete what was last touched longer ago than it is kept, but for what is in use."""
        before = time.time() - self._bounds.keep_results_s
        kept = set(in_use)
        for folder in _entries(self.root / "jobs"):
            if folder not in kept and _last_touched(folder) < before:
                shutil.rmtree(folder, ignore_errors=True)
        for file in sorted(_below(self.root / "gradio"), reverse=True):
            if file.is_dir() and not file.is_symlink():
                _remove_empty(file, before)
            elif file not in kept and _last_touched(file) < before:
                file.unlink(missing_ok=True)
        with self._lock:
            for address, left in list(self._left.items()):
                while left and left[0][0] < before:
                    left.popleft()
                if not left:
                    del self._left[address]

    def keep_swept(self, in_use: Callable[[], Iterable[Path]]) -> None:
        """Sweep now and then for as long as the process lives."""
        every_s = min(SWEEP_EVERY_S, self._bounds.keep_results_s / 4)

        def sweep_for_ever() -> None:
            while True:
                self.sweep(in_use())
                time.sleep(every_s)

        threading.Thread(target=sweep_for_ever, name="sweep", daemon=True).start()

    @property
    def _minutes(self) -> int:
        return round(self._bounds.keep_results_s / 60)

    def _left_by(self, address: str) -> int:
        since = time.time() - self._bounds.keep_results_s
        with self._lock:
            return sum(size for at, size in self._left.get(address, ()) if at >= since)


def size_of(folder: Path) -> int:
    """Bytes of all files in it; one that has several names counts once."""
    sizes: dict[int, int] = {}
    for path in _below(folder):
        try:
            found = path.lstat()
        except OSError:
            continue  # swept meanwhile
        if stat.S_ISREG(found.st_mode):
            sizes[found.st_ino] = found.st_size
    return sum(sizes.values())


def _below(folder: Path) -> Iterator[Path]:
    """All files and folders in it; what goes meanwhile is passed over, where `rglob` fails."""
    for parent, folders, files in os.walk(folder):
        yield from (Path(parent, name) for name in (*folders, *files))


def _entries(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if folder.is_dir() else []


def _last_touched(path: Path) -> float:
    """What is gone already was touched in no time to come."""
    try:
        return path.lstat().st_mtime
    except OSError:
        return float("inf")


def _remove_empty(folder: Path, before: float) -> None:
    if _last_touched(folder) < before:
        try:
            folder.rmdir()
        except OSError:
            return  # something is in it
