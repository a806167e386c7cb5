"""One rendering process as its parent sees it: jobs go in, one by one, results come out."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from conventions.views import LOOKS
from processes.child import Child, Gone
from processes.ended import Ended
from renderer.body.body import BodyMotion
from renderer.body.body_file import BodyError
from renderer.draw.offscreen import Backend, GLError
from renderer.scene.stage import Stage
from renderer.video.encoder import Cancelled, VideoError, partial_path
from renderer.video.marks import Marks
from renderer.video.settings import RenderSettings

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


@dataclass(frozen=True)
class RenderResult:
    """What a job gave."""

    out: Path | None
    stills: UInt8[np.ndarray, "N H W 3"]


ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""The pictures are drawn by the driver's threads; numpy's would only get in their way."""
_GRACE_S = 2.0
"""How long a child that is to leave a job may take to tidy up before it is killed."""
_POLL_S = 0.05


class WorkerProcess:
    """A child process that draws through one backend, one job at a time."""

    def __init__(self, backend: Backend) -> None:
        self.backend: Backend = backend
        self._job: RenderJob | None = None
        self._child = Child("renderer.video.worker_child", environment=ONE_THREAD)

    @property
    def is_idle(self) -> bool:
        """Whether it lives and has brought every job to a good end, so that it can take another.

        What a driver holds after an error is anyone's guess.
        """
        return self._job is None and self._child.is_alive()

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
        self._child.forget()
        self._child.send(job)
        try:
            result = self._outcome(on_progress, cancelled)
        except Gone as error:
            raise failure("The rendering process", self._child.ended()) from error
        self._job = None
        return result

    def close(self) -> None:
        """Leave nothing behind: no process, no pipe, no partial file."""
        self._child.end(0.0 if self._job is None else _GRACE_S)
        if self._job is not None and self._job.out is not None:
            partial_path(self._job.out, self._child.pid).unlink(missing_ok=True)

    def _outcome(
        self, on_progress: Callable[[float], None] | None, cancelled: threading.Event
    ) -> RenderResult:
        while True:
            if cancelled.is_set():
                self.close()
                raise Cancelled("Rendering was cancelled.")
            if not self._child.has_message(_POLL_S):
                continue
            kind, value = self._child.receive()
            if kind == "progress":
                if on_progress is not None:
                    on_progress(value)
            elif kind == "done":
                return value
            else:
                raise KNOWN_ERRORS[kind](value)


def failure(what: str, ended: Ended) -> RuntimeError:
    """Of a process that draws and has ended without a word: a driver's crash, or a bug of ours.

    Args:
        what: the process, as the beginning of a sentence.
    """
    told = ended.sentences(
        what,
        "draw smaller or fewer videos at once",
        "start it again, which is done by a fresh process",
        "This is most likely the OpenGL driver.",
    )
    return GLError(told) if ended.signal is not None else RuntimeError(told)
