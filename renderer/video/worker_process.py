"""The parent's side of one rendering process: jobs go in, one after the other, results come out.

The child is started directly rather than through ``multiprocessing``, which would import the
caller's main module, and torch with it, into every child. It reads pickled jobs from its standard
input: when that pipe closes, because a job was cancelled or the parent died, it stops and leaves
no file.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

from renderer.draw.offscreen import Backend, GLError
from renderer.video.encoder import partial_path
from renderer.video.ended import memory_kills, obituary
from renderer.video.job import KNOWN_ERRORS, RenderJob, RenderResult
from renderer.video.render import Cancelled

_GRACE_S = 2.0
"""How long a child that has to stop may take to tidy up before it is killed."""


class WorkerProcess:
    """A child process that draws through one backend, one job at a time."""

    def __init__(self, backend: Backend) -> None:
        self.backend: Backend = backend
        self._messages = tempfile.TemporaryFile()
        self._job: RenderJob | None = None
        self._was_cancelled = False
        self._killed_before = memory_kills()
        self._process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", "-m", "renderer.video.worker_child"],
            cwd=Path(__file__).parents[2],
            # The pictures are drawn by the driver's threads; numpy's would only get in their way.
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._messages,
            start_new_session=True,  # one process group with its ffmpeg, so that both can be ended
        )

    @property
    def is_idle(self) -> bool:
        """Whether it lives and has brought every job to a good end, so that it can take another.

        What a driver holds after an error is anyone's guess.
        """
        return self._job is None and self._process.poll() is None

    def run(
        self,
        job: RenderJob,
        on_progress: Callable[[float], None] | None,
        cancelled: threading.Event,
    ) -> RenderResult:
        """Hand over a job and listen until the child says how it ended.

        Args:
            cancelled: ends the child when it is set.

        Raises:
            Cancelled: if ``cancelled`` was set; the child is gone and left no file.
            BodyError, GLError, ValueError, VideoError: as ``render_video``; GLError also if the
                child died.
        """
        self._job = job
        finished = threading.Event()
        watcher = threading.Thread(target=self._end_when, args=(cancelled, finished), daemon=True)
        watcher.start()
        try:
            result = self._outcome(job, on_progress)
        finally:
            finished.set()
            watcher.join()
        self._job = None
        return result

    def close(self) -> None:
        """Leave nothing behind: no process, no pipe, no partial file."""
        self._end()
        assert self._process.stdout is not None
        self._process.stdout.close()
        self._messages.close()

    def _outcome(self, job: RenderJob, on_progress: Callable[[float], None] | None) -> RenderResult:
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            pickle.dump(job, self._process.stdin)
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

    def _end_when(self, cancelled: threading.Event, finished: threading.Event) -> None:
        while not finished.is_set():
            if cancelled.wait(0.05):
                self._was_cancelled = True
                self._end()
                return

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
        if self._job is not None and self._job.out is not None:
            partial_path(self._job.out, self._process.pid).unlink(missing_ok=True)

    def _obituary(self) -> RuntimeError:
        """What to say of a child that died without a word: a driver's crash, or a bug of ours."""
        status = self._process.wait()
        self._messages.seek(0)
        said = self._messages.read().decode(errors="replace")
        is_driver = self.backend != "software"
        sentence = obituary("The rendering process", status, said, self._killed_before, is_driver)
        return GLError(sentence) if status < 0 else RuntimeError(sentence)
