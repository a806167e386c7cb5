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
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from jaxtyping import UInt8

from renderer.scene.camera import Camera
from renderer.scene.studio import PosedFrame, Subject

if TYPE_CHECKING:
    from renderer.draw.gl import BodyScene

Backend = Literal["egl", "osmesa"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)
"""In the order in which they are reported; `renderer.draw.probe.choose_backend` chooses."""

SHADERS = Path(__file__).with_name("shaders")
_BEGIN, _END = "// Browsers light bodies by the same lines, from here on:", "// As far as here."

_in_use = threading.Lock()
"""Held while a context lives: pyrender ends the driver's display with the first context that is
closed, and what PyOpenGL keeps of a context is not told apart by thread."""


def lighting_source() -> str:
    """How a body is lit, in what the shading languages of OpenGL and WebGL have in common: pyrender
    and the bodies that move in a browser (``app/page/web/stage``) compile the same lines."""
    shader = (SHADERS / "mesh.vert").read_text("utf-8")
    return shader.partition(_BEGIN)[2].partition(_END)[0].partition("\n")[2]


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
    """One OpenGL context, kept for a whole job, and the canvases in it. Use it in ``with``, in one
    thread.

    Raises on entering:
        GLError: if the backend gives no usable context, or another renderer of this process is
            open.
    """

    def __init__(self, backend: Backend, *, is_smooth: bool = True) -> None:
        """
        Args:
            is_smooth: with four samples a pixel.
        """
        self._backend: Backend = backend
        self._is_smooth = is_smooth
        self._canvases: list[Canvas] = []

    def __enter__(self) -> "OffscreenRenderer":
        open_gl(self._backend)
        if not _in_use.acquire(blocking=False):
            raise GLError(
                "Another picture is being drawn in this process, and OpenGL serves one at a time "
                "here; let that end first, or draw in processes of their own "
                "(renderer.video.workers)."
            )
        try:
            with self._told("gives no context"):
                self._platform = _new_platform(self._backend)
                self._platform.init_context()
                self._platform.make_current()
        except BaseException:
            _in_use.release()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        try:
            for canvas in self._canvases:
                canvas.delete()
            self._platform.delete_context()
        finally:
            _in_use.release()

    @contextmanager
    def _told(self, failure: str) -> Iterator[None]:
        """What PyOpenGL and pyrender raise, which is whatever the driver does, as a `GLError`."""
        try:
            yield
        except Exception as error:
            reason = f"{type(error).__name__} {error}".strip().splitlines()[0]
            raise GLError(f"OpenGL through {self._backend} {failure} ({reason}).") from error

    def canvas(self, subject: Subject, width: int, height: int) -> "Canvas":
        """What draws a subject, for as long as this renderer is open.

        Raises:
            ValueError: if there is no pixel.
            GLError: if the driver has no room for so many.
        """
        if width < 1 or height < 1:
            raise ValueError(f"A picture of {width} x {height} pixels cannot be drawn.")
        with self._told(f"gives no picture of {width} x {height} pixels"):
            self._canvases.append(Canvas(subject, width, height, self._is_smooth))
        return self._canvases[-1]

    @property
    def driver(self) -> str:
        """What OpenGL calls itself, such as ``llvmpipe (LLVM 15.0.6, 256 bits)``."""
        from OpenGL import GL

        name = GL.glGetString(GL.GL_RENDERER)
        return name.decode() if name else "an unnamed driver"


class Canvas:
    """One subject and its framebuffer, within the context of an open renderer."""

    def __init__(self, subject: Subject, width: int, height: int, is_smooth: bool) -> None:
        from renderer.draw.gl import FrameRenderer

        self._subject = subject
        self._aspect = width / height
        self._scene: BodyScene | None = None
        self._renderer = FrameRenderer(
            width, height, is_smooth=is_smooth, has_alpha=subject.is_transparent
        )

    def begin(self, frame: PosedFrame, camera: Camera) -> None:
        """Have the driver draw, which goes on while this process does something else."""
        if self._scene is None:
            from renderer.draw.gl import BodyScene

            self._scene = BodyScene(self._subject, frame, camera, self._aspect)
        self._scene.show(frame, camera)
        self._renderer.begin(self._scene.scene)

    def picture(self) -> UInt8[np.ndarray, "H W C"]:
        """What was begun last, upper row first; overwritten by the next call."""
        picture = self._renderer.picture()
        return _undarkened(picture) if self._subject.is_transparent else picture

    def draw(self, frame: PosedFrame, camera: Camera) -> UInt8[np.ndarray, "H W C"]:
        """Begin a picture and wait for it."""
        self.begin(frame, camera)
        return self.picture()

    def delete(self) -> None:
        """Free what the driver holds."""
        self._renderer.delete()


def _new_platform(backend: Backend):
    """pyrender's context for a backend; EGL on its first device. Framebuffers have sizes of their
    own."""
    if backend == "egl":
        from pyrender.platforms import egl

        return egl.EGLPlatform(1, 1, device=egl.get_default_device())
    from pyrender.platforms.osmesa import OSMesaPlatform

    return OSMesaPlatform(1, 1)


def _undarkened(picture: UInt8[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "H W 4"]:
    """The colours of the body itself where it covers a part of a pixel, as PNG wants them."""
    alpha = picture[..., 3:].astype(np.float32)
    colors = picture[..., :3] * (255.0 / np.maximum(alpha, 1.0))
    return np.concatenate([colors.clip(0, 255).round().astype(np.uint8), picture[..., 3:]], axis=2)
