"""Whole corpora: same seed, same bytes; layout; continuing; and what is refused."""

import hashlib
import json
import runpy
import shutil
import wave
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from model.motion.motion import load_motion
from model.plan.annotation_files import parse_textgrid
from tests.tools.corpus.conftest import CLIP_S, TWO_CLIPS_H
from tools.corpus import build
from tools.corpus.build import CorpusError, build_corpus, plan_jobs
from tools.corpus.people.speaker import SPEAKERS


@pytest.fixture(autouse=True)
def _clips_of_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "CLIP_S", CLIP_S)


def digests(root: Path) -> dict[str, str]:
    files = sorted(p for p in root.rglob("*") if p.is_file())
    return {str(p.relative_to(root)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.mark.slow
def test_two_workers_make_the_same_bytes_as_one(corpus, tmp_path):
    build_corpus(tmp_path / "two", TWO_CLIPS_H, 3, 2)
    assert digests(tmp_path / "two") == digests(corpus)


def test_the_layout_is_beat2s(corpus):
    table = (corpus / "train_test_split.csv").read_text().splitlines()
    assert table == ["id,type", "1_anna_0_0_0,train", "2_ben_0_1_1,train"]
    for clip_id in ("1_anna_0_0_0", "2_ben_0_1_1"):
        motion = load_motion(corpus / "smplxflame_30" / f"{clip_id}.npz")
        with wave.open(str(corpus / "wave16k" / f"{clip_id}.wav")) as sound:
            assert (sound.getnchannels(), sound.getsampwidth()) == (1, 2)
            assert sound.getframerate() == 16000
            seconds = sound.getnframes() / 16000
        assert len(motion.poses) == round(30 * seconds)
        assert 0.5 * CLIP_S < seconds < 2 * CLIP_S
        assert motion.expression_basis == "arkit52"
        with np.load(corpus / "smplxflame_30" / f"{clip_id}.npz", allow_pickle=False) as data:
            assert data["expressions"].shape[1:] == (100,) and data["betas"].shape == (300,)
            assert int(data["mocap_frame_rate"]) == 30 and str(data["gender"]) == "neutral"


def tiers(path: Path) -> dict[str, list[tuple[float, float, str]]]:
    found, _ = parse_textgrid(path.read_text(), path.name, ValueError)
    return {each.name: [(r.start_s, r.end_s, r.text) for r in each.rows] for each in found}


TIERS = (
    "words phones accents gesture_left gesture_right goal_left goal_right apex nods gaze brows"
    " smile blinks weight foot_left foot_right listening"
).split()
INTERVAL_TIERS = (
    "words phones gesture_left gesture_right gaze smile weight foot_left foot_right listening"
).split()


def test_the_textgrids_read_back_whole_and_agree_with_themselves(corpus):
    for path in (corpus / "textgrid").iterdir():
        read = tiers(path)
        assert list(read) == TIERS
        with wave.open(str(corpus / "wave16k" / f"{path.stem}.wav")) as sound:
            seconds = sound.getnframes() / 16000
        for name in INTERVAL_TIERS:
            rows = read[name]
            assert rows[0][0] == 0
            assert abs(rows[-1][1] - seconds) < 1e-3
            assert all(a[1] == b[0] for a, b in pairwise(rows))
            assert all(a < b for a, b, _ in rows)
        words = {text for *_, text in read["words"]}
        assert len(words) > 6
        for side in ("left", "right"):
            phases = [label.split()[0] for *_, label in read[f"gesture_{side}"]]
            assert {*phases} <= {"rest", "preparation", "stroke", "hold", "beat", "retraction"}
            ends = zip(phases, read[f"gesture_{side}"], strict=True)
            moves = {end for phase, (_, end, _) in ends if phase not in ("rest", "hold")}
            goals = [time for time, *_ in read[f"goal_{side}"]]
            assert goals[0] == 0 and moves <= set(goals)
            for *_, mark in read[f"goal_{side}"]:
                out, up, forward = (float(number) for number in mark.split())
                assert -0.1 < out < 0.5 and -0.5 < up < 0.4 and 0.0 < forward < 0.6
        apexes = [time for time, *_ in read["apex"]]
        assert apexes == sorted(apexes) and len(apexes) > 2
        accents = [float(mark) for *_, mark in read["accents"]]
        assert 0 < min(accents) <= max(accents) < 2
        assert all(0.2 < float(mark) < 15 for *_, mark in read["nods"])
        assert all(len([float(x) for x in mark.split()]) == 2 for *_, mark in read["gaze"])
        for *_, mark in read["brows"]:
            height, width_s = (float(x) for x in mark.split())
            assert -1 < height < 1 and 0.05 < width_s < 1.5
        assert {label for *_, label in read["weight"]} <= {"left", "right", "both"}
        assert {label for *_, label in read["foot_left"]} <= {"planted", ""}
        landed = [mark.split() for *_, mark in read["apex"]]
        assert all(side in ("left", "right") for _, side, *_ in landed)
        assert {parts[2] for parts in landed if len(parts) == 3} <= words


def test_a_command_that_is_stopped_goes_on_where_it_was(corpus, tmp_path, monkeypatch, capsys):
    out = tmp_path / "stopped"
    shutil.copytree(corpus, out)
    lost = sorted((out / "textgrid").iterdir())[1]
    lost.unlink()
    (out / "train_test_split.csv").unlink()
    given = ["--out", str(out), "--hours", str(TWO_CLIPS_H), "--seed", "3", "--workers", "1"]
    make, made = build.make_job, []

    def stop(job: build.ClipJob) -> None:
        made.append(job.clip_id)
        raise KeyboardInterrupt

    monkeypatch.setattr(build, "make_job", stop)
    assert build.main(given) == 1
    assert "the same command continues" in capsys.readouterr().err
    assert made == [lost.stem] and not (out / "train_test_split.csv").exists()
    monkeypatch.setattr(build, "make_job", make)
    assert build.main(given) == 0
    assert digests(out) == digests(corpus)


def test_a_folder_of_something_else_is_refused_and_left_alone(corpus, tmp_path):
    before = digests(corpus)
    with pytest.raises(CorpusError, match=r"seed 3, .*requested: .*seed 4"):
        build_corpus(corpus, TWO_CLIPS_H, seed=4, workers=1)
    assert digests(corpus) == before
    (tmp_path / "holiday.jpg").write_bytes(b"x")
    with pytest.raises(CorpusError, match="is not empty and holds no corpus"):
        build_corpus(tmp_path, TWO_CLIPS_H, seed=3, workers=1)
    assert [p.name for p in tmp_path.iterdir()] == ["holiday.jpg"]


@pytest.mark.parametrize(
    ("hours", "seed", "workers", "words"),
    [
        *((hours, 1, 1, "--hours must be above 0") for hours in (0.0, float("nan"), 2000.0)),
        (1.0, -1, 1, "--seed"),
        (1.0, 1, 0, "--workers"),
    ],
)
def test_bad_numbers_are_refused_before_anything_is_written(hours, seed, workers, words, tmp_path):
    with pytest.raises(CorpusError, match=words):
        build_corpus(tmp_path / "x", hours, seed, workers)
    assert not (tmp_path / "x").exists()


def test_what_cannot_be_continued_is_said(corpus, tmp_path):
    (tmp_path / "taken").write_bytes(b"")
    with pytest.raises(CorpusError, match=r"taken could not be written: a file has that name"):
        build_corpus(tmp_path / "taken", 6 / 3600, seed=1, workers=1)
    (tmp_path / "taken").unlink()
    manifest = json.loads((corpus / "corpus.json").read_text())
    manifest["format"] += 1
    for content, words in (
        (json.dumps(manifest), r"format \d+, and this version makes format \d+;"),
        ("{", "not readable"),
    ):
        (tmp_path / "corpus.json").write_text(content)
        with pytest.raises(CorpusError, match=words):
            build_corpus(tmp_path, TWO_CLIPS_H, seed=3, workers=1)


def test_more_hours_keep_the_clips_there_are():
    root = Path("anywhere")
    short, long = plan_jobs(root, 0.1, 1), plan_jobs(root, 0.4, 1)
    assert short == long[: len(short)]
    assert len(long) == 180
    assert len({job.clip_id for job in long}) == 180


def test_held_out_speakers_are_only_tested_and_the_others_are_in_every_split():
    jobs = plan_jobs(Path("anywhere"), 10.0, 1)
    for speaker in SPEAKERS:
        splits = [job.split for job in jobs if job.speaker == speaker]
        if speaker.held_out:
            assert set(splits) == {"test"}
        else:
            assert 0.75 < splits.count("train") / len(splits) < 0.85
            assert set(splits) == {"train", "val", "test"}


@pytest.mark.parametrize("command", ["tools.corpus", "model.corpus"])
def test_the_documented_command_and_its_former_name_build_the_corpus(command, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [command, "--out", "x", "--seed", "1", "--hours", "-1"])
    with pytest.raises(SystemExit, match="1"):
        runpy.run_module(command, run_name="__main__")
    told = capsys.readouterr().err
    assert "--hours must be above 0" in told
    assert ("is now python -m tools.corpus" in told) == (command == "model.corpus")


def test_a_missing_speech_program_fails_with_a_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert build.main(["--out", str(tmp_path / "c"), "--hours", "1", "--seed", "1"]) == 1
    assert "apt-get install flite" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
