"""The usual pyrender loop, kept as the yardstick of the benchmark.

For every frame: a new trimesh, a new pyrender mesh, a new scene and a new renderer, pyrender's own
shaders, four samples a pixel and the depth read back. Only the benchmark calls this.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float, UInt8

from renderer.draw.offscreen import Backend, open_gl
from renderer.scene.camera import Z_NEAR_M, Camera
from renderer.scene.stage import Stage
from renderer.video.render import RenderSettings


def draw_naively(
    vertices: Iterable[Float[np.ndarray, "V 3"]],
    faces: np.ndarray,
    colors: Float[np.ndarray, "V 3"] | None,
    *,
    settings: RenderSettings,
    stage: Stage,
    backend: Backend,
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """Yield one picture for each set of vertices: same body, camera and lights, no ground.

    ``settings.antialias`` has no say: pyrender multisamples by four on EGL and not at all on
    OSMesa.
    """
    open_gl(backend)
    import pyrender
    import trimesh

    studio = settings.studio
    colors_u8 = None if colors is None else (255.0 * colors).astype(np.uint8)
    for frame in vertices:
        mesh = trimesh.Trimesh(frame, faces, process=False, vertex_colors=colors_u8)
        scene = pyrender.Scene(
            bg_color=[*studio.background, 1.0], ambient_light=[studio.ambient] * 3
        )
        scene.add(pyrender.Mesh.from_trimesh(mesh))
        scene.add(
            pyrender.PerspectiveCamera(
                yfov=stage.camera.yfov_rad, aspectRatio=settings.aspect, znear=Z_NEAR_M
            ),
            pose=stage.camera.pose(),
        )
        for light in (studio.key, studio.fill, studio.rim):
            scene.add(
                pyrender.DirectionalLight(color=light.color, intensity=light.intensity),
                pose=Camera(eye=light.towards, target=(0.0, 0.0, 0.0)).pose(),
            )
        renderer = pyrender.OffscreenRenderer(settings.width, settings.height)
        picture, _ = renderer.render(scene)  # type: ignore[reportGeneralTypeIssues]
        renderer.delete()
        yield picture
