"""The choice of backend survives whatever a driver does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from renderer.draw import probe
from renderer.draw.probe import BackendReport, choose_backend, probe_backend
from tests.helpers import ROOT


@pytest.mark.parametrize("working", [("egl", "osmesa"), ("osmesa",)])
def test_the_first_that_works_draws(monkeypatch, working):
    report = lambda name: BackendReport(name, error="" if name in working else "none")  # noqa: E731
    monkeypatch.setattr(probe, "probe_backend", report)
    assert choose_backend.__wrapped__() == working[0]


@pytest.mark.parametrize(
    ("script", "error"),
    [
        ("kill -SEGV $$\n", "the test process ended by signal 11 (SIGSEGV)"),
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


def run(code: str, **environment: str) -> str:
    """What a process says."""
    usual = {name: value for name, value in os.environ.items() if "PYOPENGL" not in name}
    child = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**usual, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return (child.stdout + child.stderr).strip()


CHOOSE = "from renderer.draw.probe import choose_backend; print(choose_backend())"


def without_opengl(folder: Path) -> dict[str, str]:
    """The environment of a machine that lacks it."""
    for library in ("libEGL.so", "libGL.so", "libOSMesa.so"):
        for version in ("", ".1", ".6", ".8"):
            (folder / f"{library}{version}").write_text("not a library")
    return {"LD_LIBRARY_PATH": str(folder)}


def test_nothing_that_draws_gives_one_sentence_with_the_packages(tmp_path):
    last_line = run(CHOOSE, **without_opengl(tmp_path)).splitlines()[-1]
    assert "GLError: OpenGL does not work on this machine" in last_line
    assert last_line.endswith("apt-get install libegl1 libgl1 libosmesa6")


@pytest.mark.slow
@pytest.mark.gl
def test_osmesa_steps_in_where_egl_does_not_work():
    if not probe_backend("osmesa").works:
        pytest.skip("OSMesa is not installed here")
    assert run(CHOOSE, __EGL_VENDOR_LIBRARY_DIRS="/nonexistent") == "osmesa"


def test_importing_the_renderer_loads_no_opengl():
    code = (
        "import sys, os, pkgutil, importlib, renderer\n"
        "for module in pkgutil.walk_packages(renderer.__path__, 'renderer.'):\n"
        "    if module.name != 'renderer.draw.gl': importlib.import_module(module.name)\n"
        "heavy = {'OpenGL', 'pyrender', 'trimesh', 'torch', 'gradio'}\n"
        "print(sorted(heavy & set(sys.modules)), 'PYOPENGL_PLATFORM' in os.environ)"
    )
    assert run(code) == "[] False"
