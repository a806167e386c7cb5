"""Machine code that several processes share from their first moment on."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers import ROOT
from tests.processes.made import wait_for

pytestmark = pytest.mark.slow

ROUNDS = int(os.environ.get("COLD_STARTS", "1"))
DRAW = """
import hashlib, sys
import numpy as np
from renderer.draw import rasteriser
from renderer.draw.probe import try_backend
assert try_backend("software").works
corners = np.empty((5, 3))
points = np.arange(15, dtype=np.float32).reshape(5, 3) - 20
rasteriser.project(points, np.zeros(3), np.eye(3), 2.0, np.ones(2), corners)
print("drawn", hashlib.sha256(corners.tobytes()).hexdigest())
"""


def start(cache: Path) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", DRAW],
        cwd=ROOT,
        env={**os.environ, "XDG_CACHE_HOME": str(cache), "NUMBA_CACHE_DIR": ""},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def told(child: subprocess.Popen) -> tuple[str, str]:
    """What it drew and what it said; it must have ended well."""
    out, error = child.communicate(timeout=120)
    assert child.returncode == 0, error
    assert out.startswith("drawn ")
    return out, error


def kept(cache: Path) -> Path:
    """The one folder of code."""
    (facts,) = cache.glob("co-speech-motion/machine-code/*/complete.json")
    return facts.parent


@pytest.mark.parametrize("round_", range(ROUNDS))
def test_processes_that_begin_at_once_share_code_though_one_is_killed_and_mend_it(tmp_path, round_):
    first = start(tmp_path)
    wait_for(lambda: list(tmp_path.rglob("*.nb[ci]")))
    others = [start(tmp_path) for _ in range(2)]
    first.send_signal(signal.SIGKILL)
    drawn = {told(child) for child in others}
    first.communicate()
    assert len(drawn) == 1, drawn
    before = {path: path.stat().st_mtime_ns for path in kept(tmp_path).rglob("*")}
    assert told(start(tmp_path)) in drawn
    assert {path: path.stat().st_mtime_ns for path in kept(tmp_path).rglob("*")} == before
    assert not list(tmp_path.rglob("*unfinished*"))
    code = max(kept(tmp_path).rglob("*.nbc"), key=lambda path: path.stat().st_size)
    code.write_bytes(code.read_bytes()[:1000])
    anew, said = told(start(tmp_path))
    assert "was damaged (a file is not what was written); made anew" in said
    assert (anew, "") in drawn
