"""The child's side of ``renderer.video.workers``: take jobs, do them, tell how each went."""

import queue
import sys
import threading
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

from processes.child import parent_channel
from renderer.body.body import load_body
from renderer.body.body_file import BodyError
from renderer.draw.offscreen import GLError
from renderer.video.encoder import Cancelled, VideoError, VideoWriter
from renderer.video.render import PIECE_FRAMES, check_frames, draw_frames, stage_for
from renderer.video.workers import RenderJob, drawn_by_several

_KNOWN_ERRORS = (BodyError, Cancelled, GLError, ValueError, VideoError)
"""Each holds one sentence."""

Tell = Callable[[str, Any], None]


def main() -> int:
    """Messages leave as ``(kind, value)``: share, picture, done, failed."""
    channel, _ = parent_channel()
    jobs: queue.SimpleQueue[RenderJob | None] = queue.SimpleQueue()
    # Who draws pictures may be ahead by one piece of who takes them.
    told: queue.Queue[tuple[str, Any]] = queue.Queue(maxsize=PIECE_FRAMES)
    parent_hung_up = threading.Event()
    threading.Thread(target=_listen, args=(channel, jobs, parent_hung_up), daemon=True).start()
    threading.Thread(target=_tell_all, args=(channel, told), daemon=True).start()
    while (job := jobs.get()) is not None:
        try:
            _do(job, lambda kind, value: told.put((kind, value)), parent_hung_up.is_set)
            told.put(("done", None))
        except _KNOWN_ERRORS as error:
            told.put(("failed", error))
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


def _tell_all(channel: Connection, told: queue.Queue[tuple[str, Any]]) -> None:
    while True:
        message = told.get()
        with suppress(OSError):  # nobody wants the rest
            channel.send(message)


def _do(job: RenderJob, tell: Tell, should_cancel: Callable[[], bool]) -> None:
    """Memory does not grow with the length: each frame is drawn and encoded before the next."""
    body, settings = load_body(job.body_path, job.look), job.settings
    check_frames(job.still_frames, job.motion)
    job = replace(job, stage=job.stage or stage_for(body, [job.motion], settings))
    looks = body, job.motion, settings, job.stage, job.marks
    if job.out is None:
        for picture in draw_frames(*looks, job.still_frames):
            if should_cancel():
                return
            tell("picture", picture.copy())
        return
    count, stills = job.motion.num_frames, {}
    is_shared = job.num_processes is not None and job.num_processes > 1
    with (
        closing(drawn_by_several(job) if is_shared else draw_frames(*looks)) as pictures,
        VideoWriter(job.out, *settings.picture_size, count, job.speech_wav, settings.crf) as video,
    ):
        for index, picture in enumerate(pictures):
            if should_cancel():
                raise Cancelled(f"Rendering {job.out.name} was cancelled.")
            video.write(picture)
            if index in job.still_frames:
                stills[index] = picture.copy()
            tell("share", (index + 1) / count)
    for frame in job.still_frames:
        tell("picture", stills[frame])


if __name__ == "__main__":
    sys.exit(main())
