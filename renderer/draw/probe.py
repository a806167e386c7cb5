"""Probe of the OpenGL backends in a child process, which a crashing driver cannot harm."""

import functools
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from processes.exit_report import ExitReport
from renderer.draw.offscreen import BACKENDS, Backend, GLError, OffscreenRenderer

DEBIAN_PACKAGES: dict[Backend, str] = {"egl": "libegl1 libgl1", "osmesa": "libosmesa6"}
_TIMEOUT_S = 60.0
_PROBE_SIZE_PX = 128


@dataclass(frozen=True)
class BackendReport:
    name: Backend
    driver: str = ""
    """Name of the driver; empty if the backend does not work."""
    error: str = ""
    """Reason of the failure, in one sentence; empty if the backend works."""

    @property
    def works(self) -> bool:
        return not self.error


@functools.cache
def choose_backend() -> Backend:
    """Return EGL if it works, else OSMesa; cached for this process.

    EGL uses graphics processors, and is also faster without one. Raises GLError if none works, with
    the packages to install.
    """
    for name in BACKENDS:
        if probe_backend(name).works:
            return name
    raise GLError(
        "OpenGL does not work on this machine, so no picture can be drawn; on Debian or Ubuntu "
        f"install it with: apt-get install {' '.join(DEBIAN_PACKAGES.values())}"
    )


@functools.cache
def probe_backend(name: Backend, python: str = sys.executable) -> BackendReport:
    """Draw the body in a child process of the interpreter ``python``; the result is cached."""
    try:
        child = subprocess.run(
            [python, "-m", "renderer.draw.probe", name],
            cwd=Path(__file__).parents[2],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return _broken(name, f"the test picture was not drawn within {_TIMEOUT_S:.0f} s")
    except OSError as error:
        return _broken(name, f"the process for the test picture cannot be started: {error}")
    if child.returncode < 0:
        return _broken(name, f"the test process ended {ExitReport(child.returncode).exit_text}")
    if child.returncode:
        lines = child.stderr.decode(errors="replace").strip().splitlines()
        return _broken(name, lines[-1] if lines else f"exit status {child.returncode}")
    return BackendReport(name, child.stdout.decode(errors="replace").strip().splitlines()[-1])


def _broken(name: Backend, error: str) -> BackendReport:
    return BackendReport(name, error=error)


def draw_and_name_driver(backend: Backend) -> str:
    """Draw a test picture and return the driver's name; raises GLError if it is empty."""
    from renderer.body.body import load_body
    from renderer.scene.camera import fit_camera
    from renderer.scene.camera_setup import CameraSetup, PanelCamera
    from renderer.scene.studio import PosedFrameBuilder, StaticBody

    body = load_body()
    camera = fit_camera(body.template)
    prepare = PosedFrameBuilder(
        body.faces, body.num_vertices, CameraSetup((PanelCamera("front", camera),), floor_m=-1.0)
    )
    subject = StaticBody(body.faces, body.vertex_colors, prepare.ground.corners())
    with OffscreenRenderer(backend) as renderer:
        canvas = renderer.make_canvas(subject, _PROBE_SIZE_PX, _PROBE_SIZE_PX)
        picture = canvas.draw(prepare(body.template), camera).astype(int)
        driver = renderer.driver_name
    if np.abs(picture[_PROBE_SIZE_PX // 2, _PROBE_SIZE_PX // 2] - picture[0, 0]).max() < 16:
        raise GLError(f"an empty picture was drawn by {driver}")
    return driver


if __name__ == "__main__":
    try:
        sys.stdout.write(f"{draw_and_name_driver(sys.argv[1])}\n")  # type: ignore[arg-type]
    except (GLError, ImportError) as problem:
        sys.exit(str(problem))
