"""Commands into one folder: the second is told of the first and touches nothing."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.commands.cli import main
from app.errors import RunError
from app.run.output.result_folder import LOCK_NAME, ResultFolder, held_folder, remove_unfinished
from model.motion.motion import save_motion
from tests.app.study.made_study import write_inputs, write_plan
from tests.helpers import ROOT, smooth_motion_example

HOLD = """
import sys, time
from pathlib import Path
from app.run.output.result_folder import ResultFolder
with ResultFolder(Path(sys.argv[1])) as folder:
    folder.path("a.txt").write_text("whole")
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
    child.communicate("\n", timeout=20)
    assert child.returncode == 0


def test_the_second_is_told_who_is_at_work_and_the_first_ends_well(tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = owner(out)
    with pytest.raises(RunError) as told, ResultFolder(out):
        pass
    sentence = str(told.value)
    assert f"process {first.pid} on " in sentence and "ResultFolder" in sentence
    assert f"since {time.strftime('%Y-%m-')}" in sentence and "choose another folder" in sentence
    with pytest.raises(RunError, match="at work"):
        remove_unfinished(out)
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
        folder.path("b.txt").write_text("whole")
        folder.publish()
    assert [path.name for path in out.iterdir()] == ["b.txt"]


def test_a_folder_that_was_made_is_removed_only_when_empty(tmp_path: Path) -> None:
    with held_folder(tmp_path / "a" / "b"):
        pass
    assert not (tmp_path / "a" / "b").exists()
    with held_folder(tmp_path / "a" / "b"):
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
        ["diagnose", str(clips[0] / "clip.npz"), *common, "--no-pictures"],
        ["diagnose", *map(str, clips), *common, "--processes", "1"],
        ["steps", str(speech), *common, "--weights", str(weights), "--systems", "globaldiff/local"],
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
