"""Rendering in child processes, several at a time.

An OpenGL context belongs to one thread and a crash in a driver ends its process, so each job has
a process of its own. The child is started directly rather than through ``multiprocessing``,
which would import the caller's main module, and torch with it, into every child.

The child reads one pickled job from its standard input and keeps listening there: when that
pipe closes, because the job was cancelled or the parent died, it stops and leaves no file.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import UInt8

from renderer.body import BodyError, BodyMotion
from renderer.look import DEFAULT_LOOK
from renderer.offscreen import GLError
from renderer.parallel import processes_worth
from renderer.render import Cancelled, RenderSettings
from renderer.stage import Stage
from renderer.video import VideoError, partial_path

_GRACE_S = 2.0
"""How long a cancelled child may take to tidy up before it is killed."""

KNOWN_ERRORS: dict[str, type[Exception]] = {
    error.__name__: error for error in (BodyError, Cancelled, GLError, ValueError, VideoError)
}
"""Errors that keep their type on the way from the child; each holds one sentence."""


@dataclass(frozen=True)
class RenderJob:
    """One video, or only stills of a motion."""

    motion: BodyMotion
    out: Path | None = None
    """The mp4 to write; None draws the stills alone."""
    speech_wav: Path | None = None
    settings: RenderSettings = field(default_factory=RenderSettings)
    body_path: Path | None = None
    """An SMPL-X npz; None is the open body."""
    look: str = DEFAULT_LOOK
    """Of the open body."""
    stage: Stage | None = None
    """Shared camera and floor; None makes them for this motion alone."""
    still_frames: tuple[int, ...] = ()
    """Frames to return as pictures, in this order."""
    num_processes: int | None = None
    """How many draw the frames of a video; None is as many as its cores and length are worth."""


@dataclass(frozen=True)
class RenderResult:
    """What a job gave."""

    out: Path | None
    stills: UInt8[np.ndarray, "N H W 3"]


class RenderTask:
    """A submitted job."""

    def __init__(self, future: Future[RenderResult], cancelled: threading.Event) -> None:
        self._future = future
        self._cancelled = cancelled

    def result(self, timeout_s: float | None = None) -> RenderResult:
        """Wait for the end.

        Raises:
            Cancelled: if it was cancelled.
            BodyError, GLError, ValueError, VideoError: as ``render_video``.
            TimeoutError: if it is not done after ``timeout_s``.
        """
        return self._future.result(timeout_s)

    def done(self) -> bool:
        return self._future.done()

    def cancel(self) -> None:
        """End the child; ``result`` raises ``Cancelled`` and no file is left."""
        self._cancelled.set()


class RenderPool:
    """Runs jobs in child processes, at most ``max_workers`` at once. Use it in ``with``."""

    def __init__(self, max_workers: int | None = None) -> None:
        """
        Args:
            max_workers: by default the number of CPU cores this process may use.
        """
        max_workers = max_workers or num_cores()
        self._cores_each = max(1, num_cores() // max_workers)
        self._threads = ThreadPoolExecutor(max_workers, thread_name_prefix="render")
        self._tasks: list[RenderTask] = []

    def __enter__(self) -> "RenderPool":
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is not None:
            for task in self._tasks:
                task.cancel()
        self._threads.shutdown(wait=True)

    def submit(
        self, job: RenderJob, on_progress: Callable[[float], None] | None = None
    ) -> RenderTask:
        """Start the job as soon as a core is free. ``on_progress`` is called from a thread."""
        cancelled = threading.Event()
        job = _with_processes(job, self._cores_each)
        future = self._threads.submit(run_job, job, on_progress, cancelled)
        task = RenderTask(future, cancelled)
        self._tasks.append(task)
        return task


def run_job(
    job: RenderJob,
    on_progress: Callable[[float], None] | None = None,
    cancelled: threading.Event | None = None,
) -> RenderResult:
    """Run one job in a child process and wait for it.

    Raises:
        Cancelled: when ``cancelled`` was set; no file and no process is left.
        BodyError, GLError, ValueError, VideoError: as ``render_video``; GLError also if the
            child process died.
    """
    if cancelled is not None and cancelled.is_set():
        raise Cancelled("Rendering was cancelled.")
    job = _with_processes(job, num_cores())
    job = _with_absolute_paths(job)  # the child runs in another folder
    with tempfile.TemporaryFile() as messages:
        child = _Child(job, messages)
        watcher = threading.Thread(target=child.end_when, args=(cancelled,), daemon=True)
        if cancelled is not None:
            watcher.start()
        try:
            return child.outcome(on_progress)
        finally:
            child.close()
            if cancelled is not None:
                watcher.join()


def num_cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _with_processes(job: RenderJob, cores: int) -> RenderJob:
    if job.num_processes is not None:
        return job
    return replace(job, num_processes=processes_worth(job.motion.num_frames, cores))


def _with_absolute_paths(job: RenderJob) -> RenderJob:
    def absolute(path: Path | None) -> Path | None:
        return None if path is None else path.absolute()

    return replace(
        job,
        out=absolute(job.out),
        speech_wav=absolute(job.speech_wav),
        body_path=absolute(job.body_path),
    )


class _Child:
    """The parent's side of one child process."""

    def __init__(self, job: RenderJob, messages: IO[bytes]) -> None:
        self._job = job
        self._messages = messages
        self._finished = threading.Event()
        self._was_cancelled = False
        repository = Path(__file__).parents[1]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "renderer.worker_child"],
            cwd=repository,
            # The pictures are drawn by the driver's threads; numpy's would only get in their way.
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=messages,
            start_new_session=True,  # one process group with its ffmpeg, so that both can be ended
        )

    def outcome(self, on_progress: Callable[[float], None] | None) -> RenderResult:
        """Hand over the job and listen until the child says how it ended."""
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            pickle.dump(self._job, self._process.stdin)
            self._process.stdin.flush()
            while True:
                kind, value = pickle.load(self._process.stdout)
                if kind == "progress":
                    if on_progress is not None:
                        on_progress(value)
                elif kind == "done":
                    return value
                else:
                    raise KNOWN_ERRORS[kind](value)
        except Exception as error:
            if self._was_cancelled:
                raise Cancelled("Rendering was cancelled.") from error
            if isinstance(error, (EOFError, pickle.UnpicklingError, BrokenPipeError)):
                raise self._obituary() from error
            raise

    def end_when(self, cancelled: threading.Event) -> None:
        """Watch for a cancellation until the child has ended."""
        while not self._finished.is_set():
            if cancelled.wait(0.05):
                self._was_cancelled = True
                self._end()
                return

    def close(self) -> None:
        """Leave nothing behind: no process, no pipe, no partial file."""
        self._finished.set()
        self._end()
        assert self._process.stdout is not None
        self._process.stdout.close()

    def _end(self) -> None:
        stdin = self._process.stdin
        assert stdin is not None
        try:
            stdin.close()  # the child takes this as a request to stop
        except OSError:  # it is gone already
            pass
        try:
            self._process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            pass
        try:
            os.killpg(self._process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self._process.wait()
        if self._job.out is not None:
            partial_path(self._job.out, self._process.pid).unlink(missing_ok=True)

    def _obituary(self) -> RuntimeError:
        """What to say of a child that died without a word: a driver's crash, or a bug of ours."""
        status = self._process.wait()
        self._messages.seek(0)
        said = self._messages.read().decode(errors="replace").strip()
        if status < 0:
            return GLError(
                f"The rendering process crashed ({signal.Signals(-status).name}); "
                "this is most likely the OpenGL driver."
            )
        return RuntimeError(f"The rendering process ended with status {status}:\n{said}")
