"""Pictures without a screen: the choice of OpenGL backend and the life of its context.

pyrender 0.1.45 pins PyOpenGL 3.1.0, whose OSMesa binding lacks ``OSMesaCreateContextAttribs``, and
uses ``np.infty``, which numpy 2 removed; so one plain ``pip install`` of it gives EGL at best.
``pyrender2`` (MIT) is 0.1.45 with both lifted and a matrix-uniform bug fixed, asks for PyOpenGL
3.1.9 or newer, and leaves renderer and shaders alone: with it EGL and OSMesa draw our golden
pictures. Of the other forks ``pyrender-maintained`` makes the same changes, still accepts PyOpenGL
3.1.0 and forces pyglet 2, and ``scikit-robot-pyrender`` re-formats every file and adds features.
"""

import importlib
import os
import sys
import threading
import types
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from jaxtyping import UInt8

from renderer.draw.antialias import Antialias, check_picture_size
from renderer.scene.camera import Camera
from renderer.scene.studio import PosedFrame, Subject

if TYPE_CHECKING:
    from renderer.draw.gl import BodyScene

Backend = Literal["egl", "osmesa"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)
"""In the order in which they are reported; `renderer.draw.probe.choose_backend` chooses."""

_in_use = threading.Lock()
"""Held while a context lives: pyrender ends the driver's display with the first context that is
closed, and what PyOpenGL keeps of a context is not told apart by thread."""


class GLError(RuntimeError):
    """No picture can be drawn; the message says why in one sentence."""


def open_gl(backend: Backend) -> None:
    """Load pyrender and PyOpenGL for one backend, once per process.

    PyOpenGL reads ``PYOPENGL_PLATFORM`` when it is first imported and never again; so this is the
    only place that sets it, and the only door through which pyrender is imported.

    Raises:
        GLError: if the libraries are missing, or the process already runs the other backend.
    """
    if "OpenGL" in sys.modules and os.environ.get("PYOPENGL_PLATFORM") != backend:
        raise GLError(
            f"OpenGL is already loaded for {os.environ.get('PYOPENGL_PLATFORM')!r}; "
            f"{backend!r} needs a process of its own."
        )
    os.environ["PYOPENGL_PLATFORM"] = backend
    if "pyrender.viewer" not in sys.modules:
        # The window of pyrender is never used here, and importing it wants pyglet with X libraries.
        viewer = types.ModuleType("pyrender.viewer")
        viewer.Viewer = None  # type: ignore[attr-defined]
        sys.modules["pyrender.viewer"] = viewer
    try:
        importlib.import_module("renderer.draw.gl")
    except (ImportError, OSError, AttributeError, TypeError) as error:
        raise GLError(
            f"The system libraries of OpenGL through {backend} are missing or broken ({error})."
        ) from error


class OffscreenRenderer:
    """One OpenGL context and framebuffer, kept for a whole job. Use it in ``with``, in one thread.

    Raises on entering:
        GLError: if the backend gives no usable context, or another renderer of this process is
            open.
    """

    def __init__(
        self,
        subject: Subject,
        width: int,
        height: int,
        backend: Backend,
        antialias: Antialias = "supersample",
    ) -> None:
        check_picture_size(width, height)
        self.width, self.height = width, height
        self.backend: Backend = backend
        self.antialias: Antialias = antialias
        self._subject = subject
        self._canvases: list[Canvas] = []

    def __enter__(self) -> "OffscreenRenderer":
        open_gl(self.backend)
        if not _in_use.acquire(blocking=False):
            raise GLError(
                "Another picture is being drawn in this process, and OpenGL serves one at a time "
                "here; let that end first, or draw in processes of their own (renderer.video.pool)."
            )
        try:
            self._open()
        except Exception as error:  # PyOpenGL and pyrender raise whatever the driver does
            _in_use.release()
            reason = f"{type(error).__name__} {error}".strip().splitlines()[0]
            raise GLError(
                f"OpenGL through {self.backend} gives no context for "
                f"{self.width} x {self.height} pixels ({reason})."
            ) from error
        return self

    def _open(self) -> None:
        self._platform = _new_platform(self.backend, self.width, self.height)
        self._platform.init_context()
        self._platform.make_current()
        self._canvases = [Canvas(self._subject, self.width, self.height, self.antialias)]

    def __exit__(self, *exception: object) -> None:
        try:
            for canvas in self._canvases:
                canvas.delete()
            self._platform.delete_context()
        finally:
            _in_use.release()

    def beside(self, subject: Subject, width: int, height: int) -> "Canvas":
        """What draws another subject in another size, for as long as this renderer is open."""
        check_picture_size(width, height)
        self._canvases.append(Canvas(subject, width, height, self.antialias))
        return self._canvases[-1]

    def draw(self, frame: PosedFrame, camera: Camera) -> UInt8[np.ndarray, "H W C"]:
        """The picture, upper row first; overwritten by the next call."""
        return self._canvases[0].draw(frame, camera)

    @property
    def driver(self) -> str:
        """What OpenGL calls itself, such as ``llvmpipe (LLVM 15.0.6, 256 bits)``."""
        from OpenGL import GL

        name = GL.glGetString(GL.GL_RENDERER)
        return name.decode() if name else "an unnamed driver"


class Canvas:
    """One subject and its framebuffer, within the context of an open renderer."""

    def __init__(self, subject: Subject, width: int, height: int, antialias: Antialias) -> None:
        from renderer.draw.gl import FrameRenderer

        self._subject = subject
        self._aspect = width / height
        self._scene: BodyScene | None = None
        self._renderer = FrameRenderer(width, height, antialias, has_alpha=subject.is_transparent)

    def draw(self, frame: PosedFrame, camera: Camera) -> UInt8[np.ndarray, "H W C"]:
        """The picture, upper row first; overwritten by the next call."""
        if self._scene is None:
            from renderer.draw.gl import BodyScene

            self._scene = BodyScene(self._subject, frame, camera, self._aspect)
        self._scene.show(frame, camera)
        picture = self._renderer.draw(self._scene.scene)
        return _undarkened(picture) if self._subject.is_transparent else picture

    def delete(self) -> None:
        """Free what the driver holds."""
        self._renderer.delete()


def _new_platform(backend: Backend, width: int, height: int):
    """pyrender's context for a backend; EGL on its first device."""
    if backend == "egl":
        from pyrender.platforms import egl

        return egl.EGLPlatform(width, height, device=egl.get_default_device())
    from pyrender.platforms.osmesa import OSMesaPlatform

    return OSMesaPlatform(width, height)


def _undarkened(picture: UInt8[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "H W 4"]:
    """The colours of the body itself where it covers a part of a pixel, as PNG wants them."""
    alpha = picture[..., 3:].astype(np.float32)
    colors = picture[..., :3] * (255.0 / np.maximum(alpha, 1.0))
    return np.concatenate([colors.clip(0, 255).round().astype(np.uint8), picture[..., 3:]], axis=2)
