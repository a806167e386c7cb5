"""What was assumed of files reaches notes and `diagnostics.json`, and is told otherwise."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.commands.cli import main
from model.faults.evidence import Finding
from model.faults.table import FAULTS, without
from tests.model.formats.made import BODY_JOINTS, FROM_Y, Person, turned


def finding(kind: str) -> Finding:
    return Finding("", {}, kind=kind)


def test_nothing_is_found_of_what_a_file_does_not_tell() -> None:
    found = [finding(fault.kind) for fault in FAULTS]
    kept = {each.kind for each in without(found, {"hands", "face", "place", "detail"})}
    gone = {fault.kind for fault in FAULTS} - kept
    assert {"finger_range", "frozen_hand", "still_face", "still_translation", "jerk"} <= gone
    assert {"frozen", "pops", "amplitude", "hand_in_body", "swapped_sides"} <= kept
    assert without(found, ()) == found
    only = {each.kind for each in without(found, {"finger_angles"})}
    assert {fault.kind for fault in FAULTS} - only == {"finger_range"}


def test_assumptions_are_told_counted_apart_and_overruled(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = Person(1).motion(24)
    poses, trans = turned(motion, FROM_Y["z"])
    body = poses[:, BODY_JOINTS].reshape(len(poses), -1)
    np.savez(tmp_path / "theirs.npz", poses=body, trans=trans, fps=np.array(30))
    np.savez(tmp_path / "recorded.npz", poses=motion.poses, trans=motion.trans)
    out = tmp_path / "out"
    argv = ["diagnose", str(tmp_path / "theirs.npz"), "--no-pictures", "--out", str(out)]
    argv += ["--reference", str(tmp_path / "recorded.npz")]
    assert main([*argv, "--assume", "motions:rate=25,reference:units=m"]) == 0
    told = json.loads((out / "diagnostics.json").read_text())
    assumed = {
        name: {each["what"]: (each["value"], each["sure"]) for each in found}
        for name, found in told["assumed"].items()
    }
    assert assumed["theirs"]["up"] == ("z", "sure")
    assert assumed["theirs"]["rate"] == ("25", "told")
    assert assumed["reference"]["rate"] == ("30", "unsure")  # of the motions alone
    assert assumed["reference"]["units"] == ("m", "told")
    assert told["lacks"] == {"theirs": ["detail", "face", "hands"], "reference": ["face"]}
    kinds = {each["kind"] for each in told["findings"]["theirs"]}
    assert not kinds & {"frozen_hand", "finger_range", "still_face", "jerk", "high_frequency"}
    said = capsys.readouterr().err
    assert told["notes"][0].startswith("The motions differ in frames a second")
    assert "theirs has no fingers" in said and "theirs.npz: up z" in said


def test_what_nobody_can_say_is_refused_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["diagnose", "none.npz", "--out", str(tmp_path / "out"), "--assume", "up=w"])
    assert left.value.code == 2
    assert "up must be one of y, -y" in capsys.readouterr().err
