"""Every byte that visitors leave, in one folder of this process, and gone after a while.

A process that is killed leaves its folder behind; the next one to start removes it. Uploads and
copies for download lie in ``gradio``, the folders of runs in ``jobs``, researchers' parts in
``private``.
"""

from __future__ import annotations

import fcntl
import logging
import os
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

log = logging.getLogger(__name__)
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
    """Delete what was last touched longer ago than it is kept, but for what is in use. What cannot
    be deleted is logged and keeps nothing else from being deleted."""
    before, kept = time.time() - keep_s, set(in_use)
    for entry in (each for part in ("jobs", "private", "gradio") for each in _entries(root / part)):
        if entry in kept or _last_touched(entry) >= before:
            continue
        try:
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s could not be deleted: %s", entry, error)


def keep_swept(root: Path, keep_s: float, in_use: Callable[[], Iterable[Path]]) -> None:
    """Sweep now and then for as long as the process lives, whatever one sweep may meet."""
    every_s = min(SWEEP_EVERY_S, keep_s / 4)

    def sweep_for_ever() -> None:
        while True:
            try:
                sweep(root, keep_s, in_use())
            except Exception:
                log.exception("a sweep failed; the next one follows")
            time.sleep(every_s)

    threading.Thread(target=sweep_for_ever, name="sweep", daemon=True).start()


def _entries(folder: Path) -> list[Path]:
    """The content of a folder; nothing of one that is missing or cannot be read."""
    try:
        return list(folder.iterdir())
    except OSError:
        return []


def _last_touched(path: Path) -> float:
    """What is gone already was touched in no time to come."""
    try:
        return path.lstat().st_mtime
    except OSError:
        return float("inf")


@dataclass(eq=False)
class Job:
    """One visitor's run."""

    visitor: str
    tab: str
    """The part of the page that starts it, and whose button stops it."""
    folder: Path
    cookie: str = ""
    """Of the visitor's browser; empty for one that keeps none."""
    outlives: bool = False
    """Whether it goes on if its page loses the connection, as it can be opened again later."""
    beside: list[Path] = field(default_factory=list)
    """What is kept beside its folder: what the visitor has given it to work with."""
    _stopped: threading.Event = field(default_factory=threading.Event)

    def cancel(self) -> None:
        self._stopped.set()

    def is_cancelled(self) -> bool:
        """Whether its visitor, or the end of the page, has stopped it."""
        return self._stopped.is_set()


class Jobs:
    """All runs of this process that have begun and not ended, in folders below ``root``, beside
    which uploads lie in ``gradio``."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._jobs: list[Job] = []
        self._lock = threading.Lock()

    @contextmanager
    def opened(
        self,
        visitor: str,
        tab: str,
        cookie: str = "",
        values: Sequence[Any] = (),
        *,
        outlives: bool = False,
    ) -> Iterator[Job]:
        """A job in a folder that only this process's user can enter; it stays for the downloads.
        Its folder and the uploads among the values of a form are kept until the job ends, and then
        for as long as new ones."""
        uploads = uploads_of(values, self._root.with_name("gradio"))
        folder = self._root / secrets.token_hex(16)
        job = Job(visitor, tab, folder, cookie, outlives, uploads)
        job.folder.mkdir(parents=True, mode=0o700)
        touch(job.beside)
        with self._lock:
            self._jobs.append(job)
        try:
            yield job
        finally:
            job.cancel()
            with self._lock:
                self._jobs.remove(job)
            touch([job.folder, *job.beside])

    def cancel(self, visitor: str = "", tab: str = "") -> None:
        """Stop the runs that the visitor started in that tab; without any, every run."""
        with self._lock:
            for job in self._jobs:
                if not visitor or (job.visitor, job.tab) == (visitor, tab):
                    job.cancel()

    def leave(self, visitor: str, cookie: str) -> None:
        """Stop all runs of a page that is closed, as its own browser says."""
        with self._lock:
            for job in self._jobs:
                if job.visitor == visitor and job.cookie in ("", cookie):
                    job.cancel()

    def outlives(self, visitor: str) -> bool:
        """Whether a run of a page goes on without it, as nobody has stopped it."""
        with self._lock:
            own = [job for job in self._jobs if job.visitor == visitor]
            return any(job.outlives and not job.is_cancelled() for job in own)

    def in_use(self) -> list[Path]:
        """Folders and uploads of runs that have not ended."""
        with self._lock:
            return [path for job in self._jobs for path in (job.folder, *job.beside)]
