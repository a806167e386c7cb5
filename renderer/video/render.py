"""A body and its motion into a video or stills: skinning, drawing and encoding, frame by frame.

Everything streams: vertices come in chunks, each frame is drawn and handed to the encoder before
the next is touched, so memory does not grow with the length of a clip.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from renderer.body.body import Body, BodyMotion
from renderer.scene.stage import Stage
from renderer.video.encoder import Cancelled, VideoWriter
from renderer.video.frames import draw_frames, draw_motion, stage_for
from renderer.video.marks import Marks
from renderer.video.settings import RenderSettings

__all__ = ["Cancelled", "RenderSettings", "draw_motion", "render_stills", "render_video"]

OnProgress = Callable[[float], None]
ShouldCancel = Callable[[], bool]


def render_video(
    body: Body,
    motion: BodyMotion,
    out: Path,
    speech_wav: Path | None = None,
    settings: RenderSettings | None = None,
    on_progress: OnProgress | None = None,
    should_cancel: ShouldCancel | None = None,
    *,
    stage: Stage | None = None,
    marks: Marks | None = None,
    still_frames: Sequence[int] = (),
    pictures: Generator[UInt8[np.ndarray, "H W 3"]] | None = None,
) -> UInt8[np.ndarray, "N H W 3"]:
    """Write the motion as an mp4 at 30 fps with as many frames as it has.

    Args:
        speech_wav: sound; cut or padded with silence to the length of the motion.
        on_progress: called with the share done, 0 to 1.
        should_cancel: asked before every frame.
        stage: camera and floor; by default made for this motion alone. Give the same one to all
            videos of a comparison.
        marks: what else is shown in the pictures.
        still_frames: frames that are also returned as pictures, in this order.
        pictures: of all frames in order, drawn elsewhere; by default they are drawn here. Closed
            in any case.

    Returns:
        The pictures of ``still_frames``.

    Raises:
        Cancelled: if ``should_cancel`` said so; no file is left.
        GLError, VideoError: with one sentence; no file is left.
        ValueError: if a still lies outside the motion.
    """
    settings = settings or RenderSettings()
    stills = _Stills(still_frames, motion.num_frames, settings)
    size = settings.picture_size
    with (
        closing(pictures or draw_motion(body, motion, settings, stage, marks)) as pictures,
        VideoWriter(out, *size, motion.num_frames, speech_wav, settings.crf) as video,
    ):
        for index, picture in enumerate(pictures):
            if should_cancel is not None and should_cancel():
                raise Cancelled(f"Rendering {out.name} was cancelled.")
            video.write(picture)
            stills.offer(index, picture)
            if on_progress is not None:
                on_progress((index + 1) / motion.num_frames)
    return stills.pictures


def render_stills(
    body: Body,
    motion: BodyMotion,
    frames: Sequence[int],
    settings: RenderSettings | None = None,
    *,
    stage: Stage | None = None,
    marks: Marks | None = None,
) -> UInt8[np.ndarray, "N H W C"]:
    """Pictures of single frames, framed as the video of the whole motion would be.

    Raises:
        GLError: if nothing can be drawn.
        ValueError: if a frame lies outside the motion.
    """
    settings = settings or RenderSettings()
    stills = _Stills(frames, motion.num_frames, settings)
    if not len(frames):
        return stills.pictures
    stage = stage or stage_for(body, [motion], settings)
    pictures = draw_frames(body, motion, frames, settings, stage, marks)
    for picture, frame in zip(pictures, frames, strict=True):
        stills.offer(frame, picture)
    return stills.pictures


class _Stills:
    """Collects pictures of chosen frames out of a stream."""

    def __init__(self, frames: Sequence[int], num_frames: int, settings: RenderSettings) -> None:
        for frame in frames:
            if not 0 <= frame < num_frames:
                raise ValueError(f"Frame {frame} was asked for; the motion has {num_frames}.")
        self._frames = np.asarray(frames, dtype=np.intp)
        width, height = settings.picture_size
        size = (height, width, settings.num_channels)
        self.pictures = np.zeros((len(frames), *size), np.uint8)

    def offer(self, index: int, picture: UInt8[np.ndarray, "H W C"]) -> None:
        for slot in np.flatnonzero(self._frames == index):
            self.pictures[slot] = picture
