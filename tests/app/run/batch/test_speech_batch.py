"""A list or folder of speech: a run each, gone on with after a stop, told together."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from app.commands.cli import main
from app.errors import Cancelled, RunError
from app.findings.comparison import values_by_metric
from app.findings.metric_table import JERK
from app.run import pipeline
from app.run.batch.saved_run import SPEECH_FOLDER, copy_run, run_page_request
from app.run.batch.speech_batch import (
    clip_requests,
    find_speech_files,
    is_speech_folder_or_list,
    run_batch,
)
from app.run.callbacks import NO_CALLBACKS, FolderUpdated, RunCallbacks, RunEvent, StageProgress
from app.run.output.console import ProgressBars
from app.run.output.run_folder import RUN, find_runs, is_run_zip, read_run, zip_run
from app.run.requests.convert import replace_fields
from app.run.requests.requests import GenerateRequest
from model.plan.editing import add_gesture, gestures
from model.plan.files import read_plan_file, write_plan_file
from model.plan.plan import GesturePlan, Nod
from model.sampling.samplers import noise_seed_of_clip
from model.speech.audio import SpeechError, write_wav
from model.storage.files import file_sha256
from model.systems.planned.config import PLANNED
from processes.pool import JobPool
from tests.app.requests import diagnose_request, generate_request
from tests.model.made import made_waveform

HERE = JobPool(1)
QUICK = ("--steps", "1", "--no-video", "--no-figures", "--processes", "1")


@pytest.fixture
def speeches(tmp_path: Path) -> Path:
    folder = tmp_path / "speech"
    folder.mkdir()
    for number, clip in enumerate("abc"):
        write_wav(folder / f"{clip}.wav", made_waveform(16_000, number))
    return folder


def request_of(source: Path, out: Path, weights: Path, **changes) -> GenerateRequest:
    return generate_request(speech=source, out=out, weights=weights, steps=1, **changes)


def test_every_clip_gets_a_run_that_is_kept_and_all_a_table(speeches, weights, tmp_path):
    out = tmp_path / "out"
    told: list[tuple[str, float]] = []
    asked = request_of(speeches, out, weights, has_figures=False)
    runs = run_batch(
        clip_requests(asked), HERE, lambda path, share: told.append((path.name, share))
    )
    assert runs.finished_clips == ("a", "b", "c") and runs.num_reused == 0 and runs.failed == {}
    assert [name for name, _ in told] == ["a", "b", "c"] and told[-1][1] == 1.0
    for clip in runs.finished_clips:
        names = {path.name for path in (out / clip).iterdir()}
        assert {"globaldiff-local.npz", "provenance.json", RUN} <= names
        assert not any(name.endswith(".png") for name in names)
    told_of_all = json.loads((out / "batch.json").read_text())
    assert told_of_all["clips"] == ["a", "b", "c"]
    (verdict,) = runs.notes
    assert (
        "Over 3 clips, " in verdict and "the paper" in verdict and told_of_all["notes"] == [verdict]
    )
    assert "Over 3 clips" in (out / "summary.md").read_text()
    systems = {row["system"] for row in told_of_all["measures"]}
    assert systems == {"globaldiff/local", "globaldiff/global"}
    assert all(row["clips"] <= 3 for row in told_of_all["measures"])
    records = [
        json.loads((out / clip / "provenance.json").read_text()) for clip in runs.finished_clips
    ]
    options = [record["options"] for record in records]
    assert [each["seed"] for each in options] == [0, 0, 0]
    shas = [file_sha256(speeches / f"{clip}.wav") for clip in runs.finished_clips]
    noise_seeds = [each["noise_seed"] for each in options]
    assert noise_seeds == [
        noise_seed_of_clip(0, sha256) for sha256 in shas
    ]  # or all would move alike
    assert [read_run(out / clip).noise_seed for clip in runs.finished_clips] == noise_seeds
    motions = [np.load(out / clip / "globaldiff-local.npz")["poses"] for clip in "ab"]
    assert not np.array_equal(*motions)

    times = {clip: (out / clip / "globaldiff-local.npz").stat().st_mtime_ns for clip in "abc"}
    (out / "a" / RUN).write_text("{")
    (out / "b" / RUN).unlink()
    (out / "b" / f".unfinished-{os.getpid()}-elsewhere").mkdir()  # a number that lives here too
    runs = run_batch(clip_requests(asked), HERE)
    assert runs.num_reused == 1 and runs.finished_clips == ("a", "b", "c")
    after = {clip: (out / clip / "globaldiff-local.npz").stat().st_mtime_ns for clip in "abc"}
    assert not list(out.glob("*/.unfinished*"))
    assert after["c"] == times["c"] and after["a"] > times["a"] and after["b"] > times["b"]
    write_wav(speeches / "c.wav", made_waveform(16_000, 9))
    assert run_batch(clip_requests(asked), HERE).num_reused == 2
    for clip in "ab":
        (speeches / f"{clip}.wav").unlink()
    assert run_batch(clip_requests(asked), HERE).num_reused == 1
    assert run_batch(clip_requests(replace_fields(asked, seed=1)), HERE).num_reused == 0


@pytest.mark.parametrize("pool", [HERE, pytest.param(JobPool(2), marks=pytest.mark.slow)])
def test_a_clip_moves_alike_alone_and_among_others_in_any_order_and_process(
    speeches: Path, weights: Path, tmp_path: Path, pool: JobPool
) -> None:
    def poses(folder: Path) -> np.ndarray:
        with np.load(folder / "globaldiff-local.npz") as motion:
            return motion["poses"]

    def asked(source: Path, out: str) -> GenerateRequest:
        systems = ("globaldiff/local",)
        return request_of(source, tmp_path / out, weights, systems=systems, has_figures=False)

    alone = asked(speeches.with_name("under another name.wav"), "alone")
    alone.speech.path.write_bytes((speeches / "b.wav").read_bytes())
    expected = poses(pipeline.run(alone).out)
    assert run_batch(clip_requests(asked(speeches, "among")), HERE).failed == {}
    listed = tmp_path / "list.txt"
    listed.write_text("speech/c.wav\nspeech/b.wav\n")
    events: list[RunEvent] = []
    in_processes = clip_requests(asked(listed, "processes"))
    assert run_batch(in_processes, pool, callbacks=RunCallbacks(events.append)).failed == {}
    told = [(each.clips_text, each.fraction) for each in events if isinstance(each, StageProgress)]
    assert told[0] == ("2 clips", 0.0) and told[-1] == ("2 clips", 1.0)
    assert {each.folder.parent.name for each in events if isinstance(each, FolderUpdated)} == {
        "b",
        "c",
    }
    events.clear()
    stopped = RunCallbacks(events.append, should_cancel=lambda: len(events) > 0)
    with pytest.raises(Cancelled):
        run_batch(clip_requests(asked(listed, "stopped")), pool, callbacks=stopped)
    for out in ("among", "processes"):
        np.testing.assert_array_equal(poses(tmp_path / out / "b"), expected)
    assert not np.array_equal(poses(tmp_path / "among" / "c"), expected)


def test_clips_that_cannot_be_made_hold_up_no_other(speeches, weights, tmp_path, capsys):
    (speeches / "b.wav").write_bytes(b"no sound at all" * 9)
    out = tmp_path / "out"
    flags = [*QUICK, "--out", str(out), "--weights", str(weights)]
    asked = ["generate", str(speeches), *flags]
    assert main(asked) == 1
    said = capsys.readouterr()
    tables = "batch.csv", "batch.json", "clips.csv", "summary.md", "table.tex"
    assert said.out.split() == [*(str(out / name) for name in ("a", "c", *tables))]
    assert "b: b.wav" in said.err and "1 of 3 clips failed" in said.err
    assert "b.wav" in json.loads((out / "batch.json").read_text())["left_out"]["b"]
    write_wav(speeches / "b.wav", made_waveform(16_000, 1))
    assert main(asked) == 0
    said = capsys.readouterr()
    assert said.out.split()[0] == str(out / "b")
    assert "2 clips had already been generated; the results were reused." in said.err


def test_the_page_gets_the_same_folder_and_measures_it_anew_from_its_zip(
    speeches, weights, tmp_path
):
    (speeches / "c.wav").unlink()
    speeches = speeches.rename(tmp_path / SPEECH_FOLDER)
    (speeches / "b.wav").write_bytes(b"no sound at all" * 9)
    asked = request_of(
        *(speeches, tmp_path / "1", weights),
        systems=("globaldiff/local",), has_figures=False, is_incremental=True,
    )  # fmt: skip
    elsewhere = tmp_path / "list.txt"
    elsewhere.write_text(f"{speeches / 'a.wav'}\n")
    for speech in (elsewhere, tmp_path):
        with pytest.raises(SpeechError):  # whoever's files it names
            run_page_request(replace_fields(asked, speech=speech, out=tmp_path / "0"), NO_CALLBACKS)
    with pytest.raises(SpeechError, match=r"b\.wav"):
        run_page_request(asked, NO_CALLBACKS)
    write_wav(speeches / "b.wav", made_waveform(16_000, 1))
    with pytest.raises(
        RunError, match=r"last 0\.0\d? minutes in total; the limit of a run is 0\.02"
    ):
        run_page_request(replace_fields(asked, max_speech_s=1.2), NO_CALLBACKS)
    with pytest.raises(Cancelled):
        run_page_request(asked, RunCallbacks(should_cancel=lambda: True))
    events: list[RunEvent] = []
    run_page_request(asked, RunCallbacks(events.append))
    motion = [each for each in events if isinstance(each, StageProgress) and each.stage == "motion"]
    assert {each.clips_text for each in motion} == {"2 clips"}
    assert [each.fraction for each in motion] == pytest.approx([0.5, 1.0])
    runs = find_runs(asked.output.out)
    assert [read_run(run).settings["speech"] for run in runs.values()] == list(runs) == list("ab")
    run_batch(clip_requests(replace_fields(asked, out=tmp_path / "2", is_incremental=False)), HERE)
    with np.load(tmp_path / "2/b/globaldiff-local.npz") as elsewhere:
        here = np.load(asked.output.out / "b/globaldiff-local.npz")
        np.testing.assert_array_equal(here["poses"], elsewhere["poses"])

    packed = zip_run(asked.output.out, tmp_path / "all.zip")
    assert is_run_zip(packed)
    (tmp_path / "anew").mkdir()
    again = diagnose_request(
        motions=(packed,), out=tmp_path / "anew/results", has_figures=False, is_incremental=True
    )
    run_page_request(again, NO_CALLBACKS)
    measured = [
        values_by_metric(
            {name: of["raw"] for name, of in read_run(run).metrics.items()}
            for run in find_runs(out).values()
        )[JERK]
        for out in (asked.output.out, again.output.out)
    ]
    for name, clips in measured[0].items():
        assert measured[1][name] == pytest.approx(clips, rel=1e-3)
    copy = copy_run(packed, tmp_path / "copy")
    assert list(find_runs(copy)) == list("ab") and (copy / "summary.md").is_file()
    former = {"batch.csv": "many.csv", "batch.json": "many.json", "summary.md": "sheet.md"}
    for name, old in former.items():
        (copy / name).rename(copy / old)
    for run in find_runs(copy).values():
        (run / "viewer").rename(run / "shown")
        record = (run / RUN).read_text("utf-8").replace('"viewer/', '"shown/')
        (run / RUN).write_text(record, "utf-8")
    old = copy_run(zip_run(copy, tmp_path / "old.zip"), tmp_path / "old")
    assert {path.relative_to(copy) for path in copy.rglob("*") if path.is_file()} == {
        path.relative_to(old) for path in old.rglob("*") if path.is_file()
    }


def test_a_person_who_stops_it_is_told_that_it_goes_on(
    speeches, weights, tmp_path, capsys, monkeypatch
):
    def press_control_c(bars: ProgressBars, title: str, share: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBars, "update", press_control_c)
    flags = [*QUICK, "--out", str(tmp_path / "out"), "--weights", str(weights)]
    asked = ["generate", str(speeches), *flags]
    assert main(asked) == 1
    assert capsys.readouterr().err == (
        "Interrupted. Finished clips are kept; run the same command again to continue.\n"
    )
    assert (tmp_path / "out" / "a" / RUN).is_file()


def test_a_list_names_files_relative_to_itself_or_is_refused(speeches, tmp_path):
    listed = tmp_path / "list.txt"
    listed.write_text("# two of them\nspeech/c.wav\n\nspeech/a.wav\n")
    assert (
        is_speech_folder_or_list(listed)
        and is_speech_folder_or_list(speeches)
        and not is_speech_folder_or_list(speeches / "a.wav")
    )
    found = find_speech_files(listed)
    assert list(found) == ["c", "a"] and all(path.is_absolute() for path in found.values())
    assert list(find_speech_files(speeches)) == ["a", "b", "c"]
    for content, words in (
        ("# nothing\n", "lists no audio files"),
        ("speech/a.wav\nspeech/z.wav\n", "lists a file that does not exist: .*z.wav"),
        ("speech/a.wav\nspeech/../speech/a.wav\n", "have the same clip name 'a'"),
    ):
        listed.write_text(content)
        with pytest.raises(RunError, match=words):
            find_speech_files(listed)
    os.makedirs(tmp_path / "empty")
    with pytest.raises(RunError, match="contains no audio files"):
        find_speech_files(tmp_path / "empty")


def test_results_stay_in_their_folder_and_hidden_files_are_no_clips(speeches, weights, tmp_path):
    whole = (speeches / "a.wav").read_bytes()
    (speeches / "._a.wav").write_bytes(b"a resource fork of macOS")
    for name in (".wav", "..wav", "...wav"):
        (speeches / name).write_bytes(whole)
    (speeches / "folder.wav").mkdir()
    assert list(find_speech_files(speeches)) == ["a", "b", "c"]
    listed, out = tmp_path / "list.txt", tmp_path / "out"
    listed.write_text("speech/...wav\n")  # whoever names it means it
    runs = run_batch(clip_requests(request_of(listed, out, weights, has_figures=False)), HERE)
    assert runs.finished_clips == ("_",) and (out / "_" / RUN).is_file()
    assert not (tmp_path / RUN).exists() and not (out / RUN).exists()


def test_what_belongs_to_one_clip_is_refused(speeches: Path, weights: Path, tmp_path: Path) -> None:
    asked = request_of(speeches, tmp_path / "out", weights, reference=tmp_path / "a.npz")
    with pytest.raises(RunError, match="belongs to a single recording"):
        run_batch(clip_requests(asked), HERE)
    assert not (tmp_path / "out").exists()


def test_a_batch_takes_one_style_file_and_a_folder_of_plans(speeches, planned_weights, tmp_path):
    for name in "bc":
        (speeches / f"{name}.wav").unlink()
    write_wav(speeches / "d.wav", made_waveform(16_000 * 4))
    style, plans = tmp_path / "style.toml", tmp_path / "plans"
    style.write_text("[times]\ngestures_per_min = 0\nsmile = 0\n")
    plans.mkdir()
    asked = generate_request(
        speech=speeches, out=tmp_path / "out", weights=planned_weights, systems=(PLANNED,), steps=1,
        has_figures=False, style=style, plan=plans,
    )  # fmt: skip
    with pytest.raises(RunError, match="plans has no plan for 2 clips: a"):
        run_batch(clip_requests(asked), HERE)
    with pytest.raises(
        RunError, match="is not a folder; for several speeches, give a folder of plans"
    ):
        run_batch(clip_requests(replace_fields(asked, plan=style)), HERE)
    write_plan_file(GesturePlan(1.0, nods=(Nod(0.5, 4.0),)), plans / "a.json")
    busy = add_gesture(GesturePlan(4.0, nods=(Nod(1.5, 4.0),)), "offer", 2.0, "right").plan
    write_plan_file(busy, plans / "d.TextGrid")
    runs = run_batch(clip_requests(asked), HERE)
    assert runs.failed == {} and runs.finished_clips == ("a", "d")
    performed = [
        read_plan_file(asked.output.out / clip / "workbench-planned.plan.json").plan
        for clip in "ad"
    ]
    assert [plan.nods[0].time_s for plan in performed] == [0.5, 1.5]
    assert not gestures(performed[1], "right")

    assert run_batch(clip_requests(asked), HERE).num_reused == 2
    style.write_text("[times]\nsmile = 0\n")  # another style makes other motion
    assert run_batch(clip_requests(asked), HERE).num_reused == 0
    (left,) = asked.output.out.glob("d/*.plan.json")
    assert len(gestures(read_plan_file(left).plan, "right")) == 1
