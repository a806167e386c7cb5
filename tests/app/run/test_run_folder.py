"""A run's folder: what is written while a run goes on and when it fails, and what is read of it."""

import json
import zipfile
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.errors import Cancelled, DiskFullError, RunError
from app.findings.metric_table import JERK, TITLES
from app.run.batch.saved_run import LIMITS, copy_run, open_run_folder, reopen_requests
from app.run.callbacks import FolderUpdated, RunCallbacks, RunEvent
from app.run.frame_packets import HEADER
from app.run.output.run_folder import (
    RUN,
    EditInfo,
    FramesAvailable,
    RunRecord,
    existing_file,
    find_runs,
    is_run_zip,
    make_rows,
    noise_group,
    read_run,
    suffix_or_empty,
    zip_run,
)
from app.run.pipeline import make_run_record, run
from app.run.run_writer import finding_records, open_run_writer
from app.run.timeline import read_transcript_of_run
from model.faults.analysis import IMPOSSIBLE, Finding
from model.motion.motion import load_motion, save_motion
from model.plan.annotation_files import Interval
from model.plan.files import read_plan_file
from model.plan.plan import GesturePlan, HandPhase, Nod
from model.speech.audio import load_speech
from model.speech.transcript import Accent, Transcript, Word
from tests.app.fakes import made_motion
from tests.app.requests import diagnose_request
from tests.conftest import MadeOnce
from tests.helpers import smooth_motion_example

NAMES = ("globaldiff/local", "globaldiff/global", "reference")
RECORD: dict[str, Any] = {"format": 1, "kind": "given", "point": "right_middle"}
ROW = {"name": "a", "label": "a", "color": "#000000"}
REST = HandPhase(0.0, 2.0, "rest", (0.2, -0.2, 0.2))
SAID = Transcript(
    (Word(0.2, 0.5, "<b>hello"),),
    {"gesture_left": (Interval(0.3, 0.6, "stroke beat"),)},
    "aligned",
    (Interval(0.2, 0.3, "HH"),),
    (Accent(0.4, 1.5),),
)


def found(at: float) -> dict[str, Any]:
    return {**RECORD, "findings": [{"name": "a", "sentence": "It jumps.", "at": at}]}


def row(**changes: Any) -> dict[str, Any]:
    return {**RECORD, "rows": [{**ROW, **changes}]}


@pytest.mark.parametrize(
    "told",
    [
        b"", b"{}", b"[]", b"null", b"\xff", b"[" * 200_000, b'{"format":' * 5_000,
        json.dumps({**RECORD, "point": "\ud800"}), json.dumps(found(10**400)),
        json.dumps(found(float("nan"))), json.dumps({**RECORD, "format": 5}),
        json.dumps({**RECORD, "html": "<script>"}), json.dumps({**RECORD, "title": "x" * 3_000}),
        json.dumps({**RECORD, "rows": [ROW] * 2}), json.dumps({**RECORD, "rows": [ROW] * 600}),
        json.dumps({**RECORD, "speech_sha256": "../x"}), json.dumps(row(color="red;x")),
        *(
            json.dumps(row(files={"motion": name}))
            for name in ("../a.npz", "/a.npz", "shown/../../a", "shown/", "", "..", "a\0", "b/c")
        ),
        b'{"title": "' + b"x" * 21_000_000 + b'"}',
    ],
    ids=lambda told: "",
)  # fmt: skip
def test_anything_else_is_refused_with_a_sentence(told, tmp_path):
    (tmp_path / RUN).write_bytes(told if isinstance(told, bytes) else told.encode())
    with pytest.raises(RunError, match=r"not a run folder that can be .* \(run\.json is damaged"):
        read_run(tmp_path)


def test_a_record_of_format_1_opens_with_its_request_in_parts(tmp_path):
    asked = {
        "speech": "talk.wav", "motions": [], "systems": ["gan/5"], "seed": 4, "steps": {"gan/5": 2},
        "told": {"says": [["", "up", "z"]]}, "display": {"has_trail": True}, "joint": "left_index",
        "sampler": None, "gone since": 1,
    }  # fmt: skip
    old = {**RECORD, "format": 1, "kind": "generated", "asked": asked}
    (tmp_path / RUN).write_text(json.dumps(old))
    read = read_run(tmp_path)
    assert (read.format, read.kind) == (4, "generated")
    assert read.request["sampling"] == {
        "systems": ["gan/5"], "seed": 4, "steps": {"gan/5": 2}, "sampler": None,
    }  # fmt: skip
    assert (
        read.request["speech"] == {"path": "talk.wav"}
        and read.request["tracked_point"] == "left_index"
    )
    assert read.request["imports"] == {"import_overrides": {"says": [["", "up", "z"]]}}


def test_a_record_of_format_2_opens_with_the_keys_of_its_metrics(tmp_path):
    """As the first example was saved before metrics had keys of their own."""
    old = json.loads((Path(__file__).parent / "kept" / "run_format_2.json").read_text())
    old["settings"] |= {"speech": "usual", "steps": "usual", "strength of the speech": "2"}
    (tmp_path / RUN).write_text(json.dumps(old))
    read = read_run(tmp_path)
    assert read.settings["tracked point"] == "right middle fingertip"
    assert (read.settings["speech"], read.settings["steps"]) == ("usual", "default")
    assert read.settings["speech guidance scale"] == "2"
    assert read.format == 4 and read.metrics.keys() == old["numbers"].keys()
    for name, of in old["numbers"].items():
        for version, values in of.items():
            own = read.metrics[name][version]
            assert list(own.values()) == list(values.values())
            assert own.keys() <= TITLES.keys()
            assert (own[JERK], own["foot_sliding_cm_s"]) == (
                values["Followed point: Jerk"], values["Feet: Slide on the ground"],
            )  # fmt: skip


def test_a_record_of_format_3_opens_under_the_present_keys(tmp_path):
    old = {
        "format": 3, "kind": "given", "point": "right_middle", "sentence": "Done.",
        "whole": "a" * 64, "sound": "speech.wav", "says": {"step": "Less."},
        "verdict": {"numbers": "1", "judgement": "2"},
        "findings": [{"name": "a", "sentence": "It jumps.", "at": 1.5}],
        "rows": [{
            **ROW, "ending": ".bvh",
            "files": {"performed": "a.plan.json", "told": "a.told.json", "windows": "a.state.npz"},
            "there": {"end": 3, "num_frames": 4, "bytes": 5, "place": [0, 1, 2, 3]},
            "take": {"number": 1, "of": "a", "start": "b", "fresh": [[0.5, 1]]},
            "assumed": [{"kind": "up", "value": "z", "reason": "so", "confidence": "sure",
                         "alternatives": []}],
        }],
    }  # fmt: skip
    (tmp_path / RUN).write_text(json.dumps(old))
    read = read_run(tmp_path)
    assert (read.format, read.kind, read.message, read.audio) == (
        4, "imported", "Done.", "speech.wav",
    )  # fmt: skip
    assert read.inputs_stamp == "a" * 64 and read.figure_captions == {"step": "Less."}
    assert read.verdict is not None and read.verdict.comparison == "2"
    assert read.findings[0].worst_time_s == 1.5
    (own,) = read.rows
    assert own.files == {
        "input_plan": "a.plan.json", "editor": "a.told.json", "state": "a.state.npz",
    }  # fmt: skip
    assert own.available == FramesAvailable(
        num_ready=3, num_frames=4, num_bytes=5, root_transform=(0, 1, 2, 3)
    )
    assert own.edit == EditInfo(
        take_number=1, original_row="a", parent_row="b", regenerated_s=[(0.5, 1.0)]
    )
    assert own.assumptions[0]["value"] == "z" and own.source_suffix == ".bvh"


def test_names_are_harmless_and_no_link_leads_out(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    with pytest.raises(RunError, match=r"run\.json is missing"):
        read_run(folder)
    (folder / RUN).write_text(json.dumps(row(name="a\u202e\x1b", files={"motion": "a.npz"})))
    (read,) = read_run(folder).rows
    assert read.name == "a??"
    (tmp_path / "secret").touch()
    assert existing_file(folder, "a.npz") is None and existing_file(folder, None) is None
    (folder / "a.npz").symlink_to(tmp_path / "secret")
    assert existing_file(folder, "a.npz") is None
    assert existing_file(folder, RUN) == folder / RUN


def test_no_run_is_a_link_that_leads_out_and_no_name_is_too_long_for_a_file(tmp_path):
    given, private = tmp_path / "given", tmp_path / "private"
    for folder in (given, private):
        folder.mkdir()
    (private / RUN).write_text(json.dumps(RECORD))
    (given / "b").symlink_to(private)
    assert find_runs(given) == {}
    (given / RUN).symlink_to(private / RUN)
    assert find_runs(given) == {} and find_runs(private) == {"": private}
    (private / RUN).write_text(json.dumps(row(files={"motion": "€" * 90 + ".npz"})))
    with pytest.raises(RunError, match="longer than 255 bytes"):
        read_run(private)


def test_motion_is_there_window_by_window_and_in_the_end_as_the_whole_is(tmp_path):
    events: list[RunEvent] = []
    motion = made_motion(37)
    with open_run_writer(
        tmp_path, RunRecord(**RECORD), RunCallbacks(events.append), is_incremental=True
    ) as run:
        run.declare_rows(NAMES)
        for start, end in pairwise([0, 10, 11, 37]):
            run.append_motion(NAMES[0], motion.part(slice(start, end)), 37)
            told = read_run(tmp_path)
            first, second, _ = told.rows
            path = existing_file(tmp_path, first.files["frames"])
            assert path is not None and first.available is not None and told.state == "running"
            size = path.stat().st_size
            assert (first.available.num_ready, first.available.num_bytes) == (
                end,
                size,
            ) and second.available is None
        assert size == 3 * HEADER.size + 37 * 504
        for video, row in (("first.mp4", NAMES[0]), ("first.side.mp4", "")):
            run.folder.new_path(video).touch()
            run.add_files(run.folder.new_path(video), row=row, kind="video")
        assert run.record.rows[0].files["video"] == "first.mp4"
        run.write_motion(NAMES[0], motion, "first.npz")
        run.write_motion(NAMES[1], motion)
        first, second, _ = read_run(tmp_path).rows
        assert first.available is not None and first.available.num_bytes == size, (
            "it is not written again"
        )
        assert second.available is not None and second.available.num_bytes == HEADER.size + 37 * 504
        assert second.available.root_transform == pytest.approx(first.available.root_transform)
        run.finish("Done.")
    assert (tmp_path / "first.npz").is_file() and read_run(tmp_path).state == "done"
    assert set(events) == {FolderUpdated(tmp_path)}


@pytest.mark.parametrize(
    ("error", "state", "sentence"),
    [(RunError("No room."), "failed", "No room."), (Cancelled(), "cancelled", "")],
)
def test_a_run_that_ends_early_keeps_what_is_whole_only_where_that_was_asked_for(
    tmp_path, error, state, sentence
):
    for is_incremental in (True, False):
        out = tmp_path / str(is_incremental)
        with (
            pytest.raises(type(error)),
            open_run_writer(out, RunRecord(**RECORD), is_incremental=is_incremental) as run,
        ):
            run.declare_rows(["a"])
            run.write_motion("a", made_motion(8), "a.npz")
            run.folder.new_path("half.npz").touch()
            raise error
        assert out.is_dir() == is_incremental
    told = read_run(tmp_path / "True")
    assert (told.state, told.message) == (state, sentence)
    left = {path.name for path in (tmp_path / "True").iterdir()}
    assert left == {RUN, "a.npz", "viewer"} and load_motion(tmp_path / "True/a.npz").num_frames == 8


def test_a_plan_is_shown_as_it_was_performed_and_of_other_motion_as_it_is_found(tmp_path):
    plan = GesturePlan(
        2.0,
        right=(HandPhase(0.5, 1.0, "stroke", (0.2, -0.1, 0.3), "offer", "never"),),
        nods=(Nod(1.25, 6.0),),
    )
    with open_run_writer(tmp_path, RunRecord(**RECORD), is_incremental=True) as run:
        run.declare_rows(NAMES[:2])
        assert run.write_plan(NAMES[0], plan) == plan
        run.detect_plans(dict.fromkeys(NAMES[:2], made_motion(45)))
    shown = [json.loads((tmp_path / each.files["plan"]).read_text()) for each in run.record.rows]
    assert read_plan_file(tmp_path / run.record.rows[0].files["input_plan"]).plan == plan
    assert shown[0]["nods"] == [{"time_s": 1.25, "depth_deg": 6.0}]
    assert shown[1]["duration_s"] == 1.5 and "input_plan" not in run.record.rows[1].files
    assert (shown[1]["right"][0]["start_s"], shown[1]["right"][-1]["end_s"]) == (0.0, 1.5)


def test_the_gravest_findings_come_first_each_with_its_second_and_what_is_usual_once():
    findings = {
        "a": [Finding("It jumps.", {}, "rare", kind="seam", limit_ratio=3.0, worst_frame=45)],
        "b": [
            Finding("A hand is in the chest.", {}, kind="through", severity=IMPOSSIBLE),
            Finding("It trembles.", {}, "rare", kind="noise", limit_ratio=9.0),
        ],
    }
    told = [
        (each.motion_name, each.sentence, each.worst_time_s) for each in finding_records(findings)
    ]
    assert told == [
        ("b", "A hand is in the chest.", None),
        ("a", "It jumps (rare).", 1.5),
        ("b", "It trembles.", None),
    ]


@pytest.mark.parametrize(
    ("kind", "numbers", "part"),
    [
        ("through_floor", {}, "feet"),
        ("still_face", {}, "face"),
        ("frozen_hand", {"side": "left"}, "hands"),
        ("snap", {"joint": "left_index2"}, "hands"),
        ("pops", {"joint": "right_ankle"}, "feet"),
        ("pops", {"joint": "head"}, ""),
        ("jerk", {}, "hands"),
        ("amplitude", {}, ""),
    ],
)
def test_a_finding_says_which_body_part_shows_it(kind, numbers, part):
    (told,) = finding_records({"a": [Finding("It is wrong.", numbers, kind=kind)]})
    assert told.part == part


def test_rows_of_one_noise():
    assert (
        noise_group("a/b") == noise_group("a/c") != noise_group("a/b.s2")
        and noise_group("b") is None
    )


@pytest.fixture(scope="module")
def results(speech: Path, made_once: MadeOnce) -> Path:
    return made_once("run-of-a-plan", partial(make_results, speech)) / "made"


def make_results(speech: Path, folder: Path) -> None:
    """Of a system that performed a plan, and a reference; as `diagnose` leaves its folder."""
    out = folder / "made"
    for number, name in enumerate(("a", "recorded")):
        save_motion(smooth_motion_example(60, number), folder / f"{name}.npz")
    asked = diagnose_request(
        motions=(folder / "a.npz",), out=out, names=("gan/5",), speech=speech,
        reference=folder / "recorded.npz", title="made elsewhere", has_figures=False,
    )  # fmt: skip
    run(asked)
    with open_run_writer(out, read_run(out), is_incremental=True) as writer:
        writer.write_plan("gan/5", GesturePlan(2.0, (REST,), (REST,)))
        writer.write_timeline(json.loads((out / "timeline.json").read_text()), SAID)
        writer.folder.new_path("jitter.png").touch()
        writer.add_files(writer.folder.new_path("jitter.png"))
        writer.finish("Done.")


def test_a_run_from_somewhere_else_is_measured_anew_under_its_names_with_its_words_and_plans(
    results, tmp_path
):
    packed = zip_run(results, tmp_path / "x.zip")
    assert is_run_zip(packed)
    asked = diagnose_request(motions=(packed,), out=tmp_path / "again", has_figures=False)
    anew = reopen_requests(asked, tmp_path / "opened")[""]
    assert anew.motions.names == ("gan/5",)
    assert (
        anew.motions.source_run is not None
        and read_transcript_of_run(anew.motions.source_run) == SAID
    )
    assert anew.speech.path is not None and load_speech(anew.speech.path).num_motion_frames >= 60
    told = make_run_record(anew)
    assert str(tmp_path) not in told.model_dump_json(), "no folder is told"
    old = read_run(results)
    assert (told.title, told.settings) == ("made elsewhere", old.settings)
    assert told.speech_sha256 == old.speech_sha256 != ""
    result = run(anew)
    shown = read_run(tmp_path / "again")
    assert [each.name for each in shown.rows] == ["gan/5", "reference"]
    assert "input_plan" in shown.rows[0].files and shown.message.endswith("again.")
    words = json.loads((tmp_path / "again/timeline.json").read_text())["words"]
    assert words == [[0.2, 0.5, "<b>hello"]] and result.diagnostics.reference is not None
    kept, again = (
        np.load(each / "viewer/gan-5.npz")["poses"] for each in (results, tmp_path / "again")
    )
    np.testing.assert_allclose(again, kept, atol=1e-5)


def test_only_a_zip_of_runs_is_taken_for_one_and_a_run_of_ones_own_is_shown_as_it_is(
    results, tmp_path
):
    def packed(name: str, *files: str) -> Path:
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            for file in files:
                archive.writestr(file, (results / RUN).read_bytes())
        return tmp_path / name

    found = {
        name: is_run_zip(packed(f"{name}.zip", *files))
        for name, files in {
            "flat": ("a.npz", RUN),
            "folder": ("x/a.npz", f"x/{RUN}"),
            "clips": (f"x/{RUN}", f"y/{RUN}"),
            "clips in a folder": (f"z/x/{RUN}", f"z/y/{RUN}"),
            "too many": [f"{number}/{RUN}" for number in range(11)],
            "deep": (f"x/y/z/{RUN}",),
            "other": ("overrun.json", "a.npz"),
        }.items()
    }
    assert [name for name, is_run in found.items() if not is_run] == ["too many", "deep", "other"]
    assert not is_run_zip(tmp_path / "none.zip") and not is_run_zip(results / RUN)
    hollow = diagnose_request(motions=(packed("hollow.zip", RUN),), out=tmp_path / "out")
    with pytest.raises(RunError, match="it has no motion"):
        reopen_requests(hollow, tmp_path / "hollow")
    for number, own in enumerate((results, zip_run(results, tmp_path / "own.zip"))):
        copy = copy_run(own, tmp_path / str(number))
        assert read_run(copy) == read_run(results)
        assert (copy / "viewer/gan-5.frames").is_file() and (copy / "jitter.png").is_file()


def test_of_a_run_s_zip_only_what_its_record_names_is_unpacked(tmp_path: Path) -> None:
    (row,) = make_rows(["a"])
    row.files = {"motion": "a.npz"}
    RunRecord(kind="imported", tracked_point="right_wrist", rows=[row], files=["a.npz"]).write(
        tmp_path / RUN
    )
    for clips in (("",), ("x/", "y/")):
        path = tmp_path / f"{len(clips)}.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for clip in clips:
                archive.write(tmp_path / RUN, clip + RUN)
                archive.writestr(f"{clip}a.npz", b"motion")
                archive.writestr(f"{clip}bomb.npz", bytes(10**6))
                archive.writestr(f"{clip}other/deep/deeper/{RUN}", bytes(10**6))
        into = tmp_path / f"into {len(clips)}"
        open_run_folder(path, into)
        there = {each.relative_to(into).as_posix() for each in into.rglob("*") if each.is_file()}
        assert there == {clip + name for clip in clips for name in (RUN, "a.npz")}
    assert LIMITS.min_free_bytes > 0
    with pytest.raises(DiskFullError):
        open_run_folder(path, tmp_path / "full", limits=replace(LIMITS, min_free_bytes=2**60))


def test_what_a_file_s_name_ends_in_never_makes_a_run_that_cannot_be_read(tmp_path: Path) -> None:
    (row,) = make_rows(["a"])
    for name, ending in (("a.BVH", ".bvh"), ("a.npz-copy_of_a_run", ""), ("a", ""), ("a.b c", "")):
        row.source_suffix = suffix_or_empty(Path(name))
        assert row.source_suffix == ending
        RunRecord(kind="imported", tracked_point="right_wrist", rows=[row]).write(tmp_path / RUN)
        assert read_run(tmp_path).rows[0].source_suffix == ending


def test_rows_that_would_share_their_files_are_refused(tmp_path, weights):
    files = [tmp_path / "a" / "x.npz", tmp_path / "b" / "x.npz", tmp_path / "a-x.npz"]
    for seed, path in enumerate(files):
        path.parent.mkdir(exist_ok=True)
        save_motion(smooth_motion_example(12, seed), path)
    request = diagnose_request(motions=tuple(files), out=tmp_path / "out", has_figures=False)
    with pytest.raises(RunError, match="'a/x' and 'a-x' would both be written as a-x; rename one"):
        run(request)
    assert not request.output.out.exists()
    assert make_rows(["a/x", "b/x", "comparison"])
