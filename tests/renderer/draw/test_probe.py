"""The choice of backend survives whatever a driver does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from renderer.draw import probe
from renderer.draw.offscreen import BACKENDS
from renderer.draw.probe import BackendReport, choose_backend, probe_backend, probe_backends
from tests.helpers import ROOT

LOADED_LATER = ["tools.bake.__main__"] + [
    f"renderer.draw.{name}" for name in ("compiled", "gl", "gl_scene", "rasteriser")
]


@pytest.mark.slow
@pytest.mark.gl
def test_every_backend_is_reported():
    reports = probe_backends()
    assert tuple(report.name for report in reports) == BACKENDS
    for report in reports:
        if report.works:
            assert report.renderer_string and report.error == ""
            assert report.ms_per_frame is not None and report.ms_per_frame > 0
        else:
            assert report.error and report.ms_per_frame is None
    on_cpu = {report.name for report in reports if report.works and not report.has_hardware}
    assert choose_backend() in (on_cpu if on_cpu == set(BACKENDS) else BACKENDS)


@pytest.mark.parametrize(
    ("drivers", "chosen"),
    [
        ({"egl": "NVIDIA H100/PCIe/SSE2", "software": "compiled loops"}, "egl"),
        ({"egl": "llvmpipe (LLVM 15.0.6, 256 bits)", "software": "compiled loops"}, "software"),
        ({"egl": "llvmpipe (LLVM 15.0.6, 256 bits)"}, "egl"),
        ({"osmesa": "softpipe"}, "osmesa"),
        ({"osmesa": "softpipe", "software": "compiled loops"}, "software"),
    ],
)
def test_a_graphics_processor_goes_before_compiled_loops_and_these_before_opengl_on_the_cpu(
    monkeypatch, drivers, chosen
):
    def report(name):
        works = name in drivers
        return BackendReport(name, works, drivers.get(name, ""), 1.0 if works else None, "")

    monkeypatch.setattr(probe, "probe_backend", report)
    assert choose_backend.__wrapped__() == chosen


@pytest.mark.parametrize(
    ("script", "error"),
    [
        ("kill -SEGV $$\n", "the driver ended by signal 11 (SIGSEGV)"),
        ("echo 'no such library' >&2\nexit 1\n", "no such library"),
        ("exit 3\n", "exit status 3"),
    ],
)
def test_a_child_that_dies_is_a_backend_that_does_not_work(tmp_path, script, error):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\n" + script)
    python.chmod(0o755)
    report = probe_backend("egl", str(python))
    assert (report.works, report.error) == (False, error)


def run_without(folder: Path, opengl: bool, numba: bool, code: str) -> str:
    """What a process says that lacks one or both."""
    environment = {name: value for name, value in os.environ.items() if "PYOPENGL" not in name}
    if opengl:
        for library in ("libEGL.so", "libGL.so", "libOSMesa.so"):
            for version in ("", ".1", ".6", ".8"):
                (folder / f"{library}{version}").write_text("not a library")
        environment["LD_LIBRARY_PATH"] = str(folder)
    if numba:
        (folder / "numba.py").write_text("raise ImportError('numba is broken here')\n")
        environment |= {
            "PYTHONPATH": str(folder),
            "__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent",
        }
    child = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return (child.stdout + child.stderr).strip()


CHOOSE = "from renderer.draw.probe import choose_backend; print(choose_backend())"


def test_nothing_that_draws_gives_one_sentence_with_the_packages(tmp_path):
    last_line = run_without(tmp_path, True, True, CHOOSE).splitlines()[-1]
    assert "GLError: Neither OpenGL nor numba works on this machine" in last_line
    assert last_line.endswith("apt-get install libegl1 libgl1 libosmesa6")


@pytest.mark.slow
@pytest.mark.gl
def test_what_is_left_steps_in(tmp_path):
    for name in ("loops", "osmesa"):
        (tmp_path / name).mkdir()
    assert run_without(tmp_path / "loops", True, False, CHOOSE) == "software"
    if not probe_backend("osmesa").works:
        pytest.skip("OSMesa is not installed here")
    assert run_without(tmp_path / "osmesa", False, True, CHOOSE) == "osmesa"


def test_importing_the_renderer_loads_no_opengl(tmp_path):
    code = (
        "import sys, os, pkgutil, importlib, renderer\n"
        "for module in pkgutil.walk_packages(renderer.__path__, 'renderer.'):\n"
        f"    if module.name not in {LOADED_LATER}: importlib.import_module(module.name)\n"
        "heavy = {'OpenGL', 'pyrender', 'trimesh', 'torch', 'gradio', 'numba'}\n"
        "print(sorted(heavy & set(sys.modules)), 'PYOPENGL_PLATFORM' in os.environ)"
    )
    assert run_without(tmp_path, False, False, code) == "[] False"
