"""The usual pyrender loop, as the baseline of the benchmark."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from renderer.body.body import Body
from renderer.draw.offscreen import load_opengl
from renderer.draw.probe import choose_backend
from renderer.scene.camera import Z_NEAR_M, Camera
from renderer.scene.camera_setup import CameraSetup
from renderer.scene.studio import STUDIO


def draw_with_plain_pyrender(
    frames: Sequence[Float[np.ndarray, "V 3"]], body: Body, stage: CameraSetup, size_px: int
) -> list[np.ndarray]:
    """Draw precomputed vertices as in pyrender's examples.

    Each frame has a new trimesh, mesh, scene and renderer, pyrender's shaders, and the depth is
    read back; there is no ground.
    """
    load_opengl(choose_backend())
    import pyrender
    import trimesh

    colors = (255.0 * body.vertex_colors).astype(np.uint8)
    lens = pyrender.PerspectiveCamera(stage.camera.yfov_rad, znear=Z_NEAR_M, aspectRatio=1.0)
    pictures = []
    for frame in frames:
        mesh = trimesh.Trimesh(frame, body.faces, process=False, vertex_colors=colors)
        scene = pyrender.Scene(
            bg_color=[*STUDIO.background, 1.0], ambient_light=[STUDIO.ambient] * 3
        )
        scene.add(pyrender.Mesh.from_trimesh(mesh))
        scene.add(lens, pose=stage.camera.pose())
        for light in (STUDIO.key, STUDIO.fill, STUDIO.rim):
            lamp = pyrender.DirectionalLight(light.color, light.intensity)
            scene.add(lamp, pose=Camera(light.direction_to_light, target=(0.0, 0.0, 0.0)).pose())
        renderer = pyrender.OffscreenRenderer(size_px, size_px)
        picture, _ = renderer.render(scene)  # type: ignore[reportGeneralTypeIssues]
        renderer.delete()
        pictures.append(picture)
    return pictures
