"""What can draw here, found out where a crash of a driver does no harm: in a child process."""

import functools
import json
import math
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from processes.ended import Ended
from renderer.draw.offscreen import BACKENDS, Backend, GLError, OffscreenRenderer

DEBIAN_PACKAGES: dict[Backend, str] = {"egl": "libegl1 libgl1", "osmesa": "libosmesa6"}
_TIMEOUT_S = 60.0
_PROBE_SIZE_PX = 512
_TIMED_FRAMES = 5

_ON_CPU = ("llvmpipe", "softpipe", "swrast", "swr ", "software rasterizer")
"""In the names of drivers that need no graphics processor."""


@dataclass(frozen=True)
class BackendReport:
    """What one backend can do here."""

    name: Backend
    works: bool
    renderer_string: str
    """The driver's own name; empty if it does not work."""
    ms_per_frame: float | None
    """Of the body, at 512 x 512 pixels."""
    error: str
    """Why it does not work, in one sentence; empty if it does."""

    @property
    def has_hardware(self) -> bool:
        """Whether it draws with a graphics processor."""
        return self.works and not any(name in self.renderer_string.lower() for name in _ON_CPU)


@functools.cache
def probe_backends() -> tuple[BackendReport, ...]:
    """Try every backend, the preferred one first. The answer is kept for this process."""
    return tuple(probe_backend(name) for name in BACKENDS)


@functools.cache
def choose_backend() -> Backend:
    """EGL where it has a graphics processor; else whichever draws quicker on this processor. The
    answer is kept for this process.

    Raises:
        GLError: if none works, naming the packages to install.
    """
    egl = probe_backend("egl")
    if egl.has_hardware:
        return "egl"
    reports = (egl, probe_backend("osmesa"))
    quickest = min(reports, key=lambda report: report.ms_per_frame or math.inf)
    if not quickest.works:
        raise GLError(
            "OpenGL does not work on this machine, so no picture can be drawn; on Debian or Ubuntu "
            f"install it with: apt-get install {' '.join(DEBIAN_PACKAGES.values())}"
        )
    return quickest.name


@functools.cache
def probe_backend(name: Backend, python: str = sys.executable) -> BackendReport:
    """Draw a few frames of the body in a child process.

    Args:
        python: the interpreter of the child.
    """
    command = [python, "-m", "renderer.draw.probe", name]
    try:
        child = subprocess.run(
            command,
            cwd=Path(__file__).parents[2],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return _broken(name, f"it did not answer within {_TIMEOUT_S:.0f} s")
    except OSError as error:
        return _broken(name, f"no child process can be started: {error}")
    lines = child.stdout.decode(errors="replace").strip().splitlines()
    if child.returncode < 0:
        return _broken(name, f"the driver ended {Ended(child.returncode).how}")
    if child.returncode or not lines:
        said = child.stderr.decode(errors="replace").strip().splitlines()
        return _broken(name, said[-1] if said else f"exit status {child.returncode}")
    return BackendReport(**json.loads(lines[-1]))


def _broken(name: Backend, error: str) -> BackendReport:
    return BackendReport(name, works=False, renderer_string="", ms_per_frame=None, error=error)


def try_backend(name: Backend) -> BackendReport:
    """Draw through a backend in this process, and look whether there is something."""
    from renderer.body.body import load_body
    from renderer.scene.camera import frame_points
    from renderer.scene.stage import Shot, Stage
    from renderer.scene.studio import FramePreparer, Subject

    body = load_body()
    vertices, faces = body.template, body.faces
    camera = frame_points(vertices)
    stage = Stage((Shot("front", camera),), floor_m=-1.0)
    prepare = FramePreparer(faces, len(vertices), stage)
    subject = Subject(faces, None, prepare.ground.corners())
    frame = prepare(vertices)
    try:
        with OffscreenRenderer(name) as renderer:
            canvas = renderer.canvas(subject, _PROBE_SIZE_PX, _PROBE_SIZE_PX)
            picture = canvas.draw(frame, camera)
            started = time.perf_counter()
            for _ in range(_TIMED_FRAMES):
                picture = canvas.draw(frame, camera)
            ms_per_frame = 1e3 * (time.perf_counter() - started) / _TIMED_FRAMES
            driver = renderer.driver
    except (GLError, ImportError) as error:
        return _broken(name, str(error))
    middle = picture[_PROBE_SIZE_PX // 2, _PROBE_SIZE_PX // 2].astype(int)
    corner = picture[0, 0].astype(int)
    if np.abs(middle - corner).max() < 16:
        return _broken(name, f"{driver} draws an empty picture")
    return BackendReport(name, True, driver, ms_per_frame, "")


def _main() -> int:
    (name,) = sys.argv[1:]
    report = try_backend(name)  # type: ignore[arg-type]  # as written by probe_backend
    sys.stdout.write(json.dumps(asdict(report)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(_main())
