"""A body and its motion into a stream of pictures: posed, lit, drawn in panels.

Everything streams: vertices come in chunks, each frame is drawn and handed to the encoder before
the next is touched, so memory does not grow with the length of a clip.
"""

from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from jaxtyping import Float, UInt8

from conventions.views import Framing
from renderer.body.body import Body, BodyMotion
from renderer.draw.offscreen import Backend, OffscreenRenderer
from renderer.draw.probe import choose_backend
from renderer.scene.camera import Camera
from renderer.scene.stage import (
    Cutout,
    Panel,
    Stage,
    cut_out,
    frames_of,
    lay_out,
    set_stage,
)
from renderer.scene.studio import FramePreparer, Subject
from renderer.video.encoder import DEFAULT_CRF, check_size
from renderer.video.marks import MarkPainter, Marks, heat_colors

MIN_SIZE_PX, MAX_SIZE_PX = 64, 2160
_LINE_PX, _LINE = 2, 255
"""White between panels."""


@dataclass(frozen=True)
class RenderSettings:
    """How pictures are made. Equal settings and an equal ``Stage`` give comparable pictures."""

    width: int = 512
    height: int = 512
    view: str = "front"
    """One of ``conventions.views.VIEWS``."""
    framing: Framing = "whole"
    """How much of the body a view shows that is no close-up."""
    close_ups: tuple[str, ...] = ()
    """Of `CLOSE_UPS`, beside the picture, in the same video."""
    crf: int = DEFAULT_CRF
    """x264's constant quality, 0 to 51; lower is better and larger."""
    backend: Backend | None = None
    """What draws; None takes the first that works here."""
    layout: tuple[Panel, ...] | None = None
    """Where the body, which comes first and is as large as ``width`` and ``height`` say, and the
    close-ups stand; None as ``close_ups`` are laid out."""
    is_transparent: bool = False
    """Pictures of the body alone, with a fourth channel for what it covers; no videos and no
    close-ups."""

    def __post_init__(self) -> None:
        check_size(self.width, self.height)
        if min(self.width, self.height) < MIN_SIZE_PX or max(self.width, self.height) > MAX_SIZE_PX:
            raise ValueError(
                f"A picture of {self.width} x {self.height} pixels is outside the limits; "
                f"each side may have {MIN_SIZE_PX} to {MAX_SIZE_PX}."
            )
        if self.close_ups and self.is_transparent:
            raise ValueError("A picture without a background has no close-ups beside it.")
        body = self.panels[0]
        has_both = self.layout is not None and bool(self.close_ups)
        if has_both or (body.width, body.height) != (self.width, self.height):
            raise ValueError("A layout begins with the body's panel and holds all close-ups.")
        check_size(*self.picture_size)

    @property
    def aspect(self) -> float:
        """Of the body's own panel."""
        return self.width / self.height

    @property
    def panels(self) -> tuple[Panel, ...]:
        """The body's, and after it those of the close-ups."""
        return self.layout or lay_out(self.view, self.width, self.height, self.close_ups)

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of all panels together."""
        panels = self.panels
        width = max(panel.left + panel.width for panel in panels)
        return width, max(panel.top + panel.height for panel in panels)

    @property
    def picture_shape(self) -> tuple[int, int, int]:
        """Of a picture's array."""
        width, height = self.picture_size
        return height, width, 4 if self.is_transparent else 3


def stage_for(body: Body, motions: Sequence[BodyMotion], settings: RenderSettings) -> Stage:
    """The stage of pictures with these settings that shows all of these motions."""
    return set_stage(
        *(body, motions, settings.view, settings.aspect, settings.panels[1:]),
        framing=settings.framing,
    )


@dataclass(frozen=True)
class Shown:
    """What one panel shows, from frame to frame."""

    panel: Panel
    camera: Camera
    track: Float[np.ndarray, "T 3"] | None = None
    """Where the camera stands in each frame, relative to ``camera``; None, as it is."""
    part: Cutout | None = None
    """Of the body; None is all of it."""

    def camera_at(self, index: int) -> Camera:
        return self.camera if self.track is None else self.camera.moved(self.track[index])


def draw_frames(
    body: Body,
    motion: BodyMotion,
    settings: RenderSettings,
    stage: Stage | None = None,
    marks: Marks | None = None,
    frames: slice | Sequence[int] = slice(None),
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the pictures of some frames of a motion. Each is overwritten by the next; close it to
    stop early.

    Args:
        stage: camera and floor; by default made for this motion alone.

    Raises:
        ValueError: if a frame lies outside the motion, or the stage was set for other close-ups
            than the settings name.
    """
    if not isinstance(frames, slice):
        check_frames(frames, motion)
        if not len(frames):
            return
    stage = stage or stage_for(body, [motion], settings)
    frames = frames if isinstance(frames, slice) else list(frames)
    shown = _shown(body, motion, frames, settings, stage)
    heat = marks and marks.heat
    pictures = draw_vertices(
        body.vertices(frames_of(motion, frames)),
        body.faces,
        body.vertex_colors,
        settings,
        stage,
        shown,
        heat and heat_colors(body, heat.shares[frames]),
    )
    painter = MarkPainter(marks, settings.panels) if marks else None
    with closing(pictures):
        for index, frame in enumerate(np.arange(motion.num_frames)[frames]):
            picture = next(pictures)
            if painter is not None:
                cameras = [each.camera_at(index) for each in shown]
                picture = painter.paint(picture, int(frame), cameras)
            yield picture


def _shown(
    body: Body,
    motion: BodyMotion,
    frames: slice | list[int],
    settings: RenderSettings,
    stage: Stage,
) -> list[Shown]:
    """Of each panel, in the order of the panels."""
    panels = settings.panels
    if [shot.view for shot in stage.shots[1:]] != [panel.view for panel in panels[1:]]:
        raise ValueError("The stage was set for other close-ups than these pictures have.")
    tracks = stage.tracks(body, motion)
    return [
        Shown(panel, shot.camera, track[frames], cut_out(body, panel.view) if number else None)
        for number, (panel, shot, track) in enumerate(zip(panels, stage.shots, tracks, strict=True))
    ]


def draw_vertices(
    chunks: Iterable[Float[np.ndarray, "chunk V 3"]],
    faces: np.ndarray,
    colors: Float[np.ndarray, "V 3"] | None,
    settings: RenderSettings,
    stage: Stage,
    shown: Sequence[Shown] = (),
    moving_colors: Iterable[Float[np.ndarray, "V 3"]] | None = None,
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the picture of each set of vertices, with one context, and a scene and buffer for each
    panel. Each is overwritten by the next.

    Args:
        shown: of each panel; none is the body alone before the camera of the stage.
        moving_colors: of each frame; None, ``colors`` in all.
    """
    frames = chain.from_iterable(chunks)
    first = next(frames, None)
    if first is None:
        return
    shown = shown or [Shown(settings.panels[0], stage.camera)]
    prepare = FramePreparer(faces, len(first), stage)
    subject = Subject(faces, colors, prepare.ground.corners(), settings.is_transparent)
    colors_of_frame = None if moving_colors is None else iter(moving_colors)
    backend = settings.backend or choose_backend()
    with OffscreenRenderer(backend) as renderer:
        canvases = [
            renderer.canvas(_part_of(subject, each.part), each.panel.width, each.panel.height)
            for each in shown
        ]
        whole = np.full(settings.picture_shape, _LINE, np.uint8)

        def finished() -> UInt8[np.ndarray, "H W C"]:
            for each, canvas in zip(shown, canvases, strict=True):
                whole[each.panel.box] = canvas.picture()
            _rule_off(whole, [each.panel for each in shown])
            return whole

        for index, vertices in enumerate(chain([first], frames)):
            # While the driver draws the picture before, which the caller takes while it draws this.
            posed = prepare(vertices, None if colors_of_frame is None else next(colors_of_frame))
            before = finished() if index else None
            for each, canvas in zip(shown, canvases, strict=True):
                part = posed if each.part is None else posed.part(each.part.vertices)
                canvas.begin(part, each.camera_at(index))
            if before is not None:
                yield before
        yield finished()


def _part_of(subject: Subject, part: Cutout | None) -> Subject:
    if part is None:
        return subject
    colors = None if subject.colors is None else subject.colors[part.vertices]
    return replace(subject, faces=part.faces, colors=colors)


def _rule_off(picture: UInt8[np.ndarray, "H W C"], panels: Sequence[Panel]) -> None:
    """A white line above and left of every panel that has a neighbour there."""
    if len(panels) == 1:
        return
    for panel in panels:
        rows, columns = panel.box
        if panel.top:
            picture[panel.top - _LINE_PX // 2 : panel.top + _LINE_PX // 2, columns] = _LINE
        if panel.left:
            picture[rows, panel.left - _LINE_PX // 2 : panel.left + _LINE_PX // 2] = _LINE


def check_frames(frames: Sequence[int], motion: BodyMotion) -> None:
    """
    Raises:
        ValueError: if one lies outside the motion.
    """
    for frame in frames:
        if not 0 <= frame < motion.num_frames:
            raise ValueError(f"Frame {frame} was asked for; the motion has {motion.num_frames}.")


def stacked(pictures: Iterable[np.ndarray], settings: RenderSettings) -> np.ndarray:
    """Pictures as one array, also where there is none."""
    return np.reshape(list(pictures), (-1, *settings.picture_shape)).astype(np.uint8, copy=False)


def projected_joints(
    body: Body, motion: BodyMotion, frames: Sequence[int], settings: RenderSettings, stage: Stage
) -> Float[np.ndarray, "N J 2"]:
    """Pixels of all joints in the pictures of some frames, (0, 0) at the upper left corner.

    The pictures are those that ``draw_frames`` makes with these settings on this stage, also where
    the camera follows the body. A joint may lie outside its picture, or be hidden behind the body.
    """
    chosen = list(frames)
    joints = body.joint_positions(frames_of(motion, chosen))
    track = stage.tracks(body, motion)[0][chosen]
    size = (settings.width, settings.height)
    return np.stack(
        [
            stage.camera.moved(offset).project(points, *size)
            for offset, points in zip(track, joints, strict=True)
        ]
    )
