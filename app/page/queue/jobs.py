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
import time
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from app import text
from app.errors import CancelledRun, RunError
from app.page.visitors.visitor_files import VisitorFiles, size_of

LARGE_BYTES = 6 * 10**6
"""Half a minute of sound as recorders write it, or a minute and a half of motion."""
_PACKED_SOUND = {".mp3", ".m4a", ".aac", ".ogg", ".oga", ".opus", ".webm", ".mp4", ".wma"}
_PACKED_TIMES = 10
_ZIPPED = {".npz", ".zip"}


def is_large(uploads: Iterable[Path]) -> bool:
    """Whether a run on these is likely to take long. It only decides whose turn it is: who is taken
    for small and takes long all the same has to step aside or back."""
    return sum(map(_unpacked_bytes, uploads)) > LARGE_BYTES


def _unpacked_bytes(upload: Path) -> int:
    try:
        size = upload.stat().st_size
        if size > LARGE_BYTES:  # of a zip, its list of contents might be as long
            return size
        if upload.suffix.lower() in _ZIPPED:
            with zipfile.ZipFile(upload) as archive:
                return sum(each.file_size for each in archive.infolist())
    except Exception:  # who reads it in earnest tells what is wrong with it
        return 0
    return size * (_PACKED_TIMES if upload.suffix.lower() in _PACKED_SOUND else 1)


LONG_S = 12.0
"""At work; what takes longer steps aside for others."""
LARGE_S = 2.0
"""The same of a large run, for a small one of its own address."""
BACK_S = 60.0
"""At work; what takes longer is put back for another visitor of its own address, where its address
has one aside already. For other addresses that is `LONG_S`."""
PATIENCE_S = 120.0
"""A large run that has waited so long has its turn like a small one."""
NUM_ASIDE = 1
"""Runs that have stepped aside; each takes the memory of one at work."""

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
        self.begun_at = float("inf")
        """When it came to work, by time.monotonic."""
        self.is_large = False
        """Goes after the small ones of its address: for what it was given, or as it took long."""
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
    since: float
    """By time.monotonic."""


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
        self._aside: list[Job] = []
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
            job.is_large = is_large(job.uploads)
        with self._changed:
            ahead = [each for each in self._jobs if job.is_behind or not each.is_behind]
            if len(ahead) - len(self._aside) >= self.num_slots + self.max_waiting:
                self._make_room(job)
            self._enter(job)
        return job

    def again(self, job: Job) -> Job | None:
        """The same run anew, in a folder of its own, if it was put back and nobody has cancelled it
        since; the old one is forgotten, and its folder removed."""
        if not job.is_put_back:
            return None
        anew = Job(job.visitor, job.tab, self.root / secrets.token_hex(16), job.address)
        anew.uploads, anew.is_large = job.uploads, job.is_large or not job.is_behind
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
        place = _Place(job, next(self._numbers), self._num_begun, time.monotonic())
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
                self._step_aside(job)
                order = [place.job for place in sorted(self._places, key=self._turn)]
                ahead = order.index(job) + len(self._working)
                is_next = order[0] is job and len(self._working) < self.num_slots
                if is_next and not self._is_held_back(job, self._aside):
                    self._begin(job)
                    return
                if ahead == told:
                    self._changed.wait(timeout=1.0)
                    continue
            told = ahead
            yield ahead

    def _step_aside(self, waiting: Job) -> None:
        """Make way for a job that waits, where a run of another takes long, or one at work that
        nobody waits for."""
        if self._is_held_back(waiting, self._aside) or len(self._working) < self.num_slots:
            return
        for job in self._working:
            if job.rank > waiting.rank:
                job.is_put_back = True  # it leaves as soon as it has stopped
                return
        if waiting.is_behind:
            return
        for job in self._working:
            if (job.address, job.visitor) == (waiting.address, waiting.visitor):
                continue
            at_work_s = time.monotonic() - job.begun_at
            is_near = job.address == waiting.address
            is_alone = not any(other.address == job.address for other in self._aside)
            if is_alone and len(self._aside) < NUM_ASIDE:
                is_quick = is_near and job.is_large and not waiting.is_large
                if at_work_s > (LARGE_S if is_quick else LONG_S):
                    if not self._is_held_back(waiting, [*self._aside, job]):
                        self._working.remove(job)
                        self._aside.append(job)
                        self._changed.notify_all()
                        return
            elif not is_alone and not job.is_large:
                if at_work_s > (BACK_S if is_near else LONG_S):
                    job.is_put_back = True  # it leaves as soon as it has stopped

    def _is_held_back(self, job: Job, aside: Sequence[Job]) -> bool:
        """Whether it waits for one that has stepped aside."""
        return any(
            other.address == job.address and (job.is_large or other.visitor == job.visitor)
            for other in aside
        )

    def _turn(self, place: _Place) -> tuple[bool, int, float, bool, float, int]:
        """What sorts the places: whose last run began longest ago goes first, and of one address
        the small runs before the large; last what nobody waits for."""
        turns = [
            max(self._last_begun.get(name, 0.0), place.num_begun)
            for name in (f"address {place.job.address}", f"visitor {place.job.visitor}")
        ]
        is_held_back = self._is_held_back(place.job, self._aside)
        goes_after = place.job.is_large and time.monotonic() - place.since < PATIENCE_S
        return is_held_back, place.job.rank, turns[0], goes_after, turns[1], place.number

    def _begin(self, job: Job) -> None:
        self._places = [place for place in self._places if place.job is not job]
        self._working.append(job)
        job.begun_at = time.monotonic()
        if job.is_behind:  # takes nobody's turn
            self._changed.notify_all()
            return
        self._num_begun += 1
        for name in (f"address {job.address}", f"visitor {job.visitor}"):
            self._last_begun[name] = self._num_begun + 0.5  # behind those who came meanwhile
        self._changed.notify_all()

    def _leave(self, job: Job) -> None:
        self._places = [place for place in self._places if place.job is not job]
        for jobs in (self._working, self._aside):
            if job in jobs:
                jobs.remove(job)
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
