"""A body and its motion into pictures, a video or stills: posed, lit, drawn, put together.

Everything streams: vertices come in chunks, each frame is drawn and handed to the encoder before
the next is touched, so memory does not grow with the length of a clip.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from renderer.body.body import Body, BodyMotion
from renderer.draw.offscreen import OffscreenRenderer
from renderer.draw.probe import choose_backend
from renderer.scene.camera import Camera
from renderer.scene.panels import Cutout, Panel, cut_out
from renderer.scene.stage import Stage, camera_track, close_up_tracks, frames_of, set_stage
from renderer.scene.studio import FramePreparer, Subject
from renderer.video.encoder import Cancelled, VideoWriter
from renderer.video.marks import MarkPainter, Marks, heat_colors
from renderer.video.settings import RenderSettings

PIECE_FRAMES = 16
"""Frames that are skinned at once."""
_LINE_PX, _LINE = 2, 255
"""White between panels."""


@dataclass(frozen=True)
class CloseUp:
    """What one panel beside the body shows."""

    panel: Panel
    camera: Camera
    track: Float[np.ndarray, "T 3"]
    """Where the camera stands in each frame, relative to ``camera``."""
    part: Cutout


def stage_for(body: Body, motions: Sequence[BodyMotion], settings: RenderSettings) -> Stage:
    """The stage of pictures with these settings that shows all of these motions."""
    return set_stage(
        *(body, motions, settings.view, settings.aspect, settings.panels[1:]),
        framing=settings.framing,
    )


def draw_motion(
    body: Body,
    motion: BodyMotion,
    settings: RenderSettings,
    stage: Stage | None = None,
    marks: Marks | None = None,
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the picture of each frame. Each is overwritten by the next; close it to stop early."""
    stage = stage or stage_for(body, [motion], settings)
    return draw_frames(body, motion, slice(None), settings, stage, marks)


def draw_frames(
    body: Body,
    motion: BodyMotion,
    frames: slice | Sequence[int],
    settings: RenderSettings,
    stage: Stage,
    marks: Marks | None = None,
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the pictures of some frames of a motion. Each is overwritten by the next.

    Raises:
        ValueError: if the stage was set for other close-ups than the settings name.
    """
    frames = frames if isinstance(frames, slice) else list(frames)
    track = camera_track(body, motion, settings.view, stage)[frames]
    close_ups = _close_ups(body, motion, frames, settings, stage)
    pictures = draw_vertices(
        *(body.vertices(frames_of(motion, frames), chunk=PIECE_FRAMES), body.faces),
        colors=body.vertex_colors,
        settings=settings,
        stage=stage,
        track=track,
        close_ups=close_ups,
        moving_colors=None if marks is None else _heat(body, marks, frames),
    )
    if marks is None:
        yield from pictures
        return
    painter = MarkPainter(marks, settings.panels)
    numbers = np.arange(motion.num_frames)[frames]
    for index, picture in enumerate(pictures):
        cameras = [stage.camera.moved(track[index])]
        cameras += [each.camera.moved(each.track[index]) for each in close_ups]
        yield painter.paint(picture, int(numbers[index]), cameras)


def _heat(
    body: Body, marks: Marks, frames: slice | list[int]
) -> Iterable[Float[np.ndarray, "V 3"]] | None:
    return None if marks.heat is None else heat_colors(body, marks.heat.shares[frames])


def _close_ups(
    body: Body,
    motion: BodyMotion,
    frames: slice | list[int],
    settings: RenderSettings,
    stage: Stage,
) -> list[CloseUp]:
    panels = settings.panels[1:]
    shots = stage.close_ups
    if [shot.view for shot in shots] != [panel.view for panel in panels]:
        raise ValueError("The stage was set for other close-ups than these pictures have.")
    tracks = close_up_tracks(body, motion, stage)
    return [
        CloseUp(panel, shot.camera, track[frames], cut_out(body, panel.view))
        for panel, shot, track in zip(panels, shots, tracks, strict=True)
    ]


def draw_vertices(
    chunks: Iterable[Float[np.ndarray, "chunk V 3"]],
    faces: np.ndarray,
    colors: Float[np.ndarray, "V 3"] | None,
    *,
    settings: RenderSettings,
    stage: Stage,
    track: Float[np.ndarray, "T 3"] | None = None,
    close_ups: Sequence[CloseUp] = (),
    moving_colors: Iterable[Float[np.ndarray, "V 3"]] | None = None,
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the picture of each set of vertices, with one context, and a scene and buffer for each
    panel.

    Args:
        track: where the camera stands in each frame, relative to ``stage.camera``; None, as it is.
        moving_colors: of each frame; None, ``colors`` in all.
    """
    frames = chain.from_iterable(chunks)
    first = next(frames, None)
    if first is None:
        return
    prepare = FramePreparer(faces, len(first), stage, settings.studio)
    subject = Subject(
        *(faces, colors, prepare.ground.corners(), settings.studio, settings.is_transparent)
    )
    colors_of_frame = None if moving_colors is None else iter(moving_colors)
    with OffscreenRenderer(
        *(subject, settings.width, settings.height, settings.backend or choose_backend()),
        antialias="supersample" if settings.antialias else "none",
    ) as renderer:
        beside = [
            renderer.beside(_part_of(subject, each.part), each.panel.width, each.panel.height)
            for each in close_ups
        ]
        whole = _empty_picture(settings)
        for index, vertices in enumerate(chain([first], frames)):
            posed = prepare(vertices, None if colors_of_frame is None else next(colors_of_frame))
            camera = stage.camera if track is None else stage.camera.moved(track[index])
            picture = renderer.draw(posed, camera)
            if not close_ups:
                yield picture
                continue
            whole[settings.panels[0].box] = picture
            for each, canvas in zip(close_ups, beside, strict=True):
                near = each.camera.moved(each.track[index])
                drawn = canvas.draw(posed.part(each.part.vertices), near)
                whole[each.panel.box] = drawn
            _rule_off(whole, settings.panels)
            yield whole


def _part_of(subject: Subject, part: Cutout) -> Subject:
    colors = None if subject.colors is None else subject.colors[part.vertices]
    return Subject(part.faces, colors, subject.ground_corners, subject.studio)


def _empty_picture(settings: RenderSettings) -> UInt8[np.ndarray, "H W C"]:
    width, height = settings.picture_size
    return np.full((height, width, settings.num_channels), _LINE, np.uint8)


def _rule_off(picture: UInt8[np.ndarray, "H W 3"], panels: Sequence[Panel]) -> None:
    """A white line above and left of every panel that has a neighbour there."""
    for panel in panels:
        rows, columns = panel.box
        if panel.top:
            picture[panel.top - _LINE_PX // 2 : panel.top + _LINE_PX // 2, columns] = _LINE
        if panel.left:
            picture[rows, panel.left - _LINE_PX // 2 : panel.left + _LINE_PX // 2] = _LINE


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


def projected_joints(
    body: Body, motion: BodyMotion, frames: Sequence[int], settings: RenderSettings, stage: Stage
) -> Float[np.ndarray, "N J 2"]:
    """Pixels of all joints in the pictures of some frames, (0, 0) at the upper left corner.

    The pictures are those that ``render_stills`` and ``render_video`` make with these settings on
    this stage, also where the camera follows the body. A joint may lie outside its picture, or be
    hidden behind the body in it.
    """
    chosen = list(frames)
    joints = body.joint_positions(frames_of(motion, chosen))
    track = camera_track(body, motion, settings.view, stage)[chosen]
    size = (settings.width, settings.height)
    return np.stack(
        [
            stage.camera.moved(offset).project(points, *size)
            for offset, points in zip(track, joints, strict=True)
        ]
    )
