"""Sets as people have them: how files are paired, averaged and checked, and how they are packed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.commands.cli import main
from app.errors import RunError
from app.findings.metric_table import SPEED
from app.run.batch.motion_sets import diagnose_folders
from app.run.batch.pairing import pair_files
from app.run.batch.submission_check import check_sets
from app.run.requests.requests import AnyRun
from conventions.names import REFERENCE_NAME
from model.motion.motion import save_motion
from tests.app.requests import diagnose_request
from tests.helpers import csv_rows, smooth_motion_example

NPZ = (".npz",)


def sets(top: Path, **files: tuple[str, ...]) -> dict[str, tuple[Path, tuple[str, ...]]]:
    for name, paths in files.items():
        for path in paths:
            (top / name / path).parent.mkdir(parents=True, exist_ok=True)
            (top / name / path).touch()
    return {name: (top / name, NPZ) for name in files}


def names(found: dict[str, dict[str, dict[str, Path]]], top: Path) -> dict[str, dict[str, list]]:
    return {
        name: {
            clip: [(sample, str(path.relative_to(top / name))) for sample, path in files.items()]
            for clip, files in clips.items()
        }
        for name, clips in found.items()
    }


REFERENCE = ("2_scott_0_1_1.npz", "2_scott_0_2_2.npz")


@pytest.mark.parametrize(
    "form",
    ["{clip}_sample{n}.npz", "x/{clip}_sample_{n}_output.npz", "res_{clip}.s{n}.npz",
     "sample{n}/{clip}.npz", "sample_{n}/a/res_{clip}.npz", "{clip}/{n}.npz",
     "mine/{clip}/sample{n}.npz", "seed-{n}/{clip}.npz"],
)  # fmt: skip
def test_samples_of_a_clip_are_known_by_name_or_folder(form: str, tmp_path: Path):
    ids = [Path(each).stem for each in REFERENCE]
    files = tuple(form.format(clip=clip, n=n) for clip in ids for n in range(3))
    found = pair_files(sets(tmp_path, mine=files, reference=REFERENCE), ("reference",))
    assert names(found, tmp_path) == {
        "mine": {clip: [(str(n), form.format(clip=clip, n=n)) for n in range(3)] for clip in ids},
        "reference": {clip: [("", f"{clip}.npz")] for clip in ids},
    }


def test_folders_tell_clips_apart_where_names_do_not(tmp_path: Path):
    speakers = ("scott/1.npz", "scott/2.npz", "nora/1.npz")
    deep = tuple(f"epoch/{each}" for each in speakers)
    found = pair_files(sets(tmp_path, mine=deep, reference=speakers), ("reference",))
    assert set(found["mine"]) == set(found["reference"]) == {"scott/1", "scott/2", "nora/1"}
    alone = pair_files(sets(tmp_path / "b", mine=("scott/1.npz", "scott/2.npz", "nora/1.npz")))
    assert {clip: list(files) for clip, files in alone["mine"].items()} == {
        "scott": ["1", "2"],
        "nora": ["1"],
    }
    with pytest.raises(
        RunError, match=r"of mine have the same clip name .a.: a\.npz and a_output\.npz"
    ):
        pair_files(sets(tmp_path / "c", mine=("a.npz", "a_output.npz")))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three recorded clips, and a system with two samples of each, one of a quarter more."""
    top = tmp_path_factory.mktemp("samples")
    for name in ("gt", "mine"):
        (top / name).mkdir()
    for seed, clip in enumerate("abc"):
        motion = smooth_motion_example(60, seed)
        save_motion(motion, top / "gt" / f"{clip}.npz")
        for sample, times in ((0, 1.0), (1, 1.25)):
            poses = (times * motion.poses).astype(np.float32)
            save_motion(replace(motion, poses=poses), top / "mine" / f"{clip}_sample{sample}.npz")
    return top


def asked(top: Path, out: Path, *systems: Path) -> AnyRun:
    return diagnose_request(motions=systems or (top / "mine",), out=out, reference=top / "gt")


def rows_of(out: Path) -> dict[tuple[str, str], dict[str, str]]:
    return {(row["clip"], row["system"]): row for row in csv_rows(out / "clips.csv")}


def test_samples_are_averaged_first_and_their_spread_is_told(made: Path, tmp_path: Path):
    found = diagnose_folders(asked(made, tmp_path / "both"))
    assert "mine has 2 samples of each clip; their metrics are averaged." in found.notes
    both = rows_of(tmp_path / "both")
    parts = []
    for sample in (0, 1):
        one = tmp_path / f"one{sample}"
        one.mkdir()
        for clip in "abc":
            name = f"{clip}_sample{sample}.npz"
            (one / f"{clip}.npz").write_bytes((made / "mine" / name).read_bytes())
        diagnose_folders(asked(made, tmp_path / f"out{sample}", one))
        parts.append(rows_of(tmp_path / f"out{sample}"))
    title = "Tracked point: Speed (m/s)"
    for clip in "abc":
        first, second = (
            float(part[clip, f"one{sample}"][SPEED]) for sample, part in enumerate(parts)
        )
        assert float(both[clip, "mine"][SPEED]) == pytest.approx((first + second) / 2)
        assert first != pytest.approx(second, rel=0.1)
    spread = np.mean(
        [
            np.std([float(part[clip, f"one{n}"][SPEED]) for n, part in enumerate(parts)], ddof=1)
            for clip in "abc"
        ]
    )
    sheet = (tmp_path / "both" / "summary.md").read_text().split("Standard deviation between")[1]
    (line,) = (line for line in sheet.splitlines() if title in line)
    assert float(line.split("|")[2]) == pytest.approx(spread, rel=0.01)


def test_a_bad_clip_costs_itself_only(made: Path, tmp_path: Path):
    mine = tmp_path / "mine"
    mine.mkdir()
    for path in (made / "mine").iterdir():
        (mine / path.name).write_bytes(path.read_bytes())
    for broken in ("b_sample0", "b_sample1", "c_sample0"):
        (mine / f"{broken}.npz").write_bytes(b"no motion")
    found = diagnose_folders(asked(made, tmp_path / "out", mine))
    (left_out,) = found.batch_json["left_out"].values()
    assert found.batch_json["clips"] == ["a", "c"] and "b_sample" in left_out
    assert any("c_sample0.npz" in note for note in found.notes)
    rows = rows_of(tmp_path / "out")
    assert rows["b", ""]["left out because"] == left_out
    assert rows["a", "mine"]["left out because"] == ""
    assert left_out in (tmp_path / "out" / "summary.md").read_text()
    for path in mine.iterdir():
        path.write_bytes(b"no motion")
    with pytest.raises(ValueError, match="sample"):
        diagnose_folders(asked(made, tmp_path / "none", mine))


def test_a_set_that_was_filled_in_is_told_above_the_numbers(made: Path, tmp_path: Path):
    slow = tmp_path / "slow"
    slow.mkdir()
    for clip in "abc":
        with np.load(made / "gt" / f"{clip}.npz") as file:
            content = {name: file[name] for name in file.files}
        for name in ("poses", "trans", "expressions"):
            content[name] = content[name][::2]
        np.savez(slow / f"{clip}.npz", **content | {"mocap_frame_rate": np.array(15)})
    found = diagnose_folders(asked(made, tmp_path / "out", slow))
    assert found.notes[0].startswith("slow was upsampled from a lower frame rate")
    sheet = (tmp_path / "out" / "summary.md").read_text()
    table = sheet.index("| measure |")
    assert "slow was upsampled" in sheet[:table] and "15" in sheet[:table]
    (jerk,) = (line for line in sheet.splitlines() if line.startswith("| Tracked point: Jerk"))
    assert jerk.split(" | ")[1] == "n/a" and jerk.split(" | ")[2] != "n/a"
    (speed,) = (line for line in sheet.splitlines() if line.startswith("| Tracked point: Speed"))
    assert "n/a" not in speed


def test_the_command_line_tells_by_its_exit_status(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    mine = tmp_path / "mine"
    mine.mkdir()
    for clip in "ab":
        (mine / f"{clip}.npz").write_bytes((made / "gt" / f"{clip}.npz").read_bytes())
    argv = ["diagnose", str(mine), "--reference", str(made / "gt"), "--processes", "1", "--out"]
    assert main([*argv, str(tmp_path / "whole")]) == 0
    (mine / "b.npz").write_bytes(b"no motion")
    assert main([*argv, str(tmp_path / "out")]) == 1
    said = capsys.readouterr()
    assert "1 of 2 clips could not be measured" in said.err and "summary.md" in said.out
    assert main([*argv, str(tmp_path / "check"), "--check", "genea"]) == 1
    said = capsys.readouterr()
    assert "mine: missing clips (1): c." in said.err and "check.md" in said.out


def test_the_leaderboards_rules_are_told_file_by_file(tmp_path: Path):
    clips = [f"2_scott_0_{n}_{n}" for n in (1, 2, 3)]
    for folder in ("beat2/smplxflame_30", "good", "bad"):
        (tmp_path / folder).mkdir(parents=True)
    lines = ["id,type", *(f"{clip},test" for clip in clips), "2_scott_0_9_9,train"]
    (tmp_path / "beat2" / "train_test_split.csv").write_text("\n".join(lines))
    for seed, clip in enumerate([*clips, "2_scott_0_9_9"]):
        motion = smooth_motion_example(20 + seed, seed)
        save_motion(motion, tmp_path / "beat2" / "smplxflame_30" / f"{clip}.npz")
        for sample in range(5 if clip in clips else 0):
            other = replace(motion, poses=motion.poses + np.float32(0.01 * sample))
            save_motion(other, tmp_path / "good" / f"{clip}_sample_{sample}.npz")
    for sample in range(3):
        save_motion(
            smooth_motion_example(15, 0), tmp_path / "bad" / f"{clips[0]}_sample{sample}.npz"
        )
    np.savez(tmp_path / "bad" / f"{clips[1]}_sample0.npz", poses=np.zeros((21, 165)))
    save_motion(smooth_motion_example(9, 0), tmp_path / "bad" / "2_scott_0_9_9.npz")

    folders = (tmp_path / "good", tmp_path / "bad")
    found = check_sets(folders, tmp_path / "beat2", tmp_path / "out")
    good, bad = found.values()
    assert good.is_valid and not bad.is_valid
    assert good.messages == [
        "good: all 3 clips, with 5 samples each, meet the leaderboard's rules."
    ]
    assert bad.missing_and_extra == [f"Missing: {clips[2]}", "Extra: 2_scott_0_9_9"]
    for words in (
        f"clips with fewer than 3 samples: {clips[1]}",
        "3 samples per clip; a probabilistic system must submit 5",
        f"{clips[0]}_sample0.npz: 15 frames, but the recording has 20",
        f"{clips[0]}_sample2.npz: it is identical to {clips[0]}_sample0.npz",
        f"{clips[1]}_sample0.npz: it lacks trans",
    ):
        assert any(words in line for line in bad.messages), words
    report = (tmp_path / "out" / "check.md").read_text()
    assert all(sentence in report for sentence in (*bad.messages, *bad.missing_and_extra))
    with pytest.raises(RunError, match="give those as well"):
        check_sets(folders, None, tmp_path / "none")
    save_motion(smooth_motion_example(9, 0), tmp_path / "bad" / "2_scott_0_9_9_output.npz")
    with pytest.raises(RunError, match="files of bad have the same clip name"):
        check_sets(folders, tmp_path / "beat2", tmp_path / "twice")
    assert REFERENCE_NAME not in found
