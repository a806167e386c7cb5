"""Rendering of a motion in panels, streamed: memory does not grow with the clip's length."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, repeat

import numpy as np
from jaxtyping import Float, UInt8

from conventions.views import Framing
from renderer.body.body import Body, BodyMotion
from renderer.body.lod import select_lod
from renderer.draw.offscreen import Backend, OffscreenRenderer
from renderer.draw.probe import choose_backend
from renderer.scene import camera_setup
from renderer.scene.camera import Camera
from renderer.scene.camera_setup import CameraSetup, Panel, PanelCamera
from renderer.scene.studio import PosedFrame, PosedFrameBuilder, StaticBody
from renderer.video.encoder import DEFAULT_CRF, check_video_size
from renderer.video.overlays import OverlayPainter, Overlays, heat_colors

MIN_SIZE_PX, MAX_SIZE_PX = 64, 2160
_LINE_PX, _LINE = 2, 255
"""Width and grey level of the white lines between panels."""


@dataclass(frozen=True)
class RenderSettings:
    """Settings of pictures. Equal settings and an equal `CameraSetup` give comparable pictures."""

    width: int = 512
    height: int = 512
    """Size of the body's panel (pixels); close-ups make the picture higher."""
    view: str = "front"
    """View, one of ``conventions.views.VIEWS``."""
    framing: Framing = "whole"
    """Framing of a view that is not a close-up."""
    crf: int = DEFAULT_CRF
    """x264's constant quality, 0 to 51; lower is better and larger."""
    backend: Backend | None = None
    """OpenGL backend; None selects the first that works."""
    layout: tuple[Panel, ...] | None = None
    """Panels from `layout_panels`: first the body, of ``width`` and ``height``, then the
    close-ups; None for the body alone."""
    is_transparent: bool = False
    """True for pictures of the body alone with an alpha channel; not for videos."""

    def __post_init__(self) -> None:
        check_video_size(self.width, self.height)
        if min(self.width, self.height) < MIN_SIZE_PX or max(self.width, self.height) > MAX_SIZE_PX:
            raise ValueError(
                f"A picture of {self.width} x {self.height} pixels is outside the limits; "
                f"each side must have {MIN_SIZE_PX} to {MAX_SIZE_PX} pixels."
            )
        check_video_size(*self.picture_size)

    @property
    def aspect(self) -> float:
        """Width over height of the body's own panel."""
        return self.width / self.height

    @property
    def panels(self) -> tuple[Panel, ...]:
        """Panels of the body, then of the close-ups."""
        return self.layout or (Panel(self.view, 0, 0, self.width, self.height),)

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of all panels together."""
        panels = self.panels
        width = max(panel.left + panel.width for panel in panels)
        return width, max(panel.top + panel.height for panel in panels)

    @property
    def picture_shape(self) -> tuple[int, int, int]:
        """Shape of a picture's array (H, W, C)."""
        width, height = self.picture_size
        return height, width, 4 if self.is_transparent else 3


def camera_setup_for(
    body: Body, motions: Sequence[BodyMotion], settings: RenderSettings
) -> CameraSetup:
    """Make the stage for pictures of these motions with these settings."""
    return camera_setup.make_camera_setup(
        body,
        motions,
        settings.view,
        settings.aspect,
        close_ups=settings.panels[1:],
        framing=settings.framing,
    )


def draw_frames(
    body: Body,
    motion: BodyMotion,
    settings: RenderSettings,
    stage: CameraSetup | None = None,
    overlays: Overlays | None = None,
    frames: slice | Sequence[int] = slice(None),
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the pictures of some frames of a motion; each is overwritten by the next.

    Close the generator to stop early. By default the stage, camera and floor, is made for this
    motion alone. Raises ValueError if a frame is outside the motion, or the stage has other
    close-ups than the settings.
    """
    if not isinstance(frames, slice):
        check_frames(frames, motion)
        frames = list(frames)
    numbers = np.arange(motion.num_frames)[frames]
    if not len(numbers):
        return
    stage, panels = stage or camera_setup_for(body, [motion], settings), settings.panels
    if [shot.view for shot in stage.panel_cameras[1:]] != [panel.view for panel in panels[1:]]:
        raise ValueError("The camera setup and the settings have different close-ups.")
    meshes = [
        select_panel_mesh(body, stage, *each)
        for each in zip(stage.panel_cameras, panels, strict=True)
    ]
    ways = [track[frames] for track in stage.followed_positions(body, motion)]
    heat = overlays and overlays.heat
    painter = OverlayPainter(overlays, panels) if overlays else None
    chosen = camera_setup.select_frames(motion, frames)
    vertices = [chain.from_iterable(mesh.posed_vertices(chosen)) for mesh in meshes]
    colors = [
        heat_colors(mesh, heat.normalized_jerk[frames]) if heat else repeat(None) for mesh in meshes
    ]
    prepare = [PosedFrameBuilder(m.faces, m.num_vertices, stage, m.texture) for m in meshes]
    corners = prepare[0].ground.corners()
    whole = np.full(settings.picture_shape, _LINE, np.uint8)
    with OffscreenRenderer(settings.backend or choose_backend()) as renderer:
        canvases = [
            renderer.make_canvas(
                StaticBody(
                    mesh.faces, mesh.vertex_colors, corners, settings.is_transparent, mesh.texture
                ),
                panel.width,
                panel.height,
            )
            for panel, mesh in zip(panels, meshes, strict=True)
        ]

        def fetch() -> None:
            for panel, canvas in zip(panels, canvases, strict=True):
                whole[panel.box] = canvas.read_pixels()
            _draw_panel_borders(whole, panels)

        def cameras(index: int) -> list[Camera]:
            each = zip(stage.panel_cameras, ways, strict=True)
            return [shot.camera.translated(way[index]) for shot, way in each]

        def painted(index: int) -> UInt8[np.ndarray, "H W C"]:
            if painter is None:
                return whole
            return painter.paint(whole, int(numbers[index]), cameras(index))

        for index in range(len(numbers)):
            # Posed while the driver draws the previous picture; the caller takes it meanwhile.
            posed: list[PosedFrame] = []
            for prepared, places, shades in zip(prepare, vertices, colors, strict=True):
                posed.append(prepared(next(places), next(shades), posed[0] if posed else None))
            if index:
                fetch()
            for frame, canvas, camera in zip(posed, canvases, cameras(index), strict=True):
                canvas.begin_frame(frame, camera)
            if index:
                yield painted(index - 1)
        fetch()
        yield painted(len(numbers) - 1)


def select_panel_mesh(
    body: Body, stage: CameraSetup, panel_camera: PanelCamera, panel: Panel
) -> Body:
    """Return the part of a body that a panel shows, with a level of detail for its pixels."""
    pixel_size_m = stage.pixel_size_m(panel_camera, panel.height)
    mesh = select_lod(body, body.height_m / pixel_size_m) if pixel_size_m > 0.0 else body
    if panel_camera is stage.panel_cameras[0]:
        return mesh
    part = camera_setup.close_up_mesh(mesh, panel.view)
    return mesh.submesh(part.vertices, part.faces)


def _draw_panel_borders(picture: UInt8[np.ndarray, "H W C"], panels: Sequence[Panel]) -> None:
    """Draw a white line above and left of every panel that has a neighbour there."""
    for panel in panels:
        rows, columns = panel.box
        if panel.top:
            picture[panel.top - _LINE_PX // 2 : panel.top + _LINE_PX // 2, columns] = _LINE
        if panel.left:
            picture[rows, panel.left - _LINE_PX // 2 : panel.left + _LINE_PX // 2] = _LINE


def check_frames(frames: Sequence[int], motion: BodyMotion) -> None:
    """Check that all frames are within a motion; raises ValueError if one is outside."""
    for frame in frames:
        if not 0 <= frame < motion.num_frames:
            raise ValueError(
                f"Frame {frame} is outside the motion, which has {motion.num_frames} frames."
            )


def stack_pictures(
    pictures: Iterable[UInt8[np.ndarray, "H W C"]], settings: RenderSettings
) -> np.ndarray:
    """Stack pictures into one array (N, H, W, C); N is 0 without any."""
    return np.reshape(list(pictures), (-1, *settings.picture_shape)).astype(np.uint8, copy=False)


def projected_joints(
    body: Body,
    motion: BodyMotion,
    frames: Sequence[int],
    settings: RenderSettings,
    stage: CameraSetup,
) -> Float[np.ndarray, "N J 2"]:
    """Return pixels (x, y) of all joints in the body's panel, from its upper left corner.

    The panels are those of ``draw_frames`` with these settings on this stage, also if the camera
    follows the body. A joint may be outside the panel, or hidden behind the body.
    """
    chosen = list(frames)
    joints = body.joint_positions(camera_setup.select_frames(motion, chosen))
    track = stage.followed_positions(body, motion)[0][chosen]
    size = (settings.width, settings.height)
    return np.stack(
        [
            stage.camera.translated(offset).project(points, *size)
            for offset, points in zip(track, joints, strict=True)
        ]
    )
