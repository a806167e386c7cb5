"""A body and its motion into a video or stills: skinning, drawing and encoding, frame by frame.

Everything streams: vertices come in chunks, each frame is drawn and handed to the encoder before
the next is touched, so memory does not grow with the length of a clip.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from renderer.body.body import Body, BodyMotion
from renderer.draw.make import make_renderer
from renderer.draw.offscreen import Backend
from renderer.draw.probe import choose_backend
from renderer.stage.camera import VIEWS
from renderer.stage.stage import Stage, camera_track, frames_of, set_stage
from renderer.stage.studio import FramePreparer, Studio, Subject
from renderer.video.encoder import DEFAULT_CRF, Cancelled, VideoWriter, check_size

__all__ = ["Cancelled", "RenderSettings", "draw_motion", "render_stills", "render_video"]

MIN_SIZE_PX = 64
MAX_SIZE_PX = 2160
PIECE_FRAMES = 16
"""Frames that are skinned at once."""

OnProgress = Callable[[float], None]
ShouldCancel = Callable[[], bool]


@dataclass(frozen=True)
class RenderSettings:
    """How pictures are made. Equal settings and an equal ``Stage`` give comparable pictures."""

    width: int = 512
    height: int = 512
    view: str = "front"
    """One of ``camera.VIEWS``."""
    antialias: bool = True
    """Four samples a pixel; off is for drafts."""
    crf: int = DEFAULT_CRF
    """x264's constant quality, 0 to 51; lower is better and larger."""
    backend: Backend | None = None
    """What draws; None takes the first that works here."""
    studio: Studio = field(default_factory=Studio)
    is_transparent: bool = False
    """Pictures of the body alone, with a fourth channel for what it covers; no videos."""

    def __post_init__(self) -> None:
        check_size(self.width, self.height)
        if min(self.width, self.height) < MIN_SIZE_PX or max(self.width, self.height) > MAX_SIZE_PX:
            raise ValueError(
                f"A picture of {self.width} x {self.height} pixels is outside the limits; "
                f"each side may have {MIN_SIZE_PX} to {MAX_SIZE_PX}."
            )
        if self.view not in VIEWS:
            raise ValueError(f"View {self.view!r} is unknown; choose one of {', '.join(VIEWS)}.")
        if not 0 <= self.crf <= 51:
            raise ValueError(f"`crf` is {self.crf}; it must lie between 0 and 51.")

    @property
    def aspect(self) -> float:
        return self.width / self.height

    @property
    def num_channels(self) -> int:
        return 4 if self.is_transparent else 3


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
    size = (settings.width, settings.height)
    with (
        closing(pictures or draw_motion(body, motion, settings, stage)) as pictures,
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
    stage = stage or set_stage(body, [motion], settings.view, settings.aspect)
    pictures = draw_frames(body, motion, frames, settings, stage)
    for picture, frame in zip(pictures, frames, strict=True):
        stills.offer(frame, picture)
    return stills.pictures


def draw_motion(
    body: Body, motion: BodyMotion, settings: RenderSettings, stage: Stage | None = None
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the picture of each frame. Each is overwritten by the next; close it to stop early."""
    stage = stage or set_stage(body, [motion], settings.view, settings.aspect)
    return draw_frames(body, motion, slice(None), settings, stage)


def draw_frames(
    body: Body,
    motion: BodyMotion,
    frames: slice | Sequence[int],
    settings: RenderSettings,
    stage: Stage,
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the pictures of some frames of a motion. Each is overwritten by the next."""
    frames = frames if isinstance(frames, slice) else list(frames)
    return draw_vertices(
        *(body.vertices(frames_of(motion, frames), chunk=PIECE_FRAMES), body.faces),
        colors=body.vertex_colors,
        settings=settings,
        stage=stage,
        track=camera_track(body, motion, settings.view, stage)[frames],
    )


def draw_vertices(
    chunks: Iterable[Float[np.ndarray, "chunk V 3"]],
    faces: np.ndarray,
    colors: Float[np.ndarray, "V 3"] | None,
    *,
    settings: RenderSettings,
    stage: Stage,
    track: Float[np.ndarray, "T 3"] | None = None,
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the picture of each set of vertices, with one context, scene and buffer for all.

    Args:
        track: where the camera stands in each frame, relative to ``stage.camera``; None, as it is.
    """
    frames = chain.from_iterable(chunks)
    first = next(frames, None)
    if first is None:
        return
    prepare = FramePreparer(faces, len(first), stage, settings.studio)
    subject = Subject(
        *(faces, colors, prepare.ground.corners(), settings.studio, settings.is_transparent)
    )
    with make_renderer(
        *(subject, settings.width, settings.height, settings.backend or choose_backend()),
        antialias="supersample" if settings.antialias else "none",
    ) as renderer:
        for index, vertices in enumerate(chain([first], frames)):
            camera = stage.camera if track is None else stage.camera.moved(track[index])
            yield renderer.draw(prepare(vertices), camera)


class _Stills:
    """Collects pictures of chosen frames out of a stream."""

    def __init__(self, frames: Sequence[int], num_frames: int, settings: RenderSettings) -> None:
        for frame in frames:
            if not 0 <= frame < num_frames:
                raise ValueError(f"Frame {frame} was asked for; the motion has {num_frames}.")
        self._frames = np.asarray(frames, dtype=np.intp)
        size = (settings.height, settings.width, settings.num_channels)
        self.pictures = np.zeros((len(frames), *size), np.uint8)

    def offer(self, index: int, picture: UInt8[np.ndarray, "H W C"]) -> None:
        for slot in np.flatnonzero(self._frames == index):
            self.pictures[slot] = picture
