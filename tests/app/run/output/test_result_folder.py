import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from app.errors import RunError
from app.run.output.result_folder import ResultFolder, require_free_space, zip_files, zip_folder


def test_results_appear_together_and_only_at_the_end(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with ResultFolder(out) as folder:
        folder.path("a.txt").write_text("a")
        folder.scratch("speech.wav").write_text("only for the run")
        assert [path for path in out.iterdir() if not path.name.startswith(".")] == []
        files = folder.publish()
    assert files == (out / "a.txt",)
    assert [path.name for path in out.iterdir()] == ["a.txt"]


def test_a_failed_run_leaves_an_earlier_result_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("earlier")
    with pytest.raises(KeyError), ResultFolder(tmp_path) as folder:
        folder.path("a.txt").write_text("half")
        raise KeyError
    assert (tmp_path / "a.txt").read_text() == "earlier"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_failed_run_removes_the_folder_that_it_made(tmp_path: Path) -> None:
    with pytest.raises(KeyError), ResultFolder(tmp_path / "new"):
        raise KeyError
    assert not (tmp_path / "new").exists()


def test_what_a_killed_run_left_is_removed_but_not_what_a_living_one_writes(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    (tmp_path / f".unfinished-{dead.pid}-abc").mkdir()
    (tmp_path / f".unfinished-{os.getppid()}-abc").mkdir()
    with ResultFolder(tmp_path) as folder:
        folder.publish()
    assert [path.name for path in tmp_path.iterdir()] == [f".unfinished-{os.getppid()}-abc"]


def test_what_nobody_has_written_to_for_a_day_is_removed_whoever_has_its_number_now(
    tmp_path: Path,
) -> None:
    old, new = (tmp_path / f".unfinished-{os.getppid()}-{name}" for name in ("old", "new"))
    yesterday = time.time() - 25 * 3600
    for folder in (old, new):
        folder.mkdir()
        (folder / "a.mp4").write_text("half")
        os.utime(folder, (yesterday, yesterday))
    os.utime(old / "a.mp4", (yesterday, yesterday))
    with ResultFolder(tmp_path) as folder:
        folder.publish()
    assert [path.name for path in tmp_path.iterdir()] == [new.name]


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/nowhere"])
def test_a_place_that_cannot_be_written_to_is_named_in_one_sentence(
    tmp_path: Path, place: str
) -> None:
    (tmp_path / "file").write_text("")
    out = tmp_path / place
    with pytest.raises(RunError, match=str(out)), ResultFolder(out):
        pass


def test_too_little_free_space_is_refused_with_both_numbers(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"\d+ MB free .* needs about 1000000000 MB"):
        require_free_space(tmp_path, 10**15)
    require_free_space(tmp_path, 1)


def test_a_zip_holds_the_files_under_its_own_name_and_none_is_left_half_written(
    tmp_path: Path,
) -> None:
    files = [tmp_path / "a.json", tmp_path / "b.mp4"]
    for file in files:
        file.write_bytes(b"0" * 1000)
    with zipfile.ZipFile(zip_files(files, tmp_path / "run.zip")) as archive:
        assert archive.namelist() == ["run/a.json", "run/b.mp4"]
        assert archive.read("run/b.mp4") == b"0" * 1000
        assert archive.getinfo("run/a.json").compress_size < 100
    with pytest.raises(FileNotFoundError):
        zip_files([tmp_path / "absent"], tmp_path / "half.zip")
    assert {path.name for path in tmp_path.iterdir()} == {"a.json", "b.mp4", "run.zip"}


def test_a_zip_says_nothing_of_when_its_files_were_made(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder / "study" / "media").mkdir(parents=True)
    for folder, names in (("a", ("x", "y")), ("b", ("y", "x"))):
        for number, name in enumerate(names):
            path = tmp_path / folder / "study" / "media" / f"{name}.mp4"
            path.write_bytes(name.encode())
            os.utime(path, (1e9 + number, 1e9 + number))
    first = zip_folder(tmp_path / "a" / "study", tmp_path / "a.zip")
    second = zip_folder(tmp_path / "b" / "study", tmp_path / "b.zip")
    assert first.read_bytes() == second.read_bytes()
