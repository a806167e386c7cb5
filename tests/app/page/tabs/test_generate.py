import os
import time
from pathlib import Path

from app.page.parts.catalogue import default_systems
from app.page.tabs.motion import fresh_copy
from model.systems.globaldiff.config import BEST, SYSTEMS


def test_at_first_a_few_systems_are_ticked_that_show_most() -> None:
    first = [BEST, "globaldiff/local", "globaldiff/global"]
    assert default_systems(list(SYSTEMS)) == first
    assert default_systems(first[:2]) == first[:2]
    assert default_systems(["a", "globaldiff/global", "b", "c"]) == ["a", "globaldiff/global", "b"]


def test_an_example_is_as_new_as_an_upload_however_old_its_file(tmp_path: Path) -> None:
    path = tmp_path / "example.wav"
    path.write_bytes(b"sound")
    os.utime(path, (0, 0))
    for _ in range(2):
        copy = fresh_copy(path, tmp_path / "cache")
        assert copy.read_bytes() == b"sound" and time.time() - copy.stat().st_mtime < 60
        os.utime(copy, (0, 0))
    assert [each.name for each in copy.parent.iterdir()] == ["example.wav"]
