"""Videos and stills drawn in child processes, several at a time.

An OpenGL context belongs to one thread and a crash in a driver ends its process, so each job runs
in a process of its own. To start one takes as long as some forty pictures: it is kept for the next
job, unless one failed in it.
"""

import os
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import UInt8

from conventions.views import LOOKS
from processes.child import Child, Gone
from processes.ended import Ended
from processes.job import Cancelled
from renderer.body.body import BodyMotion
from renderer.draw.offscreen import GLError
from renderer.draw.probe import choose_backend
from renderer.scene.stage import Stage
from renderer.video.encoder import partial_path
from renderer.video.marks import Marks
from renderer.video.render import RenderSettings

PARALLEL_JOBS = 2
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""The pictures are drawn by the driver's threads; numpy's would only get in their way."""
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
    has_idle_core = len(os.sched_getaffinity(0)) > parallel
    last = min(len(jobs), parallel + (0 if has_idle_core else len(jobs) % parallel))
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
                job = _decided(jobs[waiting[0]])
                worker = _taken(idle, job) or _Worker(job)
                busy[waiting.pop(0)] = worker
                worker.begin(job)
            for name, worker in [*busy.items()]:
                shares[name] = worker.share()
                if worker.stills is not None:
                    done[name], shares[name] = worker.stills, 1.0
                    idle.append(busy.pop(name))
                    on_done(name)
            on_progress(sum(weights[name] * shares[name] for name in jobs) / sum(weights.values()))
            if len(done) < len(jobs):
                time.sleep(_POLL_S)
    finally:
        for worker in (*busy.values(), *idle):
            worker.close()
    return done


def _decided(job: RenderJob) -> RenderJob:
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
    )


def _taken(idle: "list[_Worker]", job: RenderJob) -> "_Worker | None":
    """One that waits; those that died meanwhile, or loaded another backend, are closed."""
    while idle:
        worker = idle.pop()
        if worker.is_alive() and worker.backend == job.settings.backend:
            return worker
        worker.close()
    return None


class _Worker:
    """A process that draws through one backend, as its parent sees it: jobs go in, one by one."""

    def __init__(self, job: RenderJob) -> None:
        """
        Args:
            job: the first that it will get, of all the same backend.
        """
        self.backend = job.settings.backend
        self.stills: UInt8[np.ndarray, "N H W C"] | None = None
        """Of the job, once it is done."""
        self._job, self._share = job, 0.0
        self._child = Child("renderer.video.worker_child", environment=_ONE_THREAD)

    def is_alive(self) -> bool:
        return self._child.is_alive()

    def begin(self, job: RenderJob) -> None:
        self._job, self._share, self.stills = job, 0.0, None
        self._child.forget()
        self._child.send(job)

    def share(self) -> float:
        """How much of the job is done, by what the child has said meanwhile.

        Raises:
            BodyError, GLError, ValueError, VideoError: as of `draw_jobs`; GLError also if the child
                died.
        """
        try:
            while self.stills is None and self._child.has_message(0.0):
                kind, value = self._child.receive()
                match kind:
                    case "share":
                        self._share = value
                    case "done":
                        self.stills = value
                    case _:
                        raise value
        except Gone as error:
            raise failure(self._child.ended()) from error
        return self._share

    def close(self) -> None:
        """Leave nothing behind: no process, no pipe, no partial file."""
        self._child.end()
        if self._job.out is not None:
            partial_path(self._job.out, self._child.pid).unlink(missing_ok=True)


def failure(ended: Ended) -> RuntimeError:
    """Of a process that draws and has ended without a word: a driver's crash, or a bug of ours."""
    told = ended.sentences(
        "The rendering process",
        "draw smaller or fewer videos at once",
        "start it again, which is done by a fresh process",
        "This is most likely the OpenGL driver.",
    )
    return GLError(told) if ended.signal is not None else RuntimeError(told)
