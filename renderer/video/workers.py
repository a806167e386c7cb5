"""Drawing of videos and stills in child processes, several at a time.

An OpenGL context belongs to one thread and a crash in a driver ends its process, so each job runs
in a separate process. Starting one takes as long as some forty pictures: it is reused for the next
job, unless one failed in it.
"""

import os
import sys
import time
from collections.abc import Callable, Hashable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import UInt8

from conventions.views import BODY_LOOKS
from processes.child import Child, ChildExited, parent_channel
from processes.exit_report import ExitReport
from processes.job import Cancelled
from renderer.body.body import BodyMotion, load_body
from renderer.body.body_file import BodyError
from renderer.draw.offscreen import GLError
from renderer.draw.probe import choose_backend
from renderer.scene.camera_setup import CameraSetup
from renderer.video.encoder import VideoError, VideoWriter, partial_path
from renderer.video.overlays import Overlays
from renderer.video.render import RenderSettings, check_frames, draw_frames, stack_pictures

PARALLEL_JOBS = 2
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Environment of the processes: the driver's threads draw, and numpy's would only interfere."""
_POLL_S = 0.05
_USER_ERRORS = (BodyError, GLError, ValueError, VideoError)
"""Errors with one sentence as their message."""
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class MotionRenderJob:
    """Job of drawing one motion, with settings, stage and overlays, to a video, stills, or both."""

    motion: BodyMotion
    out: Path | None = None
    """Path of the mp4; None draws only the stills."""
    speech_wav: Path | None = None
    settings: RenderSettings = field(default_factory=RenderSettings)
    body_path: Path | None = None
    """Path of an SMPL-X npz or of a character; None is the open body."""
    look: str = BODY_LOOKS[0]
    """Look of the open body."""
    stage: CameraSetup | None = None
    """Shared camera and floor; None makes them for this motion alone."""
    overlays: Overlays | None = None
    """Overlays of the pictures."""
    still_frames: tuple[int, ...] = ()
    """Frames to return as pictures, in this order."""


def run_render_jobs(
    jobs: Mapping[Key, MotionRenderJob],
    on_progress: Callable[[float], None] = lambda share: None,
    on_done: Callable[[Key], None] = lambda name: None,
    should_cancel: Callable[[], bool] = lambda: False,
    num_parallel: int = PARALLEL_JOBS,
) -> dict[Key, UInt8[np.ndarray, "N H W C"]]:
    """Run all jobs, and return the stills of each by its name.

    ``num_parallel`` jobs run at once. If there are no more cores than that, the last jobs are run
    together so that no core is idle while one job runs alone: of five by two, the last three.

    Args:
        on_done: called with a name when its file is complete, in the order of completion.

    Raises:
        Cancelled: if ``should_cancel`` returns true; the children are ended and leave no file.
        BodyError, GLError, ValueError, VideoError: error of the first failed job; others are ended.
    """
    shares = dict.fromkeys(jobs, 0.0)
    weights = {name: job.motion.num_frames for name, job in jobs.items()}
    has_idle_core = len(os.sched_getaffinity(0)) > num_parallel
    last = min(len(jobs), num_parallel + (0 if has_idle_core else len(jobs) % num_parallel))
    waiting = list(jobs)
    done: dict[Key, UInt8[np.ndarray, "N H W C"]] = {}
    busy: dict[Key, _Worker] = {}
    idle: list[_Worker] = []
    try:
        while len(done) < len(jobs):
            if should_cancel():
                raise Cancelled("Rendering was cancelled.")
            at_once = last if len(jobs) - len(done) <= last else num_parallel
            while waiting and len(busy) < at_once:
                worker = next((each for each in idle if each.is_alive()), None) or _Worker()
                idle = [each for each in idle if each is not worker]
                busy[waiting[0]] = worker
                worker.start_job(_resolved_job(jobs[waiting.pop(0)]))
            for name, worker in [*busy.items()]:
                shares[name] = worker.progress()
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


def _resolved_job(job: MotionRenderJob) -> MotionRenderJob:
    """Return the job with a backend and absolute paths, for a process in another folder."""
    # Chosen here, where the result is cached: each new process would have to probe the drivers.
    backend = job.settings.backend or choose_backend()
    paths = {"out": job.out, "speech_wav": job.speech_wav, "body_path": job.body_path}
    return replace(
        job,
        settings=replace(job.settings, backend=backend),
        **{name: path and path.absolute() for name, path in paths.items()},
    )


class _Worker:
    """Parent's handle of a drawing process, which runs one job at a time."""

    def __init__(self) -> None:
        self.stills: UInt8[np.ndarray, "N H W C"] | None = None
        """Stills of the finished job; None before."""
        self._out: Path | None = None
        self._share = 0.0
        self._child = Child("renderer.video.workers", environment=_ONE_THREAD)

    def is_alive(self) -> bool:
        return self._child.is_alive()

    def start_job(self, job: MotionRenderJob) -> None:
        self._out, self._share, self.stills = job.out, 0.0, None
        self._child.clear_log()
        self._child.send(job)

    def progress(self) -> float:
        """Return the finished share of the job, from the child's messages.

        Raises as `run_render_jobs`; GLError also if the child died.
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
        except ChildExited as error:
            raise worker_error(self._child.exit_report()) from error
        return self._share

    def close(self) -> None:
        """End the process and remove its pipe and partial file."""
        self._child.kill()
        if self._out is not None:
            partial_path(self._out, self._child.pid).unlink(missing_ok=True)


def worker_error(report: ExitReport) -> RuntimeError:
    """Return the error for a drawing process that died: a driver's crash, or a bug."""
    message = report.user_message(
        "The rendering process",
        "render smaller videos, or fewer at once",
        "start the rendering again (in a new process)",
        "The most likely cause is the OpenGL driver.",
    )
    return GLError(message) if report.signal is not None else RuntimeError(message)


def main() -> int:
    """Run jobs in the child, and send ``(kind, value)``: share, done with the stills, failed."""
    channel, _ = parent_channel()

    def tell(kind: str, value: Any) -> None:
        try:
            channel.send((kind, value))
        except OSError:
            sys.exit()  # the parent has ended; no partial file stays

    while True:
        try:
            job = channel.recv()
        except (EOFError, OSError):
            return 0
        try:
            tell("done", _done(job, lambda share: tell("share", share)))
        except _USER_ERRORS as error:
            tell("failed", error)


def _done(job: MotionRenderJob, tell: Callable[[float], None]) -> UInt8[np.ndarray, "N H W C"]:
    """Draw a job frame by frame, so that memory does not grow with the length of a video."""
    body, settings = load_body(job.body_path, job.look), job.settings
    check_frames(job.still_frames, job.motion)
    looks = body, job.motion, settings, job.stage, job.overlays
    if job.out is None:
        return stack_pictures(map(np.copy, draw_frames(*looks, job.still_frames)), settings)
    count, stills = job.motion.num_frames, {}
    with (
        closing(draw_frames(*looks)) as pictures,
        VideoWriter(job.out, *settings.picture_size, count, job.speech_wav, settings.crf) as video,
    ):
        for index, picture in enumerate(pictures):
            video.write(picture)
            if index in job.still_frames:
                stills[index] = picture.copy()
            tell((index + 1) / count)
    return stack_pictures((stills[frame] for frame in job.still_frames), settings)


if __name__ == "__main__":
    sys.exit(main())
