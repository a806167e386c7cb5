"""The scene that OpenGL draws. Import it only after ``offscreen.open_gl(backend)``."""

import pyrender

from renderer.draw.gl import DynamicMesh, TexturedQuad
from renderer.scene.camera import Z_NEAR_M, Camera
from renderer.scene.studio import Light, PosedFrame, Subject


class BodyScene:
    """A pyrender scene of one body on the floor, moved in place from frame to frame."""

    def __init__(self, subject: Subject, first: PosedFrame, camera: Camera, aspect: float) -> None:
        studio = subject.studio
        colors = subject.colors_of(len(first.vertices))
        self._body = DynamicMesh(first.vertices, first.normals, colors, subject.faces)
        self._ground = TexturedQuad(subject.ground_corners, first.ground)
        background = (0.0,) * 4 if subject.is_transparent else (*studio.background, 1.0)
        self.scene = _Scene(bg_color=list(background), ambient_light=[studio.ambient] * 3)
        self.scene.add(self._body.mesh)
        if not subject.is_transparent:
            self.scene.add(self._ground.mesh)
        self._camera = self.scene.add(
            pyrender.PerspectiveCamera(yfov=camera.yfov_rad, aspectRatio=aspect, znear=Z_NEAR_M),
            pose=camera.pose(),
        )
        for name in ("key", "fill", "rim"):
            light: Light = getattr(studio, name)
            facing = Camera(eye=light.towards, target=(0.0, 0.0, 0.0))
            self.scene.add(
                pyrender.DirectionalLight(color=light.color, intensity=light.intensity),
                name=name,
                pose=facing.pose(),
            )

    def show(self, frame: PosedFrame, camera: Camera) -> None:
        """Move the body, its shadow and the camera. The OpenGL context must be current."""
        self.scene.set_pose(self._camera, camera.pose())
        self._body.move(frame.vertices, frame.normals, frame.colors)
        self._ground.show(frame.ground)


class _Scene(pyrender.Scene):
    """A scene whose lights have an order.

    pyrender keeps them in a set, by where they lie in memory: the shader would add them up in an
    order of each process's own, and some pixels would round to another grey level.
    """

    @property
    def light_nodes(self) -> list[pyrender.Node]:
        return sorted(super().light_nodes, key=lambda node: node.name)
