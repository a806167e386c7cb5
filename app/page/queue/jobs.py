"""Who is running what: a private folder for each run, its burden, a place in the queue, a way to
stop.

Places go round: first among addresses, then among the open pages of one address, so that nobody who
has many runs waiting holds up another. When all places are taken, whoever has fewest waiting gets
one from whoever has most.
"""

from __future__ import annotations

import itertools
import secrets
import shutil
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from app import text
from app.errors import CancelledRun, RunError
from app.page.visitors.visitor_files import VisitorFiles, size_of

Tab = Literal[
    "generate", "own_motion", "live", "mechanism", "hearing", "steps", "study", "analysis",
    "seen", "takes", "videos", "live_videos", "own_videos",
]  # fmt: skip
"""The part of the page that starts a run, and whose button stops it."""
_RANKS: dict[Tab, int] = {"seen": 1, "videos": 2, "live_videos": 2, "own_videos": 2}
"""Work that is drawn behind a stage which plays already, a video that was asked for before those
that nobody waits for: it comes after all of a lower rank, and makes way for that at once. All other
work has 0."""


class Job:
    """One visitor's run, with a folder that no other visitor is told of."""

    def __init__(self, visitor: str, tab: Tab, folder: Path, address: str = "") -> None:
        self.visitor = visitor
        self.tab: Tab = tab
        self.folder = folder
        self.address = address
        """Of the machine that asks; visitors behind one share its turns."""
        self.uploads: list[Path] = []
        """What the visitor has given it to work with."""
        self.is_turned_out = False
        """Has lost its place to a visitor who had fewer."""
        self.is_put_back = False
        """Stops for others, to begin anew; see `JobBook.again`."""
        self.is_cancelled_by_visitor = False

    @property
    def rank(self) -> int:
        """As of `_RANKS`."""
        return _RANKS.get(self.tab, 0)

    @property
    def is_behind(self) -> bool:
        return self.rank > 0

    def cancel(self) -> None:
        self.is_cancelled_by_visitor = True

    def is_cancelled(self) -> bool:
        """Whether its work is to stop."""
        return self.is_cancelled_by_visitor or self.is_put_back


@dataclass
class _Place:
    """Of a job that waits; a new one stands behind what has begun until then."""

    job: Job
    number: int
    num_begun: int


class JobBook:
    """All runs of this process: at most ``num_slots`` at work, the others wait in turn."""

    def __init__(
        self,
        root: Path,
        num_slots: int = 1,
        max_waiting: int = 16,
        visitor_files: VisitorFiles | None = None,
    ) -> None:
        self.root = root
        self._visitor_files = visitor_files
        self.num_slots = num_slots
        self.max_waiting = max_waiting
        self._places: list[_Place] = []
        self._working: list[Job] = []
        self._jobs: list[Job] = []
        self._numbers = itertools.count()
        self._num_begun = 0
        self._last_begun: dict[str, float] = {}
        """By address and by visitor, since there was last nothing to do."""
        self._changed = threading.Condition()

    def open(self, visitor: str, tab: Tab, address: str = "", uses: Sequence[Any] = ()) -> Job:
        """A new job of a visitor, with a place in the queue, in a folder that only this process's
        user can enter.

        Args:
            uses: values of a form; the uploads among them are kept until it ends, and then for as
                long as a new one.

        Raises:
            RunError: when too many runs wait already, or there is no room for what they leave.
        """
        folder = self.root / secrets.token_hex(16)
        job = Job(visitor, tab, folder, address)
        if self._visitor_files is not None:
            self._visitor_files.admit(address)
            job.uploads = self._visitor_files.uploads_of(uses)
            self._visitor_files.touch(job.uploads)
        with self._changed:
            ahead = [each for each in self._jobs if job.is_behind or not each.is_behind]
            if len(ahead) >= self.num_slots + self.max_waiting:
                self._make_room(job)
            self._enter(job)
        return job

    def again(self, job: Job) -> Job | None:
        """The same run anew, in a folder of its own, if it was put back and nobody has cancelled it
        since; the old one is forgotten, and its folder removed."""
        if not job.is_put_back:
            return None
        anew = Job(job.visitor, job.tab, self.root / secrets.token_hex(16), job.address)
        anew.uploads = job.uploads
        with self._changed:
            if job not in self._jobs or job.is_cancelled_by_visitor:
                return None
            self._jobs.remove(job)
            self._leave(job)
            self._enter(anew)
        shutil.rmtree(job.folder, ignore_errors=True)
        return anew

    def _enter(self, job: Job) -> None:
        job.folder.mkdir(parents=True, mode=0o700)
        self._jobs.append(job)
        place = _Place(job, next(self._numbers), self._num_begun)
        self._places.append(place)

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
            if job in self._jobs:
                self._jobs.remove(job)
            self._leave(job)
        if self._visitor_files is not None:
            self._visitor_files.touch(job.uploads)
            self._visitor_files.charge(job.address, size_of(job.folder))

    @contextmanager
    def slot(self, job: Job) -> Iterator[Iterator[int]]:
        """A place to work in; iterate over what is given to wait for it.

        The iterator yields how many runs are ahead each time that changes, and ends when the job
        may begin.

        Raises:
            CancelledRun: when the job is cancelled while it waits.
            RunError: when it lost its place to a visitor who had fewer.
        """
        try:
            yield self._wait(job)
        finally:
            with self._changed:
                self._leave(job)

    def _wait(self, job: Job) -> Iterator[int]:
        told = None
        while True:
            with self._changed:
                if job.is_turned_out:
                    raise RunError(text.TURNED_OUT.format(limit=self.max_waiting))
                if job.is_cancelled():
                    raise CancelledRun
                self._make_way(job)
                order = [place.job for place in sorted(self._places, key=self._turn)]
                ahead = order.index(job) + len(self._working)
                is_next = order[0] is job and len(self._working) < self.num_slots
                if is_next:
                    self._begin(job)
                    return
                if ahead == told:
                    self._changed.wait(timeout=1.0)
                    continue
            told = ahead
            yield ahead

    def _make_way(self, waiting: Job) -> None:
        """Put back one at work that nobody waits for, for a job that waits."""
        if len(self._working) < self.num_slots:
            return
        for job in self._working:
            if job.rank > waiting.rank:
                job.is_put_back = True  # it leaves as soon as it has stopped
                return

    def _turn(self, place: _Place) -> tuple[int, float, float, int]:
        """What sorts the places: whose last run began longest ago goes first; last what nobody
        waits for."""
        turns = [
            max(self._last_begun.get(name, 0.0), place.num_begun)
            for name in (f"address {place.job.address}", f"visitor {place.job.visitor}")
        ]
        return place.job.rank, turns[0], turns[1], place.number

    def _begin(self, job: Job) -> None:
        self._places = [place for place in self._places if place.job is not job]
        self._working.append(job)
        if job.is_behind:  # takes nobody's turn
            self._changed.notify_all()
            return
        self._num_begun += 1
        for name in (f"address {job.address}", f"visitor {job.visitor}"):
            self._last_begun[name] = self._num_begun + 0.5  # behind those who came meanwhile
        self._changed.notify_all()

    def _leave(self, job: Job) -> None:
        self._places = [place for place in self._places if place.job is not job]
        if job in self._working:
            self._working.remove(job)
        if not self._places and not self._working:
            self._last_begun.clear()
        self._changed.notify_all()

    def _make_room(self, newcomer: Job) -> None:
        """Take the last place of whoever has most.

        Raises:
            RunError: if the newcomer would then have as many as that one.
        """
        addresses = Counter(place.job.address for place in self._places)
        visitors = Counter(place.job.visitor for place in self._places)

        def crowd(job: Job) -> tuple[int, int]:
            return addresses[job.address], visitors[job.visitor]

        last = max(self._places, key=lambda place: (*crowd(place.job), place.number), default=None)
        mine = crowd(newcomer)
        if last is None or not (
            addresses[last.job.address] > mine[0] + 1
            or (last.job.address == newcomer.address and visitors[last.job.visitor] > mine[1] + 1)
        ):
            raise RunError(text.BUSY.format(limit=self.max_waiting))
        last.job.is_turned_out = True
        self._places.remove(last)
        self._jobs.remove(last.job)
        self._changed.notify_all()

    def in_use(self) -> list[Path]:
        """Folders and uploads of runs that have not ended."""
        with self._changed:
            return [path for job in self._jobs for path in (job.folder, *job.uploads)]
