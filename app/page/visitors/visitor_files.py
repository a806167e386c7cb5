"""Every byte that visitors leave, in one folder of this process: bounded, and gone after a while.

A process that is killed leaves its folder behind; the next one to start removes it. Uploads and
copies for download lie in ``gradio``, the folders of runs in ``jobs``, researchers' parts in
``private``.

Whether there is room is asked while others wait, so it is read off running totals: what came is
added at once, and the sweep, in a thread of its own, counts now and then what is really there.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from app import text
from app.errors import RunError

SWEEP_EVERY_S = 60.0
LEAST_BYTES = 4096
"""What a file takes of a disk at least, however little is in it."""
_SPANS = 60
"""What an address has left is remembered by so many spans of the time for which it is kept."""
_LOCK = ".lock"
_held: list[Any] = []
"""Open lock files, for as long as the process lives."""


class Bounds(Protocol):
    """What visitors may leave, as `app.config.AppConfig` has it."""

    @property
    def temp(self) -> Path: ...
    @property
    def keep_results_s(self) -> float: ...
    @property
    def max_kept_bytes(self) -> int: ...
    @property
    def max_kept_bytes_each(self) -> int: ...
    @property
    def max_kept_files(self) -> int: ...
    @property
    def max_kept_files_each(self) -> int: ...
    @property
    def min_free_bytes(self) -> int: ...


@dataclass
class Room:
    """Bytes and files, taken or asked for."""

    num_bytes: int = 0
    num_files: int = 0

    def add(self, other: Room, sign: int = 1) -> None:
        self.num_bytes += sign * other.num_bytes
        self.num_files += sign * other.num_files


class _Left:
    """What one address has left in the time for which it is kept: a running total."""

    def __init__(self, keep_s: float) -> None:
        self._keep_s = keep_s
        self._spans: deque[tuple[float, Room]] = deque()
        self.total = Room()

    def add(self, room: Room) -> None:
        now = time.time()
        if not self._spans or now - self._spans[-1][0] > self._keep_s / _SPANS:
            self._spans.append((now, Room()))
        self._spans[-1][1].add(room)
        self.total.add(room)

    def forget_old(self) -> None:
        before = time.time() - self._keep_s
        while self._spans and self._spans[0][0] < before:
            self.total.add(self._spans.popleft()[1], sign=-1)


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


class VisitorFiles:
    """What all visitors have left here. Safe to use from several threads; only `sweep` and what
    comes with it looks at the disk for long."""

    def __init__(self, bounds: Bounds) -> None:
        self._bounds = bounds
        self.root = bounds.temp
        self._lock = threading.Lock()
        self._left: dict[str, _Left] = {}
        """By address."""
        self._found = Room()
        """By the last count."""
        self._come = Room()
        """Since that began, as far as is known: a broken-off upload counts until the next one."""
        self._is_closed = False

    def admit(self, address: str, num_bytes: int = 0, num_files: int = 0) -> None:
        """See that there is room for so much more.

        Raises:
            RunError: if there is none, for this visitor or for anyone, or if the page is closing.
        """
        bounds = self._bounds
        asked = Room(num_bytes + LEAST_BYTES * num_files, num_files)
        with self._lock:
            asked_of_each, asked_of_all = replace(asked), replace(asked)
            left = self._left.get(address)
            if left is not None:
                left.forget_old()
                asked_of_each.add(left.total)
            asked_of_all.add(self._found)
            asked_of_all.add(self._come)
        if self._is_closed:
            raise RunError(text.CLOSING)
        if asked_of_each.num_bytes > bounds.max_kept_bytes_each:
            limit = bounds.max_kept_bytes_each / 1e9
            raise RunError(text.TOO_MUCH_KEPT.format(limit=limit, minutes=self._minutes))
        if asked_of_each.num_files > bounds.max_kept_files_each:
            limit = bounds.max_kept_files_each
            raise RunError(text.TOO_MANY_KEPT.format(limit=limit, minutes=self._minutes))
        is_full = (
            asked_of_all.num_bytes > bounds.max_kept_bytes
            or asked_of_all.num_files > bounds.max_kept_files
            or shutil.disk_usage(self.root).free < bounds.min_free_bytes + asked.num_bytes
        )
        if is_full:
            raise RunError(text.DISK_FULL)

    def charge(self, address: str, num_bytes: int, num_files: int = 0) -> None:
        """Remember what a visitor has left; a file counts `LEAST_BYTES` beside its content."""
        room = Room(num_bytes + LEAST_BYTES * num_files, num_files)
        with self._lock:
            if address not in self._left:
                self._left[address] = _Left(self._bounds.keep_results_s)
            self._left[address].add(room)
            self._come.add(room)

    def count(self) -> Room:
        """Count what is really there; it takes long where there is much."""
        with self._lock:
            come = replace(self._come)
        found = room_of(self.root)
        with self._lock:
            self._found = found
            self._come.add(come, sign=-1)
        return found

    def close(self) -> None:
        """Let nothing more in: the page is about to end and to remove all of it."""
        self._is_closed = True

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
                left.forget_old()
                if not left.total.num_bytes and not left.total.num_files:
                    del self._left[address]
        self.count()

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


def size_of(folder: Path) -> int:
    """Bytes that all files in it take of the disk; one that has several names counts once."""
    return room_of(folder).num_bytes


def room_of(folder: Path) -> Room:
    """What all files in it take; one that has several names counts once."""
    sizes: dict[int, int] = {}
    folders = [str(folder)]
    while folders:
        try:
            with os.scandir(folders.pop()) as found:
                entries = list(found)
        except OSError:
            continue  # swept meanwhile
        for entry in entries:
            try:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
                elif entry.is_file(follow_symlinks=False):
                    size = entry.stat(follow_symlinks=False).st_size
                    sizes[entry.inode()] = max(size, LEAST_BYTES)
            except OSError:
                continue
    return Room(sum(sizes.values()), len(sizes))


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
