"""Rendering in several processes: many videos at once, or one video shared out by pieces.

A driver's threads leave cores idle while Python skins and lights the next frame; processes do not.
The pictures come back in order and, since every piece is skinned as it would be by one process,
they are the same to the last bit. No process is ever ahead by more than a piece, so memory does
not grow with the length of a video.

The children are of ``renderer.video.worker_child``'s own process group and stop when their
channels close: whoever ends the group, or dies, leaves none of them behind.

An OpenGL context belongs to one thread and a crash in a driver ends its process, so a job runs in a
process of its own. A pool keeps its processes: to start one takes as long as some forty pictures,
so the videos of a comparison are drawn by as many processes as draw at once. One in which a job
failed or was cancelled is ended.
"""

import os
import queue
import sys
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from processes.child import Child, Gone, parent_channel
from renderer.body.body import Body, BodyMotion
from renderer.draw.offscreen import Backend
from renderer.draw.probe import choose_backend
from renderer.scene.stage import Stage
from renderer.video.marks import Marks
from renderer.video.render import PIECE_FRAMES, Cancelled, draw_frames, stage_for
from renderer.video.settings import RenderSettings
from renderer.video.worker_process import RenderJob, RenderResult, WorkerProcess, failure

MIN_FRAMES_EACH = 300
"""With fewer frames a further process costs more to start than it saves: one alone already keeps
the driver's threads and ffmpeg busy beside its own."""
MAX_PROCESSES = 4
"""More draw faster than ffmpeg encodes, and each takes a quarter of a gigabyte."""


@dataclass(frozen=True)
class Share:
    """What one of several processes draws."""

    body: Body
    motion: BodyMotion
    frames: tuple[int, ...]
    settings: RenderSettings
    stage: Stage
    marks: Marks | None = None


def processes_worth(num_frames: int, num_cores: int) -> int:
    """How many processes are worth their start."""
    return max(1, min(num_cores, num_frames // MIN_FRAMES_EACH, MAX_PROCESSES))


def draw_in_processes(
    body: Body,
    motion: BodyMotion,
    settings: RenderSettings,
    stage: Stage | None,
    count: int,
    marks: Marks | None = None,
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the picture of each frame in order; close it to end the processes.

    Raises:
        GLError: if a process crashes.
    """
    stage = stage or stage_for(body, [motion], settings)
    settings = replace(settings, backend=settings.backend or choose_backend())
    width, height = settings.picture_size
    shape = (height, width, settings.num_channels)
    turns = [frame // PIECE_FRAMES % count for frame in range(motion.num_frames)]
    with ExitStack() as stack:
        children = []
        for number in range(count):
            frames = tuple(frame for frame, turn in enumerate(turns) if turn == number)
            share = Share(body, motion, frames, settings, stage, marks)
            children.append(stack.enter_context(_Painter(share)))
        for turn in turns:
            yield children[turn].picture(shape)


class _Painter:
    """A child that draws a share. Use it in ``with``."""

    def __init__(self, share: Share) -> None:
        self._share = share

    def __enter__(self) -> "_Painter":
        # Of this process's own group: whoever ends that, ends them all.
        self._child = Child("renderer.video.pool", has_group=False)
        self._child.send(self._share)
        return self

    def picture(self, shape: tuple[int, int, int]) -> UInt8[np.ndarray, "H W C"]:
        """The next picture of the share."""
        try:
            pixels = self._child.receive_bytes()
        except Gone as error:
            backend = self._share.settings.backend
            raise failure("A process that draws", self._child.ended(), backend) from error
        return np.frombuffer(pixels, np.uint8).reshape(shape)

    def __exit__(self, *exception: object) -> None:
        self._child.end()


def _paint(share: Share, channel: Connection) -> None:
    """Draw ahead of the reader by one piece, which has to wait for its turn."""
    done: queue.Queue[bytes | None] = queue.Queue(maxsize=PIECE_FRAMES)

    def write() -> None:
        while (picture := done.get()) is not None:
            try:
                channel.send_bytes(picture)
            except OSError:  # nobody wants the rest
                os._exit(1)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        pictures = draw_frames(
            *(share.body, share.motion, share.frames, share.settings, share.stage, share.marks)
        )
        for picture in pictures:
            done.put(picture.tobytes())
    finally:
        done.put(None)
        writer.join()


def _stop_with_parent(channel: Connection) -> None:
    try:
        channel.recv()  # nothing is ever sent: it closes
    finally:
        os._exit(1)


def main() -> int:
    """Draw the share that comes first, and send pixels back."""
    channel, _ = parent_channel()
    share: Share = channel.recv()
    threading.Thread(target=_stop_with_parent, args=(channel,), daemon=True).start()
    _paint(share, channel)
    return 0


if __name__ == "__main__":
    sys.exit(main())


__all__ = ["RenderJob", "RenderPool", "RenderResult", "RenderTask"]


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
        self._idle: list[WorkerProcess] = []
        self._idle_lock = threading.Lock()

    def __enter__(self) -> "RenderPool":
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is not None:
            for task in self._tasks:
                task.cancel()
        self._threads.shutdown(wait=True)
        for worker in self._idle:
            worker.close()

    def submit(
        self, job: RenderJob, on_progress: Callable[[float], None] | None = None
    ) -> RenderTask:
        """Start the job as soon as a core is free. ``on_progress`` is called from a thread."""
        cancelled = threading.Event()
        future = self._threads.submit(self._run, job, on_progress, cancelled)
        task = RenderTask(future, cancelled)
        self._tasks.append(task)
        return task

    def _run(
        self,
        job: RenderJob,
        on_progress: Callable[[float], None] | None,
        cancelled: threading.Event,
    ) -> RenderResult:
        job, backend = _ready(job, self._cores_each)
        if cancelled.is_set():
            raise Cancelled("Rendering was cancelled.")
        worker = self._idle_worker(backend) or WorkerProcess(backend)
        try:
            return worker.run(job, on_progress, cancelled)
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
