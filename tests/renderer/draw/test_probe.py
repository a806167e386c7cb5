"""The choice of backend survives whatever a driver does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from renderer.draw import probe
from renderer.draw.offscreen import BACKENDS
from renderer.draw.probe import BackendReport, choose_backend, probe_backend, probe_backends

ROOT = Path(__file__).resolve().parents[3]
LOADED_LATER = ["tools.bake.__main__"] + [
    f"renderer.draw.{name}" for name in ("compiled", "gl", "gl_scene", "rasteriser")
]


@pytest.mark.gl
def test_every_backend_is_reported():
    reports = probe_backends()
    assert tuple(report.name for report in reports) == BACKENDS
    for report in reports:
        if report.works:
            assert report.renderer_string and report.error == ""
            assert report.ms_per_frame is not None and 0 < report.ms_per_frame < 1000
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


def fake_python(folder: Path, script: str) -> str:
    path = folder / "python"
    path.write_text("#!/bin/sh\n" + script)
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("script", "error"),
    [
        ("kill -SEGV $$\n", "the driver ended by signal 11 (SIGSEGV)"),
        ("echo 'no such library' >&2\nexit 1\n", "no such library"),
        ("exit 3\n", "exit status 3"),
    ],
)
def test_a_child_that_dies_is_a_backend_that_does_not_work(tmp_path, script, error):
    report = probe_backend("egl", fake_python(tmp_path, script))
    assert (report.works, report.error) == (False, error)


def run_python(code: str, **environment: str) -> str:
    child = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return child.stdout + child.stderr


@pytest.mark.gl
def test_osmesa_steps_in_where_neither_egl_nor_numba_works(tmp_path):
    if not probe_backend("osmesa").works:
        pytest.skip("OSMesa is not installed here")
    (tmp_path / "numba.py").write_text("raise ImportError('numba is broken here')\n")
    code = "from renderer.draw.probe import choose_backend; print(choose_backend())"
    environment = {"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent", "PYTHONPATH": str(tmp_path)}
    assert run_python(code, **environment).strip() == "osmesa"


def test_nothing_that_draws_gives_one_sentence_with_the_packages(tmp_path):
    for library in ("libEGL.so", "libGL.so", "libOSMesa.so"):
        for version in ("", ".1", ".6", ".8"):
            (tmp_path / f"{library}{version}").write_text("not a library")
    (tmp_path / "numba.py").write_text("raise ImportError('numba is broken here')\n")
    code = "from renderer.draw.probe import choose_backend; choose_backend()"
    environment = {"LD_LIBRARY_PATH": str(tmp_path), "PYTHONPATH": str(tmp_path)}
    last_line = run_python(code, **environment).strip().splitlines()[-1]
    assert "GLError: Neither OpenGL nor numba works on this machine" in last_line
    assert last_line.endswith("apt-get install libegl1 libgl1 libosmesa6")


def test_importing_the_renderer_loads_no_opengl():
    code = (
        "import sys, os, pkgutil, importlib, renderer\n"
        "for module in pkgutil.walk_packages(renderer.__path__, 'renderer.'):\n"
        f"    if module.name not in {LOADED_LATER}: importlib.import_module(module.name)\n"
        "heavy = {'OpenGL', 'pyrender', 'trimesh', 'torch', 'gradio', 'numba'}\n"
        "print(sorted(heavy & set(sys.modules)), 'PYOPENGL_PLATFORM' in os.environ)"
    )
    environment = dict(os.environ)
    environment.pop("PYOPENGL_PLATFORM", None)
    child = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert child.stdout.strip() == "[] False", child.stderr
