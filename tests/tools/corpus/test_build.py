"""Whole corpora: same seed, same bytes; layout; continuing; and what is refused."""

import errno
import hashlib
import json
import re
import wave
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tools.corpus import __main__ as command
from tools.corpus import build
from tools.corpus.build import CorpusError, build_corpus, plan_jobs
from tools.corpus.people.speaker import SPEAKERS

TWO_CLIPS_H = 2 / 60


def digests(root: Path) -> dict[str, str]:
    files = sorted(p for p in root.rglob("*") if p.is_file())
    return {str(p.relative_to(root)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def corpus(flite: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("corpus") / "one"
    assert build_corpus(root, TWO_CLIPS_H, seed=3, workers=1) == 2
    return root


def test_two_workers_make_the_same_bytes_as_one(corpus: Path, tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    build_corpus(
        tmp_path / "two", TWO_CLIPS_H, 3, 2, lambda done, total: steps.append((done, total))
    )
    assert digests(tmp_path / "two") == digests(corpus)
    assert steps == [(0, 2), (1, 2), (2, 2)]


def test_another_seed_makes_other_clips(corpus: Path, tmp_path: Path) -> None:
    build_corpus(tmp_path / "short", 6 / 3600, seed=3, workers=1)
    build_corpus(tmp_path / "other", 6 / 3600, seed=4, workers=1)
    short, other = (digests(tmp_path / name) for name in ("short", "other"))
    for name in short:
        if name.endswith((".npz", ".wav", ".TextGrid")):
            assert short[name] != other[name]


def test_the_layout_is_beat2s(corpus: Path) -> None:
    table = (corpus / "train_test_split.csv").read_text().splitlines()
    assert table[0] == "id,type"
    rows = [line.split(",") for line in table[1:]]
    assert len(rows) == 2
    for clip_id, split in rows:
        number, name, zero, k, same = clip_id.split("_")
        assert (zero, same) == ("0", k)
        assert {"1": "anna", "2": "ben"}[number] == name
        assert split in ("train", "val", "test")
        with np.load(corpus / "smplxflame_30" / f"{clip_id}.npz", allow_pickle=False) as data:
            motion = {key: data[key] for key in data.files}
        with wave.open(str(corpus / "wave16k" / f"{clip_id}.wav")) as sound:
            assert (sound.getnchannels(), sound.getsampwidth(), sound.getframerate()) == (
                1,
                2,
                16000,
            )
            seconds = sound.getnframes() / 16000
        num_frames = len(motion["poses"])
        assert num_frames == round(30 * seconds)
        assert 45 < seconds < 75
        assert motion["poses"].shape == (num_frames, 165)
        assert motion["trans"].shape == (num_frames, 3)
        assert motion["expressions"].shape == (num_frames, 100)
        assert motion["betas"].shape == (300,)
        assert {str(motion[k].dtype) for k in ("poses", "trans", "expressions")} == {"float32"}
        assert int(motion["mocap_frame_rate"]) == 30
        assert str(motion["expression_basis"]) == "arkit52"
        assert str(motion["gender"]) == "neutral"


def test_a_corpus_clip_loads_as_a_motion(corpus: Path) -> None:
    motion_module = pytest.importorskip("model.motion.motion")
    path = next((corpus / "smplxflame_30").glob("*.npz"))
    motion = motion_module.load_motion(path)
    assert motion.expression_basis == "arkit52"


def tiers(path: Path) -> dict[str, list[tuple[float, float, str]]]:
    """An independent reading of the long TextGrid format."""
    text = path.read_text()
    assert text.startswith('File type = "ooTextFile"\nObject class = "TextGrid"\n')
    found = {}
    for block in re.split(r"\n    item \[\d+\]:\n", text)[1:]:
        name = re.search(r'name = "(\w+)"', block)
        assert name is not None
        if "IntervalTier" in block:
            pattern = r"xmin = ([\d.]+)\n\s+xmax = ([\d.]+)\n\s+text = \"(.*)\""
            rows = [(float(a), float(b), c) for a, b, c in re.findall(pattern, block)]
        else:
            pattern = r"number = ([\d.]+)\n\s+mark = \"(.*)\""
            rows = [(float(a), float(a), c) for a, c in re.findall(pattern, block)]
        size = re.search(r"size = (\d+)", block)
        assert size is not None
        assert int(size.group(1)) == len(rows)
        found[name.group(1)] = rows
    return found


TIERS = (
    "words phones accents gesture_left gesture_right goal_left goal_right apex nods gaze brows"
    " smile blinks weight foot_left foot_right listening"
).split()
INTERVAL_TIERS = (
    "words phones gesture_left gesture_right gaze smile weight foot_left foot_right listening"
).split()


def test_the_textgrids_read_back_whole(corpus: Path) -> None:
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
        assert len([w for *_, w in read["words"] if w]) > 60
        phases = {
            label.split()[0] for side in ("left", "right") for *_, label in read[f"gesture_{side}"]
        }
        assert phases <= {"rest", "preparation", "stroke", "hold", "beat", "retraction"}
        assert {"preparation", "stroke", "beat", "retraction"} <= phases
        apexes = [time for time, *_ in read["apex"]]
        assert apexes == sorted(apexes)
        assert len(apexes) > 15


def test_every_move_of_a_hand_has_a_goal_at_its_end(corpus: Path) -> None:
    for path in (corpus / "textgrid").iterdir():
        read = tiers(path)
        for side in ("left", "right"):
            moves = [
                end
                for _, end, label in read[f"gesture_{side}"]
                if label.split()[0] not in ("rest", "hold")
            ]
            goals = [time for time, *_ in read[f"goal_{side}"]]
            assert goals[0] == 0
            assert set(moves) <= set(goals)
            for *_, mark in read[f"goal_{side}"]:
                out, up, forward = (float(number) for number in mark.split())
                assert -0.1 < out < 0.5
                assert -0.5 < up < 0.4
                assert 0.0 < forward < 0.6


def test_marks_are_numbers_in_their_ranges_and_apexes_name_words(corpus: Path) -> None:
    for path in (corpus / "textgrid").iterdir():
        read = tiers(path)
        words = {text for *_, text in read["words"]}
        accents = [float(mark) for *_, mark in read["accents"]]
        assert len(accents) > 30
        assert 0 < min(accents) <= max(accents) < 2
        assert all(0.2 < float(mark) < 15 for *_, mark in read["nods"])
        assert all(len([float(x) for x in mark.split()]) == 2 for *_, mark in read["gaze"])
        for *_, mark in read["brows"]:
            height, width_s = (float(x) for x in mark.split())
            assert -1 < height < 1
            assert 0.05 < width_s < 1.5
        assert {label for *_, label in read["weight"]} <= {"left", "right", "both"}
        assert {label for *_, label in read["foot_left"]} <= {"planted", ""}
        landed = [mark.split() for *_, mark in read["apex"]]
        assert all(side in ("left", "right") for _, side, *_ in landed)
        named = [parts[2] for parts in landed if len(parts) == 3]
        assert len(named) > 0.9 * len(landed)
        assert set(named) <= words


def test_an_interrupted_run_is_continued_with_the_same_bytes(
    corpus: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = digests(corpus)
    lost = next(iter(sorted((corpus / "textgrid").iterdir())))
    lost.unlink()
    (corpus / "train_test_split.csv").unlink()
    made = []
    make = build.make_job
    monkeypatch.setattr(build, "make_job", lambda job: (made.append(job.clip_id), make(job)))
    build_corpus(corpus, TWO_CLIPS_H, seed=3, workers=1)
    assert made == [lost.stem]
    assert digests(corpus) == before


def test_a_command_that_is_stopped_goes_on_where_it_was(
    corpus: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "stopped"
    given = ["--out", str(out), "--hours", str(TWO_CLIPS_H), "--seed", "3", "--workers", "1"]
    make = build.make_job

    def stop_at_the_second(job: build.ClipJob) -> None:
        if job.index == 1:
            raise KeyboardInterrupt
        make(job)

    monkeypatch.setattr(build, "make_job", stop_at_the_second)
    assert command.main(given) == 1
    assert "the same command continues" in capsys.readouterr().err
    assert not (out / "train_test_split.csv").exists()
    monkeypatch.setattr(build, "make_job", make)
    assert command.main(given) == 0
    assert digests(out) == digests(corpus)


def test_a_folder_of_something_else_is_refused_and_left_alone(corpus: Path, tmp_path: Path) -> None:
    before = digests(corpus)
    with pytest.raises(CorpusError, match=r"seed 3, .*asked for .*seed 4"):
        build_corpus(corpus, TWO_CLIPS_H, seed=4, workers=1)
    assert digests(corpus) == before
    (tmp_path / "holiday.jpg").write_bytes(b"x")
    with pytest.raises(CorpusError, match="is not empty and holds no corpus"):
        build_corpus(tmp_path, TWO_CLIPS_H, seed=3, workers=1)
    assert [p.name for p in tmp_path.iterdir()] == ["holiday.jpg"]


@pytest.mark.parametrize("hours", [0.0, -1.0, float("nan"), float("inf"), 2000.0])
def test_hours_out_of_range_are_refused_before_anything_is_written(
    hours: float, tmp_path: Path
) -> None:
    with pytest.raises(CorpusError, match="--hours must be above 0"):
        build_corpus(tmp_path / "x", hours, seed=1, workers=1)
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(("seed", "workers", "flag"), [(-1, 1, "--seed"), (1, 0, "--workers")])
def test_other_bad_numbers_are_refused(seed: int, workers: int, flag: str, tmp_path: Path) -> None:
    with pytest.raises(CorpusError, match=flag):
        build_corpus(tmp_path / "x", 1.0, seed, workers)


def test_a_full_disk_is_said_and_leaves_no_half_file(
    flite: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "full"
    whole = Path.write_bytes

    def write(path: Path, content: bytes) -> int:
        if ".npz" in path.name:
            whole(path, content[:100])
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        return whole(path, content)

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(CorpusError, match=r"the disk is full; .* takes about 230 MB"):
        build_corpus(root, 6 / 3600, seed=1, workers=1)
    assert not [p for p in root.rglob("*") if ".npz" in p.name]


def test_a_name_that_is_taken_is_said(flite: None, tmp_path: Path) -> None:
    (tmp_path / "taken").write_bytes(b"")
    with pytest.raises(CorpusError, match=r"taken could not be written: a file has that name"):
        build_corpus(tmp_path / "taken", 6 / 3600, seed=1, workers=1)


def test_a_corpus_of_another_format_is_not_continued(corpus: Path, tmp_path: Path) -> None:
    manifest = json.loads((corpus / "corpus.json").read_text())
    manifest["format"] += 1
    (tmp_path / "corpus.json").write_text(json.dumps(manifest))
    with pytest.raises(CorpusError, match=r"format \d+, and this version makes format \d+;"):
        build_corpus(tmp_path, TWO_CLIPS_H, seed=3, workers=1)


def test_an_unreadable_manifest_is_refused(tmp_path: Path, flite: None) -> None:
    (tmp_path / "corpus.json").write_text("{")
    with pytest.raises(CorpusError, match="not readable"):
        build_corpus(tmp_path, TWO_CLIPS_H, seed=3, workers=1)


def test_more_hours_keep_the_clips_there_are() -> None:
    root = Path("anywhere")
    short, long = plan_jobs(root, 0.5, 1), plan_jobs(root, 3.0, 1)
    assert short == long[: len(short)]
    assert len(long) == 180
    assert len({job.clip_id for job in long}) == 180


def test_held_out_speakers_are_only_tested_and_the_others_are_in_every_split() -> None:
    jobs = plan_jobs(Path("anywhere"), 10.0, 1)
    for speaker in SPEAKERS:
        splits = [job.split for job in jobs if job.speaker_number == speaker.number]
        if speaker.held_out:
            assert set(splits) == {"test"}
        else:
            assert 0.75 < splits.count("train") / len(splits) < 0.85
            assert set(splits) == {"train", "val", "test"}


def test_the_command_ends_with_0_1_or_2(
    flite: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "c")
    good = ["--out", out, "--hours", "0.002", "--seed", "1", "--workers", "1"]
    assert command.main(good) == 0
    assert json.loads((tmp_path / "c" / "corpus.json").read_text())["seed"] == 1
    assert command.main([*good[:5], "2"]) == 1
    assert "holds another corpus" in capsys.readouterr().err
    assert command.main(["--out", out, "--hours", "0", "--seed", "1"]) == 1
    with pytest.raises(SystemExit) as stop:
        command.main(["--out", out])
    assert stop.value.code == 2


def test_a_missing_speech_program_fails_with_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert command.main(["--out", str(tmp_path / "c"), "--hours", "1", "--seed", "1"]) == 1
    assert "apt-get install flite" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
