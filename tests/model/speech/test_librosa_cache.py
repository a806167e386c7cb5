"""What librosa compiles is made by one process, whole, and read by all others."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from model.speech import librosa_cache
from tests.helpers import ROOT

SMALL = """
from importlib import import_module
from model.speech import librosa_cache
librosa_cache._import = lambda: import_module("tests.model.speech.compiled_part")
print("hears", librosa_cache.librosa().doubled(21.0))
"""
WHOLE = """
import numpy as np
from model.speech.features import MelEncoder
from model.metrics.beats import speech_onsets
sound = np.random.default_rng(0).normal(0, 0.1, 16000).astype(np.float32)
print("hears", MelEncoder().encode(sound, 30).sum(), speech_onsets(sound))
"""


def start(cache: Path, code: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, "XDG_CACHE_HOME": str(cache)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def heard(child: subprocess.Popen[str]) -> str:
    """What it printed; it must have ended well."""
    out, said = child.communicate()
    assert child.returncode == 0 and out.startswith("hears"), said
    return out


def state(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize(("program", "count"), [(SMALL, 2), (WHOLE, 20)])
@pytest.mark.timeout(600)  # twenty processes at once, on two cores
def test_processes_that_begin_at_once_share_what_is_compiled_though_the_first_is_killed(
    tmp_path, program, count
):
    first = start(tmp_path, program)
    place = tmp_path / "co-speech-motion" / "librosa"
    while not list(place.glob("*/*")):
        assert first.poll() is None
    first.send_signal(signal.SIGKILL)
    others = [start(tmp_path, program) for _ in range(count)]
    first.communicate()
    (told,) = {heard(child) for child in others}
    before = state(place)
    assert any(path.suffix == ".nbc" for path in before)
    assert heard(start(tmp_path, program)) == told
    assert state(place) == before, "who reads writes nothing"


BEGUN = """
import sys, time
from app.run.models import get_system
from model.storage.cards import BUNDLED_WEIGHTS
get_system("globaldiff/local", BUNDLED_WEIGHTS)
while not hasattr(sys.modules.get("librosa.onset"), "onset_strength"):
    time.sleep(0.05)
print("hears")
"""


@pytest.mark.slow
def test_whoever_reads_a_system_has_librosa_imported_meanwhile():
    heard(start(Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()), BEGUN))


def test_a_folder_that_others_may_write_to_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = tmp_path / "co-speech-motion" / "librosa"
    assert librosa_cache._own_folder() == folder
    folder.chmod(0o777)
    own = librosa_cache._own_folder()
    assert own == tmp_path / f"co-speech-motion-{os.getuid()}" / "librosa"
    assert own.stat().st_mode & 0o777 == 0o700
