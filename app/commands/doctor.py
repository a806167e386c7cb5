"""Command ``doctor``: a check of the installation, with advice for each problem."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.commands.runs import Files
from app.config import (
    BUNDLED_WEIGHTS,
    REQUESTED_BACKEND,
    body_from_environment,
    matplotlib_backend_error,
)
from app.errors import RunError, message_for_user
from app.flags import FileOrDefault, export_family_files

MIN_MEMORY_GB = 2.0
MIN_DISK_GB = 1.0
RATE_FRAMES = 60


@dataclass(frozen=True)
class CheckResult:
    """Result of one check of the installation."""

    name: str
    works: bool
    detail: str
    advice: str = ""
    is_needed: bool = True
    """True if the app does not work when this check fails."""


def doctor(files: Files, body: FileOrDefault = None, weights: Path = BUNDLED_WEIGHTS) -> None:
    """Check the installation and say how to fix problems.

    OpenGL, body, weights, ffmpeg, memory and disk are tested. The exit status is 1 if something
    that is needed does not work.

    Args:
        body: A character (.vrm, .glb) or licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else
            the bundled body.
        weights: Folder of trained systems.
    """
    export_family_files(vars(files))
    findings = run_checks(weights, body or body_from_environment())
    sys.stdout.write(format_report(findings))
    broken = [finding.name for finding in findings if finding.is_needed and not finding.works]
    if broken:
        raise RunError(f"Checks failed: {', '.join(broken)}. See the advice above.")


def run_checks(weights: Path, body: Path | None) -> list[CheckResult]:
    """Run all checks; a failure is a result and raises nothing."""
    return [
        _python(),
        *_backends(),
        _video_rate(),
        _body(body),
        _weights(weights),
        *_family_files(),
        _ffmpeg(),
        *_matplotlib(),
        _memory(),
        _disk(),
    ]


def format_report(findings: list[CheckResult]) -> str:
    width = max(len(finding.name) for finding in findings)
    lines = []
    for finding in findings:
        mark = "ok" if finding.works else "--" if not finding.is_needed else "NO"
        lines.append(f"{mark}  {finding.name:<{width}}  {finding.detail}")
        if finding.advice and not finding.works:
            lines.append(f"    {'':<{width}}  -> {finding.advice}")
    return "\n".join(lines) + "\n"


def _python() -> CheckResult:
    version = platform.python_version()
    tested = version.startswith("3.11.")
    return CheckResult(
        "Python",
        tested,
        version + ("" if tested else " (untested)"),
        "install Python 3.11, the version that this project is tested with",
        is_needed=False,
    )


def _backends() -> list[CheckResult]:
    """Check each OpenGL backend, and report which one pyrender uses."""
    from renderer.draw.offscreen import BACKENDS, GLError
    from renderer.draw.probe import DEBIAN_PACKAGES, choose_backend, probe_backend

    try:
        used = choose_backend()
    except GLError:
        used = None
    findings = []
    for report in map(probe_backend, BACKENDS):
        detail = report.error
        if report.works:
            detail = f"pyrender renders with {report.driver}"
            detail += " (selected)" if report.name == used else ""
        advice = f"apt-get install {DEBIAN_PACKAGES[report.name]}"
        findings.append(
            CheckResult(
                f"OpenGL {report.name}", report.works, detail, advice, is_needed=used is None
            )
        )
    return findings


def _video_rate() -> CheckResult:
    """Measure the speed of rendering a video (frames per second), without its start."""
    from conventions.joints import JOINT_INDEX
    from renderer.body.body import BodyMotion
    from renderer.video.workers import MotionRenderJob, run_render_jobs

    motion = BodyMotion.zero_pose(RATE_FRAMES)
    turn = np.sin(np.linspace(0.0, 4.0 * np.pi, RATE_FRAMES))
    for name in ("left_shoulder", "spine2", "right_elbow"):
        motion.poses[:, 3 * JOINT_INDEX[name]] = turn / 3.0
    times: list[tuple[float, float]] = []
    try:
        with tempfile.TemporaryDirectory(prefix="doctor-") as folder:
            job = MotionRenderJob(motion, Path(folder) / "rate.mp4")
            run_render_jobs({"rate": job}, lambda share: times.append((time.perf_counter(), share)))
    except Exception as error:
        advice = "see the results for OpenGL above and ffmpeg below"
        return CheckResult("videos", False, _error_text(error), advice, is_needed=False)
    (began, before), (ended, _) = [each for each in times if each[1] > 0.0][:1] + times[-1:]
    rate = RATE_FRAMES * (1.0 - before) / max(ended - began, 1e-3)
    return CheckResult("videos", True, f"{rate:.0f} frames per second at 512 x 512 pixels")


def _body(path: Path | None) -> CheckResult:
    from renderer.body.body import load_body

    try:
        body = load_body(path)
    except Exception as error:
        advice = "choose another file with --body FILE, or omit --body and unset $SMPLX_MODEL"
        return CheckResult("body", False, _error_text(error), advice)
    detail = f"{body.name}, {body.num_vertices} vertices, {body.expression_basis} expressions"
    return CheckResult("body", True, detail)


def _weights(folder: Path) -> CheckResult:
    from model.systems.registry import family_of, list_systems, load_system

    try:
        names = [name for name in list_systems(folder) if not family_of(name).files]
        for name in names:
            load_system(name, folder)
    except Exception as error:
        advice = "restore the files, or choose another folder with --weights DIR"
        return CheckResult("weights", False, _error_text(error), advice)
    if not names:
        advice = "choose a folder of trained systems with --weights DIR"
        return CheckResult("weights", False, f"no trained system in {folder}", advice)
    return CheckResult("weights", True, ", ".join(names))


def _family_files() -> list[CheckResult]:
    """Check family packages that failed to load, and the files that users provide for families."""
    from model.systems.registry import families, unavailable_family_messages

    advice = "reinstall the package, or remove it with pip uninstall"
    broken = [
        CheckResult("family", False, message, advice, is_needed=False)
        for message in unavailable_family_messages()
    ]
    return broken + [
        CheckResult(
            report.name,
            report.error is None,
            report.detail if report.error is None else _error_text(report.error),
            report.advice,
        )
        for family in families()
        for report in family.check_files()
    ]


def _ffmpeg() -> CheckResult:
    from renderer.video.encoder import ffmpeg_path

    try:
        output = subprocess.run(
            [ffmpeg_path(), "-hide_banner", "-encoders"], capture_output=True, text=True, check=True
        ).stdout
    except Exception as error:
        return CheckResult("ffmpeg", False, _error_text(error), "pip install imageio-ffmpeg")
    missing = [name for name in ("libx264", " aac ") if name not in output]
    detail = f"lacks {', '.join(missing)}" if missing else "H.264 and AAC"
    return CheckResult(
        "ffmpeg", not missing, detail, "pip install --force-reinstall imageio-ffmpeg"
    )


def _matplotlib() -> list[CheckResult]:
    """Check the matplotlib backend of MPLBACKEND, if there is one; no figure depends on it."""
    if not REQUESTED_BACKEND:
        return []
    fault = matplotlib_backend_error()
    advice = "unset MPLBACKEND; no figure needs it"
    return [
        CheckResult("MPLBACKEND", not fault, fault or REQUESTED_BACKEND, advice, is_needed=False)
    ]


def _memory() -> CheckResult:
    free_gb = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
    try:  # what the kernel could free counts as available
        lines = Path("/proc/meminfo").read_text().splitlines()
        available = next(line for line in lines if line.startswith("MemAvailable"))
        free_gb = int(available.split()[1]) * 1024 / 1e9
    except (OSError, StopIteration):
        pass
    cores = os.cpu_count() or 1
    return CheckResult(
        "memory",
        free_gb >= MIN_MEMORY_GB,
        f"{free_gb:.1f} GB free, {cores} cores",
        f"at least {MIN_MEMORY_GB:g} GB of free memory is needed; close other programs",
    )


def _disk() -> CheckResult:
    folder = Path(tempfile.gettempdir())
    free_gb = shutil.disk_usage(folder).free / 1e9
    return CheckResult(
        "disk",
        free_gb >= MIN_DISK_GB,
        f"{free_gb:.1f} GB free in {folder}",
        (
            f"at least {MIN_DISK_GB:g} GB of free space is needed; delete files, or set TMPDIR "
            "to another disk"
        ),
    )


def _error_text(error: Exception) -> str:
    return message_for_user(error) or f"{type(error).__name__}: {error}"
