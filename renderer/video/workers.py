"""Videos and stills drawn in child processes, several at a time.

An OpenGL context belongs to one thread and a crash in a driver ends its process, so each job runs
in a process of its own. To start one takes as long as some forty pictures: it is kept for the next
job, unless one failed in it. A long video is drawn by several at once, which its own process
starts: each draws every so-many-th piece of frames. The pictures are the same to the last bit,
since every piece is skinned as it would be by one, and none is ever ahead by more than a piece.
"""

import os
import time
from collections import deque
from collections.abc import Callable, Generator, Hashable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import UInt8

from conventions.views import LOOKS
from processes.child import Child, Gone
from processes.ended import Ended
from renderer.body.body import BodyMotion
from renderer.draw.offscreen import GLError
from renderer.draw.probe import choose_backend
from renderer.scene.stage import Stage
from renderer.video.encoder import Cancelled, partial_path
from renderer.video.marks import Marks
from renderer.video.render import PIECE_FRAMES, RenderSettings, stacked

PARALLEL_JOBS = 2
MIN_FRAMES_EACH = 300
"""With fewer frames a further process costs more to start than it saves: one alone already keeps
the driver's threads and ffmpeg busy beside its own."""
MAX_PROCESSES = 4
"""More draw faster than ffmpeg encodes, and each takes a quarter of a gigabyte."""
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""The pictures are drawn by the driver's threads; numpy's would only get in their way."""
_GRACE_S = 2.0
"""How long a child that is to leave a job may take to tidy up before it is killed."""
_POLL_S = 0.05
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class RenderJob:
    """What is in pictures (a body that moves, the panels and camera before it, marks), and what
    they are drawn to: a video, stills, or both."""

    motion: BodyMotion
    out: Path | None = None
    """The mp4 to write; None draws the stills alone."""
    speech_wav: Path | None = None
    settings: RenderSettings = field(default_factory=RenderSettings)
    body_path: Path | None = None
    """An SMPL-X npz; None is the open body."""
    look: str = LOOKS[0]
    """Of the open body."""
    stage: Stage | None = None
    """Shared camera and floor; None makes them for this motion alone."""
    marks: Marks | None = None
    """What else is shown in the pictures."""
    still_frames: tuple[int, ...] = ()
    """Frames to return as pictures, in this order."""
    num_processes: int | None = None
    """How many draw the frames of a video; None is as many as its cores and length are worth."""


def draw_jobs(
    jobs: Mapping[Key, RenderJob],
    on_progress: Callable[[float], None] = lambda share: None,
    on_done: Callable[[Key], None] = lambda name: None,
    should_cancel: Callable[[], bool] = lambda: False,
    parallel: int = PARALLEL_JOBS,
) -> dict[Key, UInt8[np.ndarray, "N H W C"]]:
    """Do every job, and return the stills of each under the same name.

    ``parallel`` of them at once. Where there are no more cores than that, at the end so many more
    that none is drawn alone beside an idle core: of five by two, the last three together.

    Args:
        on_progress: called with the share of all frames done, 0 to 1; what it raises ends the work.
        on_done: called with a name when its file is whole, in the order in which they end.

    Raises:
        Cancelled: when ``should_cancel`` said so; the children are ended and left no file.
        BodyError, GLError, ValueError, VideoError: of the first job that failed; the others are
            ended.
    """
    shares = dict.fromkeys(jobs, 0.0)
    weights = {name: job.motion.num_frames for name, job in jobs.items()}
    last = min(len(jobs), parallel + (len(jobs) % parallel if num_cores() <= parallel else 0))
    waiting = list(jobs)
    done: dict[Key, UInt8[np.ndarray, "N H W C"]] = {}
    busy: dict[Key, _Worker] = {}
    idle: list[_Worker] = []
    try:
        while len(done) < len(jobs):
            if should_cancel():
                raise Cancelled("Rendering was cancelled.")
            at_once = last if len(jobs) - len(done) <= last else parallel
            while waiting and len(busy) < at_once:
                job = _decided(jobs[waiting[0]], num_cores() // last)
                worker = _taken(idle, job) or _Worker(job)
                busy[waiting.pop(0)] = worker
                worker.begin(job)
            for name, worker in [*busy.items()]:
                if worker.has_done():
                    done[name], shares[name] = worker.stills(), 1.0
                    idle.append(busy.pop(name))
                    on_done(name)
                else:
                    shares[name] = worker.share
            on_progress(sum(weights[name] * shares[name] for name in jobs) / sum(weights.values()))
            if len(done) < len(jobs):
                time.sleep(_POLL_S)
    finally:
        for worker in (*busy.values(), *idle):
            worker.close()
    return done


def _decided(job: RenderJob, cores: int) -> RenderJob:
    """The job with nothing left to decide, for a process in another folder."""

    def absolute(path: Path | None) -> Path | None:
        return None if path is None else path.absolute()

    # Asked here, where the answer is kept: each new process would have to try the drivers again.
    backend = job.settings.backend or choose_backend()
    return replace(
        job,
        out=absolute(job.out),
        speech_wav=absolute(job.speech_wav),
        body_path=absolute(job.body_path),
        settings=replace(job.settings, backend=backend),
        num_processes=job.num_processes or processes_worth(job.motion.num_frames, cores),
    )


def _taken(idle: "list[_Worker]", job: RenderJob) -> "_Worker | None":
    """One that waits; those that died meanwhile, or loaded another backend, are closed."""
    while idle:
        worker = idle.pop()
        if worker.is_alive() and worker.backend == job.settings.backend:
            return worker
        worker.close()
    return None


def num_cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0))


def processes_worth(num_frames: int, cores: int) -> int:
    """How many processes are worth their start."""
    return max(1, min(cores, num_frames // MIN_FRAMES_EACH, MAX_PROCESSES))


class _Worker:
    """A process that draws through one backend, as its parent sees it: jobs go in, one by one."""

    def __init__(self, job: RenderJob, *, has_group: bool = True) -> None:
        """
        Args:
            job: the first that it will get, of all the same backend.
            has_group: as of `Child`.
        """
        self.backend = job.settings.backend
        self.share = 0.0
        self._job, self._is_busy = job, False
        self._pictures: deque[np.ndarray] = deque()
        self._child = Child(
            "renderer.video.worker_child", environment=_ONE_THREAD, has_group=has_group
        )

    def is_alive(self) -> bool:
        return self._child.is_alive()

    def begin(self, job: RenderJob) -> None:
        self._job, self._is_busy, self.share = job, True, 0.0
        self._child.forget()
        self._child.send(job)

    def has_done(self) -> bool:
        """Whether the job is done; takes what the child has said meanwhile.

        Raises:
            BodyError, GLError, ValueError, VideoError: as of `draw_jobs`; GLError also if the child
                died.
        """
        while self._is_busy and self._hears(within_s=0.0):
            pass
        return not self._is_busy

    def stills(self) -> UInt8[np.ndarray, "N H W C"]:
        """All pictures of the job."""
        pictures = stacked(self._pictures, self._job.settings)
        self._pictures.clear()
        return pictures

    def next_picture(self) -> UInt8[np.ndarray, "H W C"]:
        """Waits for it."""
        while not self._pictures:
            self._hears(within_s=_POLL_S)
        return self._pictures.popleft()

    def close(self) -> None:
        """Leave nothing behind: no process, no pipe, no partial file."""
        self._child.end(_GRACE_S if self._is_busy else 0.0)
        if self._is_busy and self._job.out is not None:
            partial_path(self._job.out, self._child.pid).unlink(missing_ok=True)

    def _hears(self, within_s: float) -> bool:
        """Take a message if there is one."""
        try:
            if not self._child.has_message(within_s):
                return False
            kind, value = self._child.receive()
        except Gone as error:
            raise failure(self._child.ended()) from error
        match kind:
            case "share":
                self.share = value
            case "picture":
                self._pictures.append(value)
            case "done":
                self._is_busy = False
            case _:
                raise value
        return True


def drawn_by_several(job: RenderJob) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the picture of each frame in order; close it to end the processes.

    They are of this process's own group: whoever ends that, ends them all.

    Raises:
        GLError: if a process crashes.
    """
    count = job.num_processes or 1
    turns = [frame // PIECE_FRAMES % count for frame in range(job.motion.num_frames)]
    with ExitStack() as stack:
        workers = []
        for number in range(count):
            frames = tuple(frame for frame, turn in enumerate(turns) if turn == number)
            workers.append(stack.enter_context(closing(_Worker(job, has_group=False))))
            workers[-1].begin(replace(job, out=None, still_frames=frames))
        for turn in turns:
            yield workers[turn].next_picture()


def failure(ended: Ended) -> RuntimeError:
    """Of a process that draws and has ended without a word: a driver's crash, or a bug of ours."""
    told = ended.sentences(
        "The rendering process",
        "draw smaller or fewer videos at once",
        "start it again, which is done by a fresh process",
        "This is most likely the OpenGL driver.",
    )
    return GLError(told) if ended.signal is not None else RuntimeError(told)
