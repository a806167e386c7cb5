"""The runs that have begun: a folder for each that no other visitor is told of, and a way to stop.

Who runs next is decided by Gradio's queue; what is drawn behind a stage gives way to all else here.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.page.visitors.files import touch, uploads_of

VIDEOS = " videos"
"""Ends the name of a tab where it is the drawing behind a stage that plays already."""


class Job:
    """One visitor's run."""

    def __init__(
        self, visitor: str, tab: str, folder: Path, cookie: str = "", uploads: Sequence[Path] = ()
    ) -> None:
        """
        Args:
            tab: the part of the page that starts it, and whose button stops it.
        """
        self.visitor = visitor
        self.tab = tab
        self.folder = folder
        self.cookie = cookie
        """Of the visitor's browser; empty for one that keeps none."""
        self.beside = [*uploads]
        """What is kept beside its folder: what the visitor has given it to work with."""
        self._stopped = threading.Event()

    def cancel(self) -> None:
        self._stopped.set()

    def is_cancelled(self) -> bool:
        """Whether its visitor, or the end of the page, has stopped it."""
        return self._stopped.is_set()


class Jobs:
    """All runs of this process that have begun and not ended."""

    def __init__(self, root: Path) -> None:
        """
        Args:
            root: of the folders of runs; uploads lie in ``gradio`` beside it.
        """
        self._root = root
        self._jobs: list[Job] = []
        self._changed = threading.Condition()

    @contextmanager
    def opened(
        self, visitor: str, tab: str, cookie: str = "", values: Sequence[Any] = ()
    ) -> Iterator[Job]:
        """A job in a folder that only this process's user can enter; it stays for the downloads.

        Args:
            values: of a form; the uploads among them are kept until the job ends, and then for as
                long as a new one.
        """
        uploads = uploads_of(values, self._root.with_name("gradio"))
        job = Job(visitor, tab, self._root / secrets.token_hex(16), cookie, uploads)
        job.folder.mkdir(parents=True, mode=0o700)
        touch(job.beside)
        with self._changed:
            self._jobs.append(job)
        try:
            yield job
        finally:
            job.cancel()
            with self._changed:
                self._jobs.remove(job)
                self._changed.notify_all()
            touch(job.beside)

    def cancel(self, visitor: str, tab: str) -> None:
        """Stop the runs that the visitor started in that tab."""
        with self._changed:
            for job in self._jobs:
                if (job.visitor, job.tab) == (visitor, tab):
                    job.cancel()

    def cancel_all(self) -> None:
        """Stop every run, as at the end of the process."""
        with self._changed:
            for job in self._jobs:
                job.cancel()

    def in_use(self) -> list[Path]:
        """Folders and uploads of runs that have not ended."""
        with self._changed:
            return [path for job in self._jobs for path in (job.folder, *job.beside)]

    def is_anyone_waiting(self) -> bool:
        """Whether a run is at work that somebody waits for."""
        with self._changed:
            return self._is_anyone_waiting()

    def wait_for_rest(self, within_s: float) -> bool:
        """Wait until nobody waits for a run, for a while; whether nobody does."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._is_anyone_waiting(), within_s)

    def _is_anyone_waiting(self) -> bool:
        return not all(job.tab.endswith(VIDEOS) for job in self._jobs)
