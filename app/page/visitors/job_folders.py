"""Folder of all files that visitors leave, deleted after a while.

Each process has its own folder; that of a killed process is removed by the next one to start.
Uploads and copies for download lie in ``gradio``, the folders of runs in ``jobs``, researchers'
parts in ``private``.
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

from app.page.visitors.quota import Quota

log = logging.getLogger(__name__)
SWEEP_EVERY_S = 60.0
_LOCK = ".lock"
_held: list[Any] = []
"""Lock files that stay open while the process lives."""


def make_process_folder(parent: Path) -> Path:
    """Make a locked folder of this process in ``parent``, and remove those of ended processes."""
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


def upload_folders_of(values: Iterable[Any], cache: Path) -> list[Path]:
    """Return Gradio's folders of the uploads among a form's values."""
    folders: list[Path] = []
    for value in values:
        if isinstance(value, list):
            folders += upload_folders_of(value, cache)
        elif isinstance(value, str) and value.startswith(f"{cache}{os.sep}"):
            folders += [cache / part for part in Path(value).relative_to(cache).parts[:1]]
    return folders


def touch(folders: Iterable[Path]) -> None:
    """Reset the age of files."""
    for folder in folders:
        with suppress(OSError, ValueError):  # the next reader reports a missing file
            os.utime(folder)


def sweep(root: Path, keep_s: float, in_use: Iterable[Path] = ()) -> None:
    """Delete files older than ``keep_s`` that are not in use; failures are logged."""
    before, busy = time.time() - keep_s, set(in_use)
    for entry in (each for part in ("jobs", "private", "gradio") for each in _entries(root / part)):
        if entry in busy or _last_touched(entry) >= before:
            continue
        try:
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s could not be deleted: %s", entry, error)


def start_sweeper(
    root: Path,
    keep_s: float,
    in_use: Callable[[], Iterable[Path]],
    on_swept: Callable[[], None] = lambda: None,
) -> None:
    """Sweep periodically in a thread while the process lives; exceptions are logged."""
    every_s = min(SWEEP_EVERY_S, keep_s / 4)

    def sweep_for_ever() -> None:
        while True:
            try:
                sweep(root, keep_s, in_use())
                on_swept()
            except Exception:
                log.exception("deleting expired files failed; it will be tried again")
            time.sleep(every_s)

    threading.Thread(target=sweep_for_ever, name="sweep", daemon=True).start()


def _entries(folder: Path) -> list[Path]:
    """Return the content of a folder; empty if it is missing or cannot be read."""
    try:
        return list(folder.iterdir())
    except OSError:
        return []


def _last_touched(path: Path) -> float:
    """Return the modification time of a path; infinity if it does not exist."""
    try:
        return path.lstat().st_mtime
    except OSError:
        return float("inf")


@dataclass(eq=False)
class Job:
    """Run of one visitor."""

    page_session: str
    """Open page that started the run (`page_session_of`); empty for a public one."""
    tab: str
    """Part of the page that starts and cancels the run."""
    folder: Path
    cookie: str = ""
    """Cookie of the visitor's browser; empty without one."""
    survives_disconnect: bool = False
    """True if the run continues when its page loses the connection, as it can be opened later."""
    extra_paths: list[Path] = field(default_factory=list)
    """Further paths that the run uses, such as uploads."""
    _stopped: threading.Event = field(default_factory=threading.Event)

    def cancel(self) -> None:
        self._stopped.set()

    def is_cancelled(self) -> bool:
        """Check whether the visitor, or the end of the page, has cancelled the run."""
        return self._stopped.is_set()


class Jobs:
    """Unfinished runs of this process, with folders in ``root``."""

    def __init__(self, root: Path, quota: Quota | None = None) -> None:
        self.quota = quota or Quota()
        self._root = root
        self._jobs: list[Job] = []
        self._lock = threading.Lock()

    @contextmanager
    def open_job(
        self,
        page_session: str,
        tab: str,
        cookie: str = "",
        values: Sequence[Any] = (),
        *,
        owner: str = "",
        survives_disconnect: bool = False,
    ) -> Iterator[Job]:
        """Open a job with a private folder for the block; the folder stays for downloads.

        The folder and the uploads among a form's values are not deleted during the job, and start
        to age at its end. Raises RunError if the owner's uploads and runs use too much of the disk.
        """
        self.quota.measure_runs(owner)
        self.quota.require_space(owner)
        uploads = upload_folders_of(values, self._root.with_name("gradio"))
        folder = self._root / secrets.token_hex(16)
        job = Job(page_session, tab, folder, cookie, survives_disconnect, uploads)
        job.folder.mkdir(parents=True, mode=0o700)
        touch(job.extra_paths)
        with self._lock:
            self._jobs.append(job)
        try:
            yield job
        finally:
            job.cancel()
            with self._lock:
                self._jobs.remove(job)
            touch([job.folder, *job.extra_paths])
            self.quota.measure_runs(owner, job.folder)

    def cancel(self, page_session: str, tab: str) -> None:
        """Cancel the runs that an open page started in a tab."""
        with self._lock:
            for job in self._jobs:
                if (job.page_session, job.tab) == (page_session, tab):
                    job.cancel()

    def cancel_all(self) -> None:
        """Cancel all runs."""
        with self._lock:
            for job in self._jobs:
                job.cancel()

    def cancel_all_of_closed_page(self, page_session: str, cookie: str) -> None:
        """Cancel all runs of a page that its own browser has closed."""
        with self._lock:
            for job in self._jobs:
                if job.page_session == page_session and job.cookie in ("", cookie):
                    job.cancel()

    def survives_disconnect(self, page_session: str) -> bool:
        """Check whether a page has a run that continues without it."""
        with self._lock:
            own = [job for job in self._jobs if job.page_session == page_session]
            return any(job.survives_disconnect and not job.is_cancelled() for job in own)

    def in_use(self) -> list[Path]:
        """Return folders and uploads of unfinished runs."""
        with self._lock:
            return [path for job in self._jobs for path in (job.folder, *job.extra_paths)]
