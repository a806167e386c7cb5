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
import types
from typing import Literal, get_args

import numpy as np
from jaxtyping import UInt8

from renderer.scene import BodyScene

Antialias = Literal["none", "msaa", "supersample"]
Backend = Literal["egl", "osmesa"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)


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
        importlib.import_module("renderer.gl")
    except (ImportError, OSError, AttributeError, TypeError) as error:
        raise GLError(
            f"The system libraries of OpenGL through {backend} are missing or broken ({error})."
        ) from error


class OffscreenRenderer:
    """One OpenGL context and framebuffer, kept for a whole job. Use it in ``with``, in one thread.

    Raises on entering:
        GLError: if the backend gives no usable context.
    """

    def __init__(
        self, width: int, height: int, backend: Backend, antialias: Antialias = "msaa"
    ) -> None:
        if width < 1 or height < 1:
            raise ValueError(f"A picture of {width} x {height} pixels cannot be drawn.")
        self.width, self.height = width, height
        self.backend: Backend = backend
        self.antialias: Antialias = antialias

    def __enter__(self) -> "OffscreenRenderer":
        open_gl(self.backend)
        from renderer.gl import FrameRenderer

        try:
            self._platform = _new_platform(self.backend, self.width, self.height)
            self._platform.init_context()
            self._platform.make_current()
            self._renderer = FrameRenderer(self.width, self.height, self.antialias)
        except Exception as error:  # PyOpenGL and pyrender raise whatever the driver does
            reason = f"{type(error).__name__} {error}".strip().splitlines()[0]
            raise GLError(
                f"OpenGL through {self.backend} gives no context for "
                f"{self.width} x {self.height} pixels ({reason})."
            ) from error
        return self

    def __exit__(self, *exception: object) -> None:
        self._renderer.delete()
        self._platform.delete_context()

    def draw(self, scene: BodyScene) -> UInt8[np.ndarray, "H W 3"]:
        """The picture, upper row first. The array is overwritten by the next call."""
        return self._renderer.draw(scene.scene)

    @property
    def driver(self) -> str:
        """What OpenGL calls itself, such as ``llvmpipe (LLVM 15.0.6, 256 bits)``."""
        from OpenGL import GL

        name = GL.glGetString(GL.GL_RENDERER)
        return name.decode() if name else "an unnamed driver"


def _new_platform(backend: Backend, width: int, height: int):
    """pyrender's context for a backend; EGL on its first device."""
    if backend == "egl":
        from pyrender.platforms import egl

        return egl.EGLPlatform(width, height, device=egl.get_default_device())
    from pyrender.platforms.osmesa import OSMesaPlatform

    return OSMesaPlatform(width, height)
