"""One way to draw, whatever the machine has: OpenGL, or compiled loops where there is none."""

from renderer.draw.antialias import Antialias
from renderer.draw.offscreen import Backend, OffscreenRenderer
from renderer.draw.software import SoftwareRenderer
from renderer.scene.studio import Subject

PictureRenderer = OffscreenRenderer | SoftwareRenderer


def make_renderer(
    subject: Subject, width: int, height: int, backend: Backend, antialias: Antialias
) -> PictureRenderer:
    """What draws the subject through a backend; enter it by ``with``, in the thread that draws.

    Raises:
        ValueError: if the picture has no pixel.
        GLError: on entering, if the backend gives no usable context.
    """
    if backend == "software":
        return SoftwareRenderer(subject, width, height, antialias)
    return OffscreenRenderer(subject, width, height, backend, antialias)
