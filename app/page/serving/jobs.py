"""Who is running what: a private folder for each run, a place in the queue, a way to stop."""

from __future__ import annotations

import itertools
import secrets
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from app import text
from app.errors import CancelledRun, RunError

Tab = Literal["generate", "own_motion", "live", "mechanism", "steps", "study"]
"""The part of the page that starts a run, and whose button stops it."""


class Job:
    """One visitor's run, with a folder that no other visitor is told of."""

    def __init__(self, visitor: str, tab: Tab, folder: Path) -> None:
        self.visitor = visitor
        self.tab: Tab = tab
        self.folder = folder
        self._stop = threading.Event()

    def cancel(self) -> None:
        self._stop.set()

    def is_cancelled(self) -> bool:
        return self._stop.is_set()


class JobBook:
    """All runs of this process: at most ``num_slots`` at work, the others in order of arrival."""

    def __init__(self, root: Path, num_slots: int = 1, max_waiting: int = 16) -> None:
        self.root = root
        self.num_slots = num_slots
        self.max_waiting = max_waiting
        self._tickets = itertools.count()
        self._waiting: list[int] = []
        self._num_running = 0
        self._changed = threading.Condition()
        self._jobs: list[Job] = []

    def open(self, visitor: str, tab: Tab) -> Job:
        """A new job of a visitor, in a folder that only this process's user can enter.

        Raises:
            RunError: when too many runs wait already.
        """
        with self._changed:
            if len(self._waiting) >= self.max_waiting:
                raise RunError(text.BUSY.format(limit=self.max_waiting))
        folder = self.root / secrets.token_hex(16)
        folder.mkdir(parents=True, mode=0o700)
        job = Job(visitor, tab, folder)
        with self._changed:
            self._jobs.append(job)
        return job

    def cancel(self, visitor: str, tab: Tab) -> bool:
        """Stop the runs that the visitor started in that tab; False when there is none."""
        with self._changed:
            jobs = [job for job in self._jobs if (job.visitor, job.tab) == (visitor, tab)]
            for job in jobs:
                job.cancel()
            self._changed.notify_all()
            return bool(jobs)

    def cancel_all(self) -> None:
        """Stop every run, as at the end of the process."""
        with self._changed:
            for job in self._jobs:
                job.cancel()
            self._changed.notify_all()

    def close(self, job: Job) -> None:
        """Forget a run that has ended; its folder stays for the downloads."""
        with self._changed:
            self._jobs.remove(job)

    @contextmanager
    def slot(self, job: Job) -> Iterator[Iterator[int]]:
        """A place to work in; iterate over what is given to wait for it.

        The iterator yields how many runs are ahead each time that changes, and ends when the job
        may begin.

        Raises:
            CancelledRun: when the job is cancelled while it waits.
        """
        with self._changed:
            ticket = next(self._tickets)
            self._waiting.append(ticket)
        has_slot = False

        def wait() -> Iterator[int]:
            nonlocal has_slot
            told = None
            while True:
                with self._changed:
                    ahead = self._waiting.index(ticket) + self._num_running
                    if job.is_cancelled():
                        raise CancelledRun
                    if self._waiting[0] == ticket and self._num_running < self.num_slots:
                        self._waiting.remove(ticket)
                        self._num_running += 1
                        has_slot = True
                        self._changed.notify_all()
                        return
                    if ahead == told:
                        self._changed.wait(timeout=1.0)
                        continue
                told = ahead
                yield ahead

        try:
            yield wait()
        finally:
            with self._changed:
                if has_slot:
                    self._num_running -= 1
                elif ticket in self._waiting:
                    self._waiting.remove(ticket)
                self._changed.notify_all()

    def sweep(self, max_age_s: float) -> int:
        """Delete folders of runs that were last touched longer ago; return how many."""
        with self._changed:
            in_use = {job.folder for job in self._jobs}
        num_deleted = 0
        for folder in self.root.iterdir() if self.root.is_dir() else ():
            if folder not in in_use and time.time() - folder.stat().st_mtime > max_age_s:
                shutil.rmtree(folder, ignore_errors=True)
                num_deleted += 1
        return num_deleted

    def keep_swept(self, max_age_s: float, every_s: float = 600.0) -> None:
        """Sweep now and then for as long as the process lives."""

        def sweep_for_ever() -> None:
            while True:
                self.sweep(max_age_s)
                time.sleep(every_s)

        threading.Thread(target=sweep_for_ever, name="sweep", daemon=True).start()
