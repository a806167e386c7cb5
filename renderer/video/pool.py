"""Rendering in child processes, several at a time.

An OpenGL context belongs to one thread and a crash in a driver ends its process, so a job runs in a
process of its own. A pool keeps its processes: to start one takes as long as some forty pictures,
so the videos of a comparison are drawn by as many processes as draw at once. One in which a job
failed or was cancelled is ended.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from renderer.draw.offscreen import Backend
from renderer.draw.probe import choose_backend
from renderer.video.encoder import Cancelled
from renderer.video.parallel import processes_worth
from renderer.video.worker_process import RenderJob, RenderResult, WorkerProcess


class RenderPool:
    """Runs jobs in child processes, at most ``max_workers`` at once. Use it in ``with``: an error
    inside cancels all jobs, ends their processes and leaves no file of theirs."""

    def __init__(self, max_workers: int | None = None) -> None:
        """
        Args:
            max_workers: by default the number of CPU cores this process may use.
        """
        max_workers = max_workers or num_cores()
        self._cores_each = max(1, num_cores() // max_workers)
        self._threads = ThreadPoolExecutor(max_workers, thread_name_prefix="render")
        self._cancelled = threading.Event()
        self._idle: list[WorkerProcess] = []
        self._idle_lock = threading.Lock()

    def __enter__(self) -> "RenderPool":
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is not None:
            self._cancelled.set()
        self._threads.shutdown(wait=True)
        for worker in self._idle:
            worker.close()

    def submit(
        self, job: RenderJob, on_progress: Callable[[float], None] | None = None
    ) -> Future[RenderResult]:
        """Start the job as soon as a core is free. ``on_progress`` is called from a thread.

        Its result raises Cancelled, or BodyError, GLError, ValueError and VideoError as
        ``render_video``.
        """
        return self._threads.submit(self._run, job, on_progress)

    def _run(self, job: RenderJob, on_progress: Callable[[float], None] | None) -> RenderResult:
        job, backend = _ready(job, self._cores_each)
        if self._cancelled.is_set():
            raise Cancelled("Rendering was cancelled.")
        worker = self._idle_worker(backend) or WorkerProcess(backend)
        try:
            return worker.run(job, on_progress, self._cancelled)
        finally:
            if worker.is_idle:
                with self._idle_lock:
                    self._idle.append(worker)
            else:
                worker.close()

    def _idle_worker(self, backend: Backend) -> WorkerProcess | None:
        """One that waits; those that died meanwhile, or loaded another backend, are closed."""
        while True:
            with self._idle_lock:
                worker = self._idle.pop() if self._idle else None
            if worker is None or (worker.is_idle and worker.backend == backend):
                return worker
            worker.close()


def num_cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _ready(job: RenderJob, cores: int) -> tuple[RenderJob, Backend]:
    """The job with nothing left to decide, for a process in another folder; and its backend."""

    def absolute(path: Path | None) -> Path | None:
        return None if path is None else path.absolute()

    # Asked here, where the answer is kept: each new process would have to try the drivers again.
    backend = job.settings.backend or choose_backend()
    job = replace(
        job,
        out=absolute(job.out),
        speech_wav=absolute(job.speech_wav),
        body_path=absolute(job.body_path),
        settings=replace(job.settings, backend=backend),
        num_processes=job.num_processes or processes_worth(job.motion.num_frames, cores),
    )
    return job, backend
