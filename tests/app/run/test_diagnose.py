"""`diagnose`: anyone's motion files, what is said of them, and what is left in the folder."""

import csv
import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.commands.cli import main
from app.errors import CancelledRun, RunError
from app.run.diagnose import DiagnoseRequest, diagnose_files, unique_names
from app.run.examples import CLEAN
from model.motion.motion import save_motion
from model.plan.annotation import NamedTier, Row
from model.plan.textgrid import textgrid_of_tiers
from model.speech.transcript import read_transcript
from tests.helpers import smooth_motion_example

FIGURES = ("figure6", "jitter", "error_growth")


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    path = tmp_path / "clip.npz"
    save_motion(smooth_motion_example(70), path)
    return path


def children() -> str:
    """Command lines of the processes that this one has started."""
    found = subprocess.run(
        ["ps", "--ppid", str(os.getpid()), "-o", "args="],
        check=True,
        capture_output=True,
        text=True,
    )
    return found.stdout


def refusal(motion: Path, *flags: str, capsys: pytest.CaptureFixture[str]) -> str:
    out = motion.parent / "out"
    assert main(["diagnose", str(motion), "--out", str(out), "--no-pictures", *flags]) == 1
    assert not out.exists()
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said[-1]) > 20 and "Traceback" not in said
    return said[-1]


def test_everything_is_measured_beside_a_reference_with_speech_and_words(
    motion: Path, speech: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = motion.parent
    theirs = smooth_motion_example(90, seed=1, expression_basis="flame100")
    poses = np.delete(theirs.poses, np.s_[66:75], axis=1)
    poses += (0.05 * np.random.default_rng(0).standard_normal(poses.shape)).astype(np.float32)
    reference, words, out = (folder / name for name in ("recorded.npz", "clip.TextGrid", "out"))
    np.savez(reference, poses=poses, trans=100 * theirs.trans, mocap_framerate=np.array(30))
    tier = NamedTier("words", (Row(0.2, 0.5, "hello"),))
    words.write_text(textgrid_of_tiers([tier], 2.0))
    argv = ["diagnose", str(motion), "--reference", str(reference), "--speech", str(speech)]
    argv += ["--transcript", str(words), "--joint", "left_wrist", "--start", "20"]
    assert main([*argv, "--out", str(out), "--no-pictures"]) == 0
    assert {path.name for path in out.iterdir()} == {
        *("diagnostics.json", "diagnostics.csv", "error_growth.json"),
        *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg", "pdf")),
    }
    diagnostics = json.loads((out / "diagnostics.json").read_text())
    raw = diagnostics["systems"]["clip"]["raw"]
    assert (diagnostics["joint"], diagnostics["tip"]) == ("left_wrist", None)
    assert len(raw["local_rotation_error_deg"]) == 55
    assert raw["beat_align"] is raw["beat_align_chance"] is None  # no onset is 2 s from the ends
    (word,) = diagnostics["words"]
    assert word == {"start_s": 0.2, "end_s": 0.5, "text": "hello", "confidence": 1.0}
    growth = json.loads((out / "error_growth.json").read_text())
    assert (growth["joint"], set(growth["motions"])) == ("left_wrist", {"clip", "reference"})
    assert growth["motions"]["clip"]["ratio"] > 1
    with (out / "diagnostics.csv").open() as file:
        rows = {(row["name"], row["measure"]) for row in csv.DictReader(file)}
    assert ("clip", "position_error_m") in rows and ("reference", "tip_sparc") in rows
    assert "frames 20 to 69" in (out / "figure6.svg").read_text()
    said = capsys.readouterr().err
    for words_said in (
        "The reference has 90 frames; the first 70 were measured",
        "The speech lasts 1.2 s and 2 of the motions 2.3 to 3.0 s",
        "recorded.npz: joints 52, SMPL-H",
        "units cm",
        "no expressions",
        "reference: 52 of 55 joints shake",
    ):
        assert words_said in said


def test_a_plain_text_is_found_in_the_speech_and_told_with_its_phones(tmp_path: Path) -> None:
    text = tmp_path / "said.txt"
    text.write_text(" ".join(w.text for w in read_transcript(CLEAN.with_suffix(".TextGrid")).words))
    request = DiagnoseRequest(
        motions=(CLEAN,),
        out=tmp_path / "out",
        speech=CLEAN.with_suffix(".wav"),
        transcript=text,
        words="recognise",  # which a text is better than
        has_pictures=False,
    )
    shares: list[float] = []
    said = diagnose_files(request, shares.append).said
    assert shares == sorted(shares) and shares[-1] == 1.0
    told = json.loads((tmp_path / "out" / "diagnostics.json").read_text())
    assert told["words_origin"] == said.origin == "aligned"
    assert [word["text"] for word in told["words"]][:3] == ["there", "is", "only"]
    assert all(0.5 <= word["confidence"] <= 1.0 for word in told["words"])
    assert len(told["phones"]) == len(said.phones) > 2 * len(said.words)


def test_one_frame_and_a_still_motion_are_measured_under_names_from_the_page(
    tmp_path: Path,
) -> None:
    """The pelvis is followed, which no rotation moves: there is no experiment on it."""
    paths = []
    for frames in (1, 50):
        motion = smooth_motion_example(frames)
        paths.append(tmp_path / f"{frames}.npz")
        np.savez(
            paths[-1],
            poses=np.repeat(motion.poses[:1], frames, axis=0),
            trans=np.repeat(motion.trans[:1], frames, axis=0),
            mocap_frame_rate=np.array(30),
        )
    request = DiagnoseRequest(
        motions=tuple(paths),
        out=tmp_path / "out",
        names=("one frame", "still"),
        joint="pelvis",
        has_pictures=False,
    )
    diagnosis = diagnose_files(request)
    assert list(diagnosis.diagnostics.systems) == ["one frame", "still"]
    kinds = [finding.kind for finding in diagnosis.diagnostics.findings["still"]]
    assert kinds == ["still"]
    assert diagnosis.error_growth is None
    assert not list((tmp_path / "out").glob("error_growth*"))
    assert any("one frame has 1 frame; speed needs 2" in note for note in diagnosis.notes)


def test_what_cannot_be_measured_is_refused_and_nothing_is_left(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no point 'nose'" in refusal(motion, "--joint", "nose", capsys=capsys)
    assert "frame 0 to 69; got 70" in refusal(motion, "--start", "70", capsys=capsys)
    text = tmp_path / "words.txt"
    text.write_text("hello")
    without_speech = refusal(motion, "--transcript", str(text), capsys=capsys)
    assert without_speech == refusal(motion, "--words", "recognise", capsys=capsys)
    assert "add it (--speech), or give words with their times" in without_speech
    grid = tmp_path / "words.TextGrid"
    grid.write_text("hello")
    assert "no TextGrid" in refusal(motion, "--transcript", str(grid), capsys=capsys)
    assert "words.txt" in refusal(motion, "--speech", str(text), capsys=capsys)


def test_motions_of_one_name_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    paths = [tmp_path / "ours" / "a.npz", tmp_path / "theirs" / "a.npz", tmp_path / "b.npz"]
    assert unique_names(paths) == ["ours/a", "theirs/a", "b"]
    with pytest.raises(RunError, match="ours/a"):
        unique_names([paths[0], paths[0]])


def test_two_motions_of_one_given_name_are_refused(motion: Path) -> None:
    with pytest.raises(RunError, match="'theirs'"):
        diagnose_files(
            DiagnoseRequest((motion, motion), motion.parent / "o", names=("theirs", "theirs"))
        )


STAGES = (0.1, 0.5, 0.55, 0.6, 0.7, 0.9)
"""Shares after reading, measuring, the experiment, its figure, the jitter sheet and the poses."""


def test_there_is_a_point_to_stop_at_between_all_files_measures_and_figures(
    motion: Path, tmp_path: Path
) -> None:
    told: list[float] = []
    request = DiagnoseRequest(
        (motion, motion), tmp_path / "out", ("a", "b"), reference=motion, has_pictures=False
    )
    diagnose_files(request, told.append)
    assert told == sorted(told) and told[-1] == 1.0
    reading, measuring, growing, *_ = (
        [share for share in told if low <= share < high]
        for low, high in zip((0, *STAGES), STAGES, strict=False)
    )
    assert len(reading) == 2
    assert len(set(measuring)) == 6  # each motion as it is and filtered
    assert len(set(growing)) == 3
    assert {0.55, 0.6, 0.7, 0.9} <= set(told)


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, STAGES[-1]])
def test_a_run_that_is_ended_at_any_point_leaves_nothing(
    motion: Path, tmp_path: Path, share: float
) -> None:
    def stop(told: float) -> None:
        if told >= share:
            raise CancelledRun

    request = DiagnoseRequest((motion, motion), tmp_path / "out", ("a", "b"), has_pictures=False)
    with pytest.raises(CancelledRun):
        diagnose_files(request, stop)
    assert not request.out.exists()


@pytest.mark.gl
def test_poses_that_are_being_drawn_can_be_ended(motion: Path, tmp_path: Path) -> None:
    told: list[float] = []

    def stop_at_the_fifth(share: float) -> None:
        told.append(share)
        if sum(0.7 <= each < 0.9 for each in told) == 5:
            raise CancelledRun

    request = DiagnoseRequest((motion,), tmp_path / "out")
    with pytest.raises(CancelledRun):
        diagnose_files(request, stop_at_the_fifth)
    assert not request.out.exists()
    assert "renderer.video.worker_child" not in children()


def test_more_motions_than_a_figure_holds_are_all_measured_and_the_shown_can_be_chosen(
    tmp_path: Path,
) -> None:
    paths = []
    for seed in range(8):
        paths.append(tmp_path / f"m{seed}.npz")
        save_motion(smooth_motion_example(20, seed), paths[-1])
    asked = DiagnoseRequest(tuple(paths), tmp_path / "out", has_pictures=False)
    for shown, drawn in (((), "m5"), (("m7", "m1"), "m7")):
        out = tmp_path / f"out-{drawn}"
        found = diagnose_files(replace(asked, out=out, shown=shown))
        assert len(found.diagnostics.systems) == 8
        assert drawn in (out / "figure6.svg").read_text()
        assert ("m0" in (out / "figure6.svg").read_text()) is not bool(shown)
        assert any("say which they are to show" in note for note in found.notes) is not bool(shown)
    with pytest.raises(RunError, match="no motion 'm9' to show"):
        diagnose_files(replace(asked, shown=("m9",)))
    with pytest.raises(RunError, match="at most 6"):
        diagnose_files(replace(asked, shown=tuple(path.stem for path in paths)))


def test_mean_speeds_need_a_speech(tmp_path: Path) -> None:
    save_motion(smooth_motion_example(20), tmp_path / "a.npz")
    request = DiagnoseRequest(
        (tmp_path / "a.npz",), tmp_path / "out", mean_speeds=tmp_path / "speeds.npy"
    )
    with pytest.raises(RunError, match="--speech"):
        diagnose_files(request)
