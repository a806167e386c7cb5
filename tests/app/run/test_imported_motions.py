"""Motion files of anyone's: measured, told, drawn in register, and what is left in the folder."""

import csv
import json
import wave
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.commands.cli import main
from app.config import EXAMPLES
from app.errors import Cancelled, RunError
from app.run.bodies import PointTracker, body_motion
from app.run.callbacks import RunStage
from app.run.diagnostics import cached_speech_onsets, measure_motions, write_diagnostics
from app.run.display import Display
from app.run.examples import (
    CLEAN,
    FAULTY,
    TWO_MINUTES,
    add_tremble,
    inject_faults,
    write_faulty_example,
)
from app.run.imported_motions import protocol_inputs
from app.run.output.provenance import motion_labels
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import read_run
from app.run.pipeline import run
from app.run.requests.convert import replace_fields
from conventions.joints import JOINT_INDEX
from model.diagnostics import diagnose
from model.faults.analysis import Finding
from model.faults.table import FAULTS, drop_findings_on_missing_parts
from model.formats.reading import parse_import_overrides
from model.metrics.beats import speech_onsets
from model.metrics.protocols.clip import ProtocolInputs
from model.metrics.protocols.table import PROTOCOLS
from model.metrics.smoothness import VelocitySpectrum
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import load_motion, save_motion
from model.plan.annotation_files import Interval
from model.speech.audio import Speech, load_speech, write_wav
from model.speech.transcript import Transcript, Word
from renderer.body.body import load_body
from renderer.video.encoder import probe_video
from tests.app.measured import both, diagnostics_of
from tests.app.recorded_callbacks import RecordedCallbacks
from tests.app.requests import diagnose_request
from tests.helpers import csv_rows, smooth_motion_example
from tests.model.formats.made import BODY_JOINTS, FROM_Y, Person, turned
from tests.model.made import made_waveform
from tests.renderer.body.test_body import smplx_file

FIGURES = ("figure6", "jitter")


def test_everything_is_measured_beside_a_reference_with_speech_and_words(
    motion: Path, tmp_path: Path
) -> None:
    """Of two motions and a reference in another format; words are looked for in the speech."""
    theirs = smooth_motion_example(55, seed=1, expression_basis="flame100")
    poses = np.delete(theirs.poses, np.s_[66:75], axis=1)
    poses += (0.05 * np.random.default_rng(0).standard_normal(poses.shape)).astype(np.float32)
    reference, speech, text = (tmp_path / name for name in ("their.npz", "begin.wav", "said.txt"))
    np.savez(reference, poses=poses, trans=100 * theirs.trans, mocap_framerate=np.array(30))
    write_wav(speech, load_speech(EXAMPLES / "three_reasons.wav").waveform[: 16_000 * 3])
    text.write_text("There are three reasons.")
    request = diagnose_request(
        motions=(motion, motion), out=tmp_path / "out", names=("clip", "again"), speech=speech,
        reference=reference, transcript=text, word_source="recognise", tracked_point="left_wrist",
        start_frame=20, has_figure_poses=False,
    )  # fmt: skip
    callbacks = RecordedCallbacks()
    found = run(request, callbacks)
    assert {path.name for path in request.output.out.iterdir()} == {
        *("diagnostics.json", "diagnostics.csv"),
        *("run.json", "speech.wav", "timeline.json", "viewer"),
        *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg", "pdf", "txt")),
    }
    # There is a point to stop at between all files, measures and figures.
    shares = {stage: callbacks.shares_of(stage) for stage in ("speech", "numbers", "figure")}
    assert all(each == sorted(each) and each[-1] == 1.0 for each in shares.values())
    assert len(set(shares["speech"])) == 4  # each file, and all
    assert len(set(shares["numbers"])) == 7  # each motion as it is and filtered, and all
    assert len(set(shares["figure"])) == 3

    told = json.loads((request.output.out / "diagnostics.json").read_text())
    raw = told["systems"]["clip"]["raw"]
    assert (told["tracked_point"], told["fingertip"]) == ("left_wrist", None)
    assert len(raw["local_rotation_error_deg"]) == 55
    assert raw["beat_align"] is raw["beat_align_chance"] is None  # no onset is 2 s from the ends
    assert told["words_origin"] == "aligned"  # a text is better than none
    assert [word["text"] for word in told["words"]] == ["There", "are", "three", "reasons"]
    assert len(told["phones"]) > 2 * len(told["words"])
    rows = {
        (row["name"], row["measure"]) for row in csv_rows(request.output.out / "diagnostics.csv")
    }
    assert ("clip", "position_error_m") in rows and ("reference", "tip_jerk_m_s3") in rows
    assert "frames 20 to 39" in (request.output.out / "figure6.svg").read_text()
    said = " ".join(
        [*found.notes, *(each.sentence for each in read_run(request.output.out).findings)]
    )
    for words_said in (
        "The reference has 55 frames; only the first 40 were measured",
        "The speech lasts 3.0 s, but 3 of the motions last 1.3 to 1.8 s",
        "their.npz: joints 52, as many joints as SMPL-H",
        "units cm",
        "no expressions",
        "in 52 of the 55 joints",
    ):
        assert words_said in said


def test_a_joint_that_snaps_is_the_worst_second_of_the_time_line(tmp_path: Path) -> None:
    """Of a point that the snap does not move."""
    motion = smooth_motion_example(90)
    motion.poses[45:, 3 * JOINT_INDEX["left_knee"]] += np.radians(120)
    save_motion(motion, tmp_path / "a.npz")
    request = diagnose_request(
        motions=(tmp_path / "a.npz",), out=tmp_path / "out", has_figures=False
    )
    run(request)
    worst, *others = json.loads((tmp_path / "out" / "timeline.json").read_text())["worst"]
    assert (worst["start_s"], worst["end_s"], worst["joint"]) == (1.0, 2.0, "left knee")
    assert worst["snap_deg"] > 100 and all("jerk_m_s3" in each for each in others)


def test_one_frame_and_a_still_motion_are_measured_under_names_from_the_page(
    tmp_path: Path,
) -> None:
    """The pelvis is followed, which no rotation moves: there is no experiment on it."""
    paths = [tmp_path / f"{frames}.npz" for frames in (1, 50)]
    for frames, path in zip((1, 50), paths, strict=True):
        one = smooth_motion_example(1)
        poses, trans = (np.repeat(each, frames, axis=0) for each in (one.poses, one.trans))
        np.savez(path, poses=poses, trans=trans, mocap_frame_rate=np.array(30))
    request = diagnose_request(
        motions=tuple(paths), out=tmp_path / "out", names=("one frame", "still"),
        tracked_point="pelvis", has_figure_poses=False,
    )  # fmt: skip
    diagnosis = run(request)
    assert list(diagnosis.diagnostics.systems) == ["one frame", "still"]
    kinds = [finding.kind for finding in diagnosis.diagnostics.findings["still"]]
    assert kinds == ["still"]
    assert any("one frame has 1 frame; speed needs 2" in note for note in diagnosis.notes)


def test_what_cannot_be_measured_is_refused_and_nothing_is_left(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, grid, out = (tmp_path / name for name in ("words.txt", "words.TextGrid", "out"))
    for path in (text, grid):
        path.write_text("hello")

    def refusal(*flags: str) -> str:
        argv = ["diagnose", str(motion), "--out", str(out), "--no-poses", *flags]
        assert main(argv) == 1 and not out.exists()
        return capsys.readouterr().err

    assert "no point 'nose'" in refusal("--tracked-point", "nose")
    assert "must be from 0 to 39; got 40" in refusal("--start", "40")
    without_speech = refusal("--transcript", str(text))
    assert without_speech == refusal("--words", "recognise")
    assert "add it (--speech), or give a TextGrid" in without_speech
    assert "not a TextGrid" in refusal("--transcript", str(grid))
    assert "words.txt" in refusal("--speech", str(text))
    assert "also give --speech" in refusal("--mean-speeds", "speeds.npy")
    assert "--window" in refusal("--overlap", "4")


def test_motions_of_one_name_are_told_apart_by_their_folders_or_refused(tmp_path: Path) -> None:
    paths = [tmp_path / "ours" / "a.npz", tmp_path / "theirs" / "a.npz", tmp_path / "b.npz"]
    asked = diagnose_request(motions=tuple(paths), out=tmp_path / "o", has_figure_poses=False)
    assert motion_labels(asked.motions) == ["ours/a", "theirs/a", "b"]
    with pytest.raises(RunError, match="'theirs'"):
        run(replace_fields(asked, motions=(CLEAN, CLEAN), names=("theirs", "theirs")))
    with pytest.raises(RunError, match="procedural_speaker/a_"):
        run(replace_fields(asked, motions=(CLEAN, CLEAN)))


@pytest.mark.parametrize("stage", ["speech", "numbers", "figure"])
def test_a_run_that_is_ended_at_any_point_leaves_nothing(
    motion: Path, tmp_path: Path, stage: RunStage
) -> None:
    request = diagnose_request(
        motions=(motion, motion), out=tmp_path / "out", names=("a", "b"), has_figure_poses=False
    )
    with pytest.raises(Cancelled):
        run(request, RecordedCallbacks(0.3, stage=stage))
    assert not request.output.out.exists()


def test_of_more_motions_than_a_figure_holds_all_are_measured_and_the_shown_are_chosen(
    tmp_path: Path,
) -> None:
    paths = tuple(tmp_path / f"m{seed}.npz" for seed in range(7))
    for seed, path in enumerate(paths):
        save_motion(smooth_motion_example(12, seed), path)
    asked = diagnose_request(
        motions=paths,
        out=tmp_path / "out",
        visible=("m6",),
        figure_panels=("a",),
        has_figure_poses=False,
    )
    found = run(asked)
    assert len(found.diagnostics.systems) == 7
    drawn = (asked.output.out / "figure6.svg").read_text()
    assert "m6" in drawn and "m0" not in drawn
    assert not any("others can be chosen" in note for note in found.notes)
    for shown, words in (
        (("m9",), "Unknown motion m9"),
        (tuple(path.stem for path in paths), "at most 6"),
    ):
        with pytest.raises(RunError, match=words):
            run(replace_fields(asked, visible=shown))


def test_the_json_is_what_was_measured_and_the_csv_has_each_number_once(tmp_path: Path) -> None:
    spectrum = VelocitySpectrum(np.array([0.0, 5.0]), np.array([0.25, 0.75]))
    found = diagnostics_of(
        both(foot_slide_m_s=0.5), **{"a/b": both(tip_jerk_m_s3=1.5, tip_spectrum=spectrum)}
    )
    said = Transcript(
        (Word(0.2, 0.5, "hello", 0.75),), {}, "recognised", (Interval(0.2, 0.3, "HH"),)
    )
    with ResultFolder(tmp_path) as folder:
        write_diagnostics(found, folder, said)
        folder.publish()
    content = json.loads((tmp_path / "diagnostics.json").read_text())
    (word,) = content.pop("words")
    assert word == {"start_s": 0.2, "end_s": 0.5, "text": "hello", "confidence": 0.75}
    assert content.pop("words_origin") == "recognised"
    assert content.pop("phones") == [{"start_s": 0.2, "end_s": 0.3, "text": "HH"}]
    assert content == found.as_json()
    assert content["systems"]["a/b"]["raw"]["tip_speed_m_s"] is None
    with (tmp_path / "diagnostics.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["name", "post_filter", "measure", "index", "value", "protocol"]
    assert rows[:5] == [
        ["a/b", "raw", "tip_jerk_m_s3", "", "1.5", "workbench/1"],
        ["a/b", "raw", "tip_spectrum", "frequency_hz/0", "0.0", "workbench/1"],
        ["a/b", "raw", "tip_spectrum", "frequency_hz/1", "5.0", "workbench/1"],
        ["a/b", "raw", "tip_spectrum", "velocity_power/0", "0.25", "workbench/1"],
        ["a/b", "raw", "tip_spectrum", "velocity_power/1", "0.75", "workbench/1"],
    ]
    assert ["reference", "savgol", "foot_slide_m_s", "", "0.5", "workbench/1"] in rows
    assert len({tuple(row[:4]) for row in rows}) == len(rows)


def test_every_number_carries_the_id_of_its_protocol(tmp_path: Path) -> None:
    motions = {"a": smooth_motion_example(400), "reference": smooth_motion_example(400, seed=1)}
    inputs = ProtocolInputs(np.zeros(16000 * 13, np.float32), np.full(13, 0.1))
    onsets_s = np.arange(2.5, 11, 0.4)
    found = measure_motions(motions, PointTracker(), onsets_s, protocol_inputs=inputs)
    with ResultFolder(tmp_path) as folder:
        write_diagnostics(found, folder)
        folder.publish()
    content = json.loads((tmp_path / "diagnostics.json").read_text())
    raw = content["systems"]["a"]["raw"]
    assert content["protocol_of"].keys() == raw.keys() - {"protocols"}
    assert content["protocol_of"]["beat_align"] == "beats/workbench-emage"
    assert content["protocol_of"]["l1_diversity_m"] == "l1div/emage"
    measured = {"physical/mbench", "gac/unicamp", "hellinger/genea", "cca/genea"}
    assert raw["protocols"].keys() == measured  # no onsets in silence
    assert content["reference"]["raw"]["protocols"].keys() == {"physical/mbench", "gac/unicamp"}
    assert "protocols" not in content["systems"]["a"]["savgol"]
    rows = csv_rows(tmp_path / "diagnostics.csv")
    assert {row["protocol"] for row in rows} == {*content["protocol_of"].values(), *measured}
    assert set(content["protocol_of"].values()) <= PROTOCOLS.keys()
    (dice,) = (row for row in rows if row["measure"] == "dice")
    assert (dice["name"], dice["protocol"]) == ("a", "gac/unicamp")
    assert float(dice["value"]) == raw["protocols"]["gac/unicamp"]["dice"]


def test_faces_are_those_of_a_licensed_body_that_only_jaw_and_expressions_move(tmp_path: Path):
    path = smplx_file(tmp_path / "SMPLX_NEUTRAL.npz")
    request = diagnose_request(motions=(tmp_path / "a.npz",), out=tmp_path / "out", body=path)
    inputs = protocol_inputs(request, None, 40)
    motions = {
        name: smooth_motion_example(40, seed, expression_basis="flame100")
        for name, seed in (("a", 0), ("reference", 1))
    }
    assert inputs.make_face_vertices is not None
    face = inputs.make_face_vertices(motions["a"])
    assert face is not None
    still = motions["a"].poses.copy().reshape(40, 55, 3)
    still[:, [joint for joint in range(55) if joint != JOINT_INDEX["jaw"]]] = 0
    moved = replace(
        motions["a"], poses=still.reshape(40, 165), trans=np.zeros_like(motions["a"].trans)
    )
    wanted = np.concatenate(list(load_body(path).posed_vertices(body_motion(moved))))
    np.testing.assert_allclose(face(slice(5, 30)), wanted[5:30], atol=1e-6)
    found = (
        measure_motions(motions, PointTracker(), protocol_inputs=inputs).systems["a"].raw.published
    )
    assert found is not None and found.protocols["mse_face/emage"]["mse_m2"] > 0
    assert found.protocols["lvd/emage"]["lvd_m"] > 0
    assert inputs.make_face_vertices(smooth_motion_example(40)) is None  # ARKit's blendshapes


def test_each_motion_can_be_stopped_at_as_it_is_and_filtered() -> None:
    motions = {"a": smooth_motion_example(40), "reference": smooth_motion_example(40, seed=1)}
    tracker = PointTracker()
    told: list[float] = []
    found = measure_motions(motions, tracker, on_share=told.append)
    assert told == [0.0, 0.25, 0.5, 0.75]
    assert list(found.systems) == ["a"] and found.reference is not None

    def stop(share: float) -> None:
        if share >= 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        measure_motions(motions, tracker, on_share=stop)


def test_the_point_is_the_one_that_the_measures_follow_of_themselves() -> None:
    motions = {"a": smooth_motion_example(40)}
    for point in ("left_index", "right_wrist"):
        found = measure_motions(motions, PointTracker(point))
        assert found.as_json() == diagnose(motions, open_body_skeleton(), point=point).as_json()


def test_onsets_are_those_of_the_clip() -> None:
    first = Speech(made_waveform(32_000), "first")
    second = Speech(np.roll(first.waveform, 4_000), "second")
    for speech in (first, second, first):
        np.testing.assert_array_equal(cached_speech_onsets(speech), speech_onsets(speech.waveform))


@pytest.mark.gl
def test_each_file_is_drawn_as_long_as_it_is_and_told_of(tmp_path: Path) -> None:
    name, frames = "trembling", 15
    clean = load_motion(CLEAN).part(slice(frames))
    save_motion(clean, tmp_path / "clean.npz")
    save_motion(add_tremble(clean), tmp_path / f"{name}.npz")
    left = made_waveform(8_000)
    right = np.random.default_rng(0).uniform(-0.5, 0.5, len(left))
    with wave.open(str(tmp_path / "dialogue.wav"), "wb") as wav:
        wav.setparams((2, 2, 16_000, 0, "NONE", ""))
        wav.writeframes((32_000 * np.stack([left, right], axis=1)).astype("<i2").tobytes())
    callbacks = RecordedCallbacks()
    request = diagnose_request(
        motions=(tmp_path / f"{name}.npz",),
        out=tmp_path / "out",
        reference=tmp_path / "clean.npz",
        speech=tmp_path / "dialogue.wav",
        channel=0,
        has_figures=False,
        has_video=True,
        close_ups=(),
        display=Display(has_trail=True),
        picture_height_px=256,
    )
    run(request, callbacks)
    shares = callbacks.shares_of("video")
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0)
    names, told = (name, "reference"), read_run(request.output.out)
    kinds = {"motion", "frames", "plan", "video"}
    assert {each.name: set(each.files) for each in told.rows} == dict.fromkeys(names, kinds)
    assert all((request.output.out / each).is_file() for each in told.all_files)
    videos = [*request.output.out.glob("*.mp4")]
    assert {path.stem for path in videos} == set(names)
    assert all(probe_video(path).num_frames == frames for path in videos)
    heard = load_speech(videos[0]).waveform[: len(left)]
    assert np.corrcoef(heard, left[: len(heard)])[0, 1] > 0.95


@pytest.mark.slow
def test_every_planted_fault_is_found(tmp_path: Path) -> None:
    path, reference, speech, transcript = write_faulty_example(tmp_path)
    request = diagnose_request(
        motions=(Path(path),),
        out=tmp_path / "out",
        reference=Path(reference),
        speech=Path(speech),
        transcript=Path(transcript),
        has_figures=False,
    )
    result = run(request)
    assert result.notes == ()
    findings = result.diagnostics.findings
    found = {finding.kind: finding for finding in findings[FAULTY]}
    assert set(found) == {
        *("frozen", "rotation_noise", "foot_slide", "floating", "period", "jerk"),
    }
    assert (
        abs(found["frozen"].worst_frame - 90.25 * 30) < 5
        and 3000 < found["floating"].worst_frame < 3240
    )
    assert found["rotation_noise"].numbers["noise_deg"].keys() == {
        *("right_shoulder", "right_elbow", "right_wrist"),
    }
    assert findings["reference"] == []


def test_faults_are_planted_in_their_seconds_alone() -> None:
    clean = load_motion(TWO_MINUTES)
    faulty = inject_faults(clean)
    is_changed = (faulty.poses != clean.poses).any(1) | (faulty.trans != clean.trans).any(1)
    assert not is_changed[: 4 * 30].any() and not is_changed[114 * 30 :].any()
    assert is_changed[4 * 30 : 114 * 30].mean() > 0.95, "sliding feet stand for a moment"
    step = np.linalg.norm(np.diff(faulty.trans, axis=0), axis=1).max()
    assert step < 0.05, "only joints jump"


def finding(kind: str) -> Finding:
    return Finding("", {}, kind=kind)


def test_nothing_is_found_of_what_a_file_does_not_tell() -> None:
    found = [finding(fault.kind) for fault in FAULTS]
    kept = {
        each.kind
        for each in drop_findings_on_missing_parts(found, {"hands", "face", "place", "detail"})
    }
    gone = {fault.kind for fault in FAULTS} - kept
    assert {"finger_range", "frozen_hand", "still_face", "still_translation", "jerk"} <= gone
    assert {"frozen", "pops", "amplitude", "hand_in_body", "swapped_sides"} <= kept
    assert drop_findings_on_missing_parts(found, ()) == found
    only = {each.kind for each in drop_findings_on_missing_parts(found, {"finger_angles"})}
    assert {fault.kind for fault in FAULTS} - only == {"finger_range"}


def test_assumptions_are_told_counted_apart_and_overruled(tmp_path: Path) -> None:
    motion = Person(1).motion(24)
    poses, trans = turned(motion, FROM_Y["z"])
    body = poses[:, BODY_JOINTS].reshape(len(poses), -1)
    np.savez(tmp_path / "theirs.npz", poses=body, trans=trans, fps=np.array(30))
    np.savez(tmp_path / "recorded.npz", poses=motion.poses, trans=motion.trans)
    asked = diagnose_request(
        motions=(tmp_path / "theirs.npz",), out=tmp_path / "out", has_figures=False,
        reference=tmp_path / "recorded.npz",
        told=parse_import_overrides("motions:rate=25,reference:units=m"),
    )  # fmt: skip
    said = " ".join(run(asked).notes)
    told = json.loads((asked.output.out / "diagnostics.json").read_text())
    assumed = {
        name: {each["kind"]: (each["value"], each["confidence"]) for each in found}
        for name, found in told["assumptions"].items()
    }
    assert assumed["theirs"]["up"] == ("z", "sure")
    assert assumed["theirs"]["rate"] == ("25", "user")
    assert assumed["reference"]["rate"] == ("30", "unsure")  # of the motions alone
    assert assumed["reference"]["units"] == ("m", "user")
    assert told["missing_parts"] == {"theirs": ["detail", "face", "hands"], "reference": ["face"]}
    kinds = {each["kind"] for each in told["findings"]["theirs"]}
    assert not kinds & {"frozen_hand", "finger_range", "still_face", "jerk", "high_frequency"}
    assert told["notes"][0].startswith("The motions differ in frame rate")
    assert "theirs has no finger motion" in said and "theirs.npz: up axis z" in said


def test_what_nobody_can_say_is_refused_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["diagnose", "none.npz", "--out", str(tmp_path / "out"), "--assume", "up=w"])
    assert left.value.code == 2
    assert "up must be one of y, -y" in capsys.readouterr().err
