"""The child's side of ``renderer.video.worker_process``: read jobs, do them, tell how each went."""

import queue
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection

import numpy as np
from jaxtyping import UInt8

from processes.child import parent_channel
from renderer.body.body import load_body
from renderer.video.parallel import draw_in_processes
from renderer.video.render import render_stills, render_video
from renderer.video.worker_process import KNOWN_ERRORS, RenderJob, RenderResult


def main() -> int:
    """Messages leave as ``(kind, value)``: progress, done, or the name of an error."""
    channel, _ = parent_channel()
    jobs: queue.SimpleQueue[RenderJob | None] = queue.SimpleQueue()
    parent_hung_up = threading.Event()
    threading.Thread(target=_listen, args=(channel, jobs, parent_hung_up), daemon=True).start()
    while (job := jobs.get()) is not None:
        try:
            stills = _run(
                job, lambda share: channel.send(("progress", share)), parent_hung_up.is_set
            )
            channel.send(("done", RenderResult(job.out, stills)))
        except ConnectionError:  # the parent is gone
            return 1
        except tuple(KNOWN_ERRORS.values()) as error:
            name = type(error).__name__
            channel.send((name if name in KNOWN_ERRORS else ValueError.__name__, str(error)))
    return 0


def _listen(
    channel: Connection, jobs: queue.SimpleQueue[RenderJob | None], parent_hung_up: threading.Event
) -> None:
    """Jobs come until the channel closes, which also ends the job under way."""
    try:
        while True:
            jobs.put(channel.recv())
    except (EOFError, OSError):
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
