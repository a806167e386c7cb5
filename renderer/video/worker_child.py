"""The child's side of ``renderer.video.workers``: take jobs, do them, tell how each went."""

import sys
from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np
from jaxtyping import UInt8

from processes.child import parent_channel
from renderer.body.body import load_body
from renderer.body.body_file import BodyError
from renderer.draw.offscreen import GLError
from renderer.video.encoder import VideoError, VideoWriter
from renderer.video.render import check_frames, draw_frames, stacked
from renderer.video.workers import RenderJob

_KNOWN_ERRORS = (BodyError, GLError, ValueError, VideoError)
"""Each holds one sentence."""


def main() -> int:
    """Messages leave as ``(kind, value)``: share, done with the stills, failed."""
    channel, _ = parent_channel()

    def tell(kind: str, value: Any) -> None:
        try:
            channel.send((kind, value))
        except OSError:
            sys.exit()  # nobody wants the rest; no half-written file stays

    while True:
        try:
            job = channel.recv()
        except (EOFError, OSError):
            return 0
        try:
            tell("done", _done(job, lambda share: tell("share", share)))
        except _KNOWN_ERRORS as error:
            tell("failed", error)


def _done(job: RenderJob, tell: Callable[[float], None]) -> UInt8[np.ndarray, "N H W C"]:
    """Do a job. Memory does not grow with the length of a video: each frame is drawn and encoded
    before the next."""
    body, settings = load_body(job.body_path, job.look), job.settings
    check_frames(job.still_frames, job.motion)
    looks = body, job.motion, settings, job.stage, job.marks
    if job.out is None:
        return stacked(map(np.copy, draw_frames(*looks, job.still_frames)), settings)
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
    return stacked((stills[frame] for frame in job.still_frames), settings)


if __name__ == "__main__":
    sys.exit(main())
