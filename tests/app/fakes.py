"""A pipeline of the real signature that needs no model and no GL: for tests of the page alone."""

import subprocess
import threading
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image

from app.catalogue import Catalogue
from app.errors import CancelledRun
from app.handlers import row_names
from app.outputs import ResultFolder
from app.request import (
    Artefact,
    GenerateRequest,
    GenerateResult,
    OnEvent,
    Progress,
    ShouldCancel,
    file_stem,
)

CATALOGUE = Catalogue(
    systems=("globaldiff/local", "globaldiff/global"),
    speakers=("wayne", "scott"),
    trained_on="0.0 hours of nothing (a test)",
)


def write_video(path: Path, seconds: float = 1.0, size: int = 64) -> None:
    """A short picture with a tone, encoded for a browser."""
    subprocess.run(
        [
            imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y",
            "-f", "lavfi", "-i", f"testsrc=size={size}x{size}:rate=30:duration={seconds}",
            "-f", "lavfi", "-i", f"sine=frequency=300:duration={seconds}",
            "-pix_fmt", "yuv420p", "-c:v", "libx264", "-c:a", "aac",
            "-movflags", "+faststart", str(path),
        ],
        check=True,
    )  # fmt: skip


def measures(jerk: float) -> dict:
    """Measures of one system in the public format, as far as the page reads them."""
    raw = {
        "tip_jerk_m_s3": jerk,
        "tip_acceleration_m_s2": jerk / 20,
        "tip_velocity_power_above_5hz": 0.0123,
        "seam_jerk_ratio": 1.1,
        "foot_slide_m_s": 0.01,
    }
    return {"raw": raw, "savgol": {key: value / 3 for key, value in raw.items()}}


def make_generate(
    on_start: Callable[[GenerateRequest], None] | None = None,
    error: BaseException | None = None,
    hold: threading.Event | None = None,
) -> Callable[[GenerateRequest, OnEvent, ShouldCancel], GenerateResult]:
    """A pipeline that draws test pictures; it can be told to fail, or to wait until ``hold``."""

    def generate(
        request: GenerateRequest, on_event: OnEvent, should_cancel: ShouldCancel
    ) -> GenerateResult:
        if on_start is not None:
            on_start(request)
        names = row_names(request)
        with ResultFolder(request.out) as folder:
            on_event(Progress("speech", 1.0))
            on_event(Progress("motion", 0.4, names[0]))
            if error is not None:
                raise error
            while hold is not None and not hold.wait(0.05):
                if should_cancel():
                    raise CancelledRun
            for name in names if request.has_previews else ():
                preview = folder.scratch(f"{file_stem(name)}.glb")
                preview.write_bytes(b"glTF")
                on_event(Artefact("preview", name, preview))
            on_event(Progress("motion", 1.0))
            on_event(Progress("numbers", 1.0))
            for i, name in enumerate(names):
                video = folder.path(f"{file_stem(name)}.mp4")
                write_video(video)
                on_event(Progress("video", (i + 1) / len(names)))
                on_event(Artefact("video", name, video))
            comparison = folder.path("comparison.mp4")
            write_video(comparison)
            on_event(Progress("comparison", 1.0))
            on_event(Artefact("comparison", "comparison", comparison))
            figure = folder.path("figure6.png")
            Image.fromarray(np.full((90, 160, 3), 200, np.uint8)).save(figure)
            on_event(Progress("figure", 1.0))
            on_event(Artefact("figure", "figure6", figure))
            files = folder.publish()
        diagnostics = {
            "fps": 30,
            "tip": "right_middle",
            "reference": None,
            "systems": {name: measures(100.0 + i) for i, name in enumerate(names)},
        }
        return GenerateResult(request.out, files, names, 30, diagnostics, ("A note.",))

    return generate
