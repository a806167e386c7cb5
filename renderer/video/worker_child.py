"""The child's side of ``renderer.video.worker_process``: read jobs, do them, tell how each went."""

import os
import pickle
import queue
import sys
import threading
from collections.abc import Callable

import numpy as np
from jaxtyping import UInt8

from renderer.body.body import load_body
from renderer.video.job import KNOWN_ERRORS, RenderJob, RenderResult
from renderer.video.parallel import draw_in_processes
from renderer.video.render import render_stills, render_video


def main() -> int:
    """Messages leave as pickled ``(kind, value)``: progress, done, or the name of an error."""
    # They take a private copy of standard output, so that what libraries print does no harm.
    channel = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    jobs: queue.SimpleQueue[RenderJob | None] = queue.SimpleQueue()
    parent_hung_up = threading.Event()
    threading.Thread(target=_listen, args=(jobs, parent_hung_up), daemon=True).start()

    def send(kind: str, value: object) -> None:
        pickle.dump((kind, value), channel)
        channel.flush()

    while (job := jobs.get()) is not None:
        try:
            stills = _run(job, lambda share: send("progress", share), parent_hung_up.is_set)
            send("done", RenderResult(job.out, stills))
        except BrokenPipeError:  # the parent is gone
            return 1
        except tuple(KNOWN_ERRORS.values()) as error:
            name = type(error).__name__
            send(name if name in KNOWN_ERRORS else ValueError.__name__, str(error))
    return 0


def _listen(jobs: queue.SimpleQueue[RenderJob | None], parent_hung_up: threading.Event) -> None:
    """Jobs come until the pipe closes, which also ends the job under way."""
    try:
        while True:
            jobs.put(pickle.load(sys.stdin.buffer))
    except (EOFError, pickle.UnpicklingError):  # between jobs, or in the middle of one
        pass
    finally:
        parent_hung_up.set()
        jobs.put(None)


def _run(
    job: RenderJob, on_progress: Callable[[float], None], should_cancel: Callable[[], bool]
) -> UInt8[np.ndarray, "N H W 3"]:
    body = load_body(job.body_path, job.look)
    if job.out is None:
        return render_stills(
            *(body, job.motion, job.still_frames, job.settings), stage=job.stage, marks=job.marks
        )
    pictures = None
    if job.num_processes and job.num_processes > 1:
        shared = (body, job.motion, job.settings, job.stage)
        pictures = draw_in_processes(*shared, count=job.num_processes, marks=job.marks)
    return render_video(
        *(body, job.motion, job.out, job.speech_wav, job.settings, on_progress, should_cancel),
        stage=job.stage,
        marks=job.marks,
        still_frames=job.still_frames,
        pictures=pictures,
    )


if __name__ == "__main__":
    sys.exit(main())
