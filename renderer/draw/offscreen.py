"""Offscreen rendering: choice of the OpenGL backend and lifetime of its context.

pyrender 0.1.45 pins PyOpenGL 3.1.0, which has no ``OSMesaCreateContextAttribs``, and uses
``np.infty``, which numpy 2 removed. ``pyrender2`` (MIT) is 0.1.45 with both lifted and a
matrix-uniform bug fixed, and leaves renderer and shaders alone.
"""

import importlib
import os
import sys
import threading
import types
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal, get_args

from renderer.scene.studio import StaticBody

if TYPE_CHECKING:
    from renderer.draw.gl import Canvas

Backend = Literal["egl", "osmesa"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)
"""Backends in the order of reports; `renderer.draw.probe.choose_backend` selects one."""

_in_use = threading.Lock()
"""Lock for the lifetime of a context: pyrender closes the driver's display with the first context
that is closed, and PyOpenGL's data of a context are not separated by thread.
"""


class GLError(RuntimeError):
    """Error for pictures that cannot be drawn; the message says why in one sentence."""


def load_opengl(backend: Backend) -> None:
    """Load pyrender and PyOpenGL for one backend, once per process.

    PyOpenGL reads ``PYOPENGL_PLATFORM`` only when it is first imported; so this is the only
    function that sets it and that imports pyrender. Raises GLError if the libraries are missing, or
    the process already runs the other backend.
    """
    if "OpenGL" in sys.modules and os.environ.get("PYOPENGL_PLATFORM") != backend:
        raise GLError(
            f"OpenGL is already loaded for {os.environ.get('PYOPENGL_PLATFORM')!r}; "
            f"{backend!r} needs a separate process."
        )
    os.environ["PYOPENGL_PLATFORM"] = backend
    if "pyrender.viewer" not in sys.modules:
        # pyrender's window is never used here, and importing it requires pyglet with X libraries.
        viewer = types.ModuleType("pyrender.viewer")
        viewer.Viewer = None  # type: ignore[attr-defined]
        sys.modules["pyrender.viewer"] = viewer
    try:
        importlib.import_module("renderer.draw.gl")
    except (ImportError, OSError, AttributeError, TypeError) as error:
        raise GLError(
            f"The system libraries for OpenGL with {backend} are missing or broken ({error})."
        ) from error


class OffscreenRenderer:
    """Context manager of one OpenGL context and its canvases, for one thread.

    Raises on entering:
        GLError: if the backend has no usable context, or another renderer of this process is open.
    """

    def __init__(self, backend: Backend) -> None:
        self._backend: Backend = backend
        self._canvases: list[Canvas] = []

    def __enter__(self) -> "OffscreenRenderer":
        load_opengl(self._backend)
        if not _in_use.acquire(blocking=False):
            raise GLError(
                "Another picture is being rendered in this process, and OpenGL supports one at a "
                "time here. Wait for it to finish, or render in separate processes "
                "(renderer.video.workers)."
            )
        try:
            with self._convert_errors("cannot create a context"):
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
    def _convert_errors(self, failure: str) -> Iterator[None]:
        """Convert any error of PyOpenGL and pyrender to a `GLError` with ``failure``."""
        try:
            yield
        except Exception as error:
            reason = f"{type(error).__name__} {error}".strip().splitlines()[0]
            raise GLError(f"OpenGL with {self._backend} {failure} ({reason}).") from error

    def make_canvas(self, subject: StaticBody, width: int, height: int) -> "Canvas":
        """Make a canvas, valid while this is open; raises GLError if too large for the driver."""
        from renderer.draw.gl import Canvas

        with self._convert_errors(f"cannot draw pictures of {width} x {height} pixels"):
            self._canvases.append(Canvas(subject, width, height))
        return self._canvases[-1]

    @property
    def driver_name(self) -> str:
        """Name of the OpenGL driver, such as ``llvmpipe (LLVM 15.0.6, 256 bits)``."""
        from OpenGL import GL

        name = GL.glGetString(GL.GL_RENDERER)
        return name.decode() if name else "an unnamed driver"


def _new_platform(backend: Backend):
    """Return pyrender's platform for a backend, EGL on its first device."""
    if backend == "egl":
        from pyrender.platforms import egl

        return egl.EGLPlatform(1, 1, device=egl.get_default_device())
    from pyrender.platforms.osmesa import OSMesaPlatform

    return OSMesaPlatform(1, 1)
