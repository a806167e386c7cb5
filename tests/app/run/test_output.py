"""Result folders: whole or nothing, held by one command at a time; zips, and the revision."""

import os
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from app.commands.cli import main
from app.errors import RunError
from app.run.output.provenance import software_versions
from app.run.output.result_folder import (
    LOCK_NAME,
    ResultFolder,
    lock_folder,
    require_free_space,
    zip_files,
    zip_folder,
)
from model.motion.motion import save_motion
from model.storage.revision import revision
from tests.app.study.made_study import write_inputs, write_plan
from tests.helpers import ROOT, smooth_motion_example


def test_results_appear_together_and_only_at_the_end(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with ResultFolder(out) as folder:
        folder.new_path("a.txt").write_text("a")
        folder.scratch("speech.wav").write_text("only for the run")
        assert [path for path in out.iterdir() if not path.name.startswith(".")] == []
        files = folder.publish()
    assert files == (out / "a.txt",)
    assert [path.name for path in out.iterdir()] == ["a.txt"]


def test_a_failed_run_leaves_an_earlier_result_as_it_was_or_no_folder(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("earlier")
    with pytest.raises(KeyError), ResultFolder(tmp_path) as folder:
        folder.new_path("a.txt").write_text("half")
        raise KeyError
    assert (tmp_path / "a.txt").read_text() == "earlier"
    with pytest.raises(KeyError), ResultFolder(tmp_path / "new"):
        raise KeyError
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_what_a_killed_run_left_is_removed(tmp_path: Path) -> None:
    (tmp_path / ".unfinished-1-abc").mkdir()
    with ResultFolder(tmp_path) as folder:
        folder.publish()
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_to_is_named_in_one_sentence(tmp_path: Path) -> None:
    for place in ["file", "file/below", "/proc/nowhere"]:
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
    zips = []
    for folder, names in (("a", ("x", "y")), ("b", ("y", "x"))):
        media = tmp_path / folder / "study" / "media"
        media.mkdir(parents=True)
        for number, name in enumerate(names):
            (media / f"{name}.mp4").write_bytes(name.encode())
            os.utime(media / f"{name}.mp4", (1e9 + number, 1e9 + number))
        zips.append(zip_folder(media.parent, tmp_path / f"{folder}.zip").read_bytes())
    assert zips[0] == zips[1]


HOLD = """
import sys, time
from pathlib import Path
from app.run.output.result_folder import ResultFolder
with ResultFolder(Path(sys.argv[1])) as folder:
    folder.new_path("a.txt").write_text("whole")
    print("holds", flush=True)
    sys.stdin.readline()
    folder.publish()
"""


def owner(out: Path) -> subprocess.Popen[str]:
    """A command that is in the middle of its work in ``out``; a line tells it to end well."""
    child = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(out)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None and child.stdout.readline() == "holds\n"
    return child


def finish(child: subprocess.Popen[str]) -> None:
    child.communicate("\n", timeout=60)
    assert child.returncode == 0


def test_the_second_is_told_who_is_at_work_and_the_first_ends_well(tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = owner(out)
    with pytest.raises(RunError) as told, ResultFolder(out):
        pass
    sentence = str(told.value)
    assert f"process {first.pid} on " in sentence and "ResultFolder" in sentence
    assert "since 20" in sentence and "choose another folder" in sentence
    finish(first)
    assert (out / "a.txt").read_text() == "whole"
    assert [path.name for path in out.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_what_a_killed_owner_left_is_no_obstacle(number: signal.Signals, tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = owner(out)
    first.send_signal(number)
    first.wait()
    assert (out / LOCK_NAME).exists()
    with ResultFolder(out) as folder:
        folder.new_path("b.txt").write_text("whole")
        folder.publish()
    assert [path.name for path in out.iterdir()] == ["b.txt"]


def test_a_folder_that_was_made_is_removed_only_when_empty(tmp_path: Path) -> None:
    with lock_folder(tmp_path / "a" / "b"):
        pass
    assert not (tmp_path / "a" / "b").exists()
    with lock_folder(tmp_path / "a" / "b"):
        (tmp_path / "a" / "b" / "c").touch()
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["c"]


def test_commands_refuse_a_folder_in_which_another_is_at_work(
    tmp_path: Path, weights: Path, speech: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clips = [tmp_path / "clips1", tmp_path / "clips2"]
    for number, folder in enumerate(clips):
        folder.mkdir()
        save_motion(smooth_motion_example(30, number), folder / "clip.npz")
        os.link(speech, folder / "clip.wav")
    write_inputs(tmp_path, ["one", "two"], ["clip"])
    plan = write_plan(tmp_path, ["one", "two"], ["clip"])
    out = tmp_path / "out"
    common = ["--out", str(out)]
    made = ["--weights", str(weights), "--steps", "1", "--no-video"]
    commands = [
        ["generate", str(speech), *common, *made],
        ["generate", str(clips[0]), *common, *made, "--processes", "1"],
        ["diagnose", str(clips[0] / "clip.npz"), *common, "--no-poses"],
        ["diagnose", *map(str, clips), *common, "--processes", "1"],
        [
            "step-sweep",
            str(speech),
            *common,
            "--weights",
            str(weights),
            "--systems",
            "globaldiff/local",
        ],
        ["study", "export", str(plan), *common],
    ]
    first = owner(out)
    before = sorted(out.rglob("*"))
    for command in commands:
        assert main(command) == 1, command
        said = capsys.readouterr()
        assert f"process {first.pid} on " in said.err and said.out == "", command
        assert sorted(out.rglob("*")) == before, command
    finish(first)
    assert [path.name for path in out.iterdir()] == ["a.txt"]


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository of one file, which Git takes for that of the code."""
    folder = tmp_path / "code"
    subprocess.run(["git", "init", "-q", str(folder)], check=True)
    monkeypatch.setenv("GIT_DIR", str(folder / ".git"))
    monkeypatch.setenv("GIT_WORK_TREE", str(folder))
    (folder / "code.py").write_text("pass\n")
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    for command in (("add", "code.py"), (*who, "commit", "-q", "-m", "Begin")):
        subprocess.run(["git", *command], cwd=folder, check=True)
    return folder


def test_results_and_cards_name_one_revision_whatever_lies_beside_the_code(
    repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clean = revision()
    assert len(clean) >= 7 and not clean.endswith("+")
    (repository / "results.json").write_text("{}")
    assert software_versions()["project"] == revision() == clean
    (repository / "code.py").write_text("1 / 0\n")
    assert software_versions()["project"] == revision() == f"{clean}+"
    monkeypatch.setenv("GIT_DIR", str(repository / "nowhere"))
    assert software_versions()["project"] == revision() == "unknown"
