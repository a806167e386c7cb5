"""Folders of clips: paired by name, told with intervals, and gone on with after a stop."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import RunError
from app.findings.metric_table import FGD, METRICS, SPEED
from app.run.batch.motion_sets import diagnose_folders
from app.run.batch.table import (
    MIN_CLIPS_FOR_DISTRIBUTION,
    draw_distribution_figure,
    format_cells,
    mean_with_interval,
)
from app.run.pipeline import run
from app.run.requests.convert import replace_fields
from app.run.requests.requests import AnyRun
from conventions.names import REFERENCE_NAME
from conventions.rates import SAMPLE_RATE
from model.evaluation.frechet import Features, frechet_with_interval, motion_features
from model.formats.read import read_any_motion
from model.motion.motion import save_motion
from model.networks.autoencoder import load_motion_encoder
from model.speech.audio import write_wav
from model.storage.cards import BUNDLED_WEIGHTS
from tests.app.requests import diagnose_request
from tests.helpers import csv_rows, smooth_motion_example

CLIPS = ("a", "b", "c")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A system of twice the reference's amplitude, one that is the reference, and the reference."""
    top = tmp_path_factory.mktemp("many")
    for name in ("lively", "same", "gt"):
        (top / name).mkdir()
    for seed, clip in enumerate(CLIPS):
        motion = smooth_motion_example(90, seed)
        save_motion(motion, top / "gt" / f"{clip}.npz")
        save_motion(motion, top / "same" / f"{clip}.npz")
        lively = replace(motion, poses=(2 * motion.poses).astype(np.float32))
        save_motion(lively, top / "lively" / f"{clip}.npz")
    save_motion(smooth_motion_example(90, 9), top / "lively" / "alone.npz")
    return top


def asked(folders: Path, out: Path) -> AnyRun:
    motions = (folders / "lively", folders / "same")
    return diagnose_request(motions=motions, out=out, reference=folders / "gt")


@pytest.fixture(scope="module")
def measured(folders: Path) -> Path:
    shares: list[float] = []
    result = diagnose_folders(asked(folders, folders / "measured"), shares.append)
    assert tuple(result.batch_json["clips"]) == CLIPS and shares[-1] == 1.0
    assert any("1 of 4 clips are missing from another set" in note for note in result.notes)
    return folders / "measured"


def test_clips_are_paired_told_and_kept(folders: Path, measured: Path, tmp_path: Path):
    shutil.copytree(measured, tmp_path, dirs_exist_ok=True)
    rows = csv_rows(tmp_path / "batch.csv")
    speed = [row for row in rows if row["measure"] == SPEED]
    means = {row["system"]: float(row["mean"]) for row in speed if row["mean"]}
    assert means["lively"] > 1.5 * means["reference"]
    assert means["same"] == pytest.approx(means["reference"])
    (apart,) = (r for r in speed if (r["system"], r["difference_to"]) == ("lively", "reference"))
    assert float(apart["difference_low"]) > 0
    assert float(apart["difference"]) == pytest.approx(means["lively"] - means["reference"])
    sheet = (tmp_path / "summary.md").read_text()
    assert "# 3 clips" in sheet and "| copy of the reference | 0 | 3 | 0 |" in sheet
    by_clip = csv_rows(tmp_path / "clips.csv")
    assert [row["clip"] for row in by_clip] == [*CLIPS] * 3
    (protocols,) = {row["protocols"] for row in by_clip}
    assert protocols.startswith("workbench/1; ") and "l1_diversity_m l1div/emage" in protocols
    assert "beat_align beats/workbench;" in protocols
    assert all("this program's own, workbench/1" in (tmp_path / name).read_text()
               for name in ("summary.md", "table.tex"))  # fmt: skip
    of_lively = [row for row in by_clip if row["system"] == "lively"]
    mean = np.mean([float(row[SPEED]) for row in of_lively])
    assert mean == pytest.approx(means["lively"])
    worst = sheet.split("Clips with the most kinds of findings")[1].splitlines()[4:]
    assert [line.split(" | ")[0] for line in worst[-3:]] == ["| same"] * 3  # and not the reference
    order = [
        (-len(findings.split(", ")), -float(jerk.rstrip(" |")))
        for _, _, findings, jerk in (line.split(" | ") for line in worst[-3:])
    ]
    assert order == sorted(order) and all("copy of the reference" in line for line in worst[-3:])
    paper = (tmp_path / "table.tex").read_text()
    assert paper.count("\\\\\n") == 1 + len({row["measure"] for row in rows})
    assert "starred only with 10 clips or more" in paper and "{*}" not in paper
    measures = json.loads((tmp_path / "batch.json").read_text())["measures"]
    of_ten = format_cells(
        ["lively", "same", "reference"], [{**row, "clips": 10} for row in measures]
    )
    assert of_ten["Tracked point: Speed (m/s)"][0].endswith("*")
    kept = tmp_path / "clips" / "b.json"
    before = kept.stat().st_mtime_ns
    (tmp_path / "clips" / "c.json").write_text("{")  # half a file of a run that was stopped
    again = diagnose_folders(asked(folders, tmp_path))
    assert any("2 clips had already been measured" in note for note in again.notes)
    assert kept.stat().st_mtime_ns == before
    assert json.loads((tmp_path / "clips" / "c.json").read_text())["frames"] == 90


def test_the_distance_of_sets_is_that_of_all_their_codes(folders: Path, measured: Path):
    rows = [row for row in csv_rows(measured / "batch.csv") if row["measure"] == FGD]
    encoder = load_motion_encoder(BUNDLED_WEIGHTS, "fgd-encoder")

    def codes(name: str) -> list[Features]:
        paths = [folders / name / f"{clip}.npz" for clip in CLIPS]
        found = [motion_features(encoder, read_any_motion(path).motion) for path in paths]
        return [features for features in found if features is not None]

    wanted = frechet_with_interval(codes("gt"), codes("lively"))
    (lively, same), (apart,) = (
        [row for row in rows if bool(row["difference_to"]) == is_pair] for is_pair in (False, True)
    )
    found = [float(lively[name]) for name in ("mean", "low", "high")]
    assert found == pytest.approx([wanted.mean, wanted.low, wanted.high], rel=1e-6)
    assert lively["system"] == "lively" and float(same["mean"]) == pytest.approx(0, abs=1e-6)
    assert (apart["system"], apart["difference_to"]) == ("lively", "same")
    assert float(apart["difference"]) == pytest.approx(wanted.mean, rel=1e-6)
    assert "FGD to the recorded set" in (measured / "summary.md").read_text()


def test_beats_are_those_of_a_single_clip_beside_its_sound(folders: Path, tmp_path: Path):
    (tmp_path / "sound").mkdir()
    for clip, seed in zip(CLIPS[:2], (1, 2), strict=True):
        rng = np.random.default_rng(seed)
        sound = rng.normal(size=6 * SAMPLE_RATE) * (np.arange(6 * SAMPLE_RATE) % 9000 < 2000)
        write_wav(tmp_path / "sound" / f"{clip}.wav", 0.1 * sound.astype(np.float32))
    long = {name: tmp_path / name for name in ("lively", "gt")}
    for name, folder in long.items():
        folder.mkdir()
        for seed, clip in enumerate(CLIPS):
            motion = smooth_motion_example(180, seed + (50 if name == "gt" else 0))
            save_motion(motion, folder / f"{clip}.npz")
    request = diagnose_request(
        motions=(long["lively"],),
        out=tmp_path / "out",
        reference=long["gt"],
        speech=tmp_path / "sound",
    )
    result = diagnose_folders(request)
    assert "1 of 3 clips have no audio file of the same name." in result.notes
    by_clip = csv_rows(tmp_path / "out" / "clips.csv")
    rows = {(row["clip"], row["system"]): row for row in by_clip}
    for clip in CLIPS[:1]:
        alone = run(
            diagnose_request(
                motions=(long["lively"] / f"{clip}.npz",),
                out=tmp_path / f"alone-{clip}",
                reference=long["gt"] / f"{clip}.npz",
                speech=tmp_path / "sound" / f"{clip}.wav",
                has_figures=False,
            )
        ).diagnostics
        for name, versions in (("lively", alone.systems[clip]), ("reference", alone.reference)):
            row = rows[clip, name]
            assert versions is not None and versions.raw.beats is not None
            told = float(row["beat_align"])
            assert told == pytest.approx(versions.raw.beats.beat_align, rel=1e-12) and told > 0
            chance = float(row["beat_align_chance"])
            assert chance == pytest.approx(versions.raw.beats.beat_align_chance, rel=1e-12)
        found = {finding.kind for finding in alone.findings[clip]}
        assert found == set(filter(None, rows[clip, "lively"]["findings"].split("; ")))
    assert rows["c", "lively"]["beat_align"] == ""
    with pytest.raises(RunError, match="not a folder"):
        diagnose_folders(replace_fields(request, speech=tmp_path / "sound" / "a.wav"))
    with pytest.raises(RunError, match="--speech"):
        diagnose_folders(replace_fields(request, speech=None, mean_speeds=tmp_path / "speeds.npy"))


def test_sets_too_short_for_a_distance_are_told_and_without_a_common_name_refused(
    folders, tmp_path
):
    for name in ("lively", "same", "gt"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.npz").write_bytes((folders / name / "a.npz").read_bytes())
    result = diagnose_folders(asked(tmp_path, tmp_path / "out"))
    assert any("have 11 feature vectors" in note and "at least 33" in note for note in result.notes)
    assert "FGD" not in (tmp_path / "out" / "summary.md").read_text()
    (tmp_path / "other").mkdir()
    with pytest.raises(RunError, match="paired by file name"):
        diagnose_folders(
            diagnose_request(motions=(folders / "gt", tmp_path / "other"), out=tmp_path / "x")
        )
    with pytest.raises(RunError, match="is not a folder"):
        diagnose_folders(
            diagnose_request(motions=(folders / "gt", tmp_path / "none"), out=tmp_path / "x")
        )


def test_results_as_others_name_them_are_paired_at_any_depth(folders, measured, tmp_path):
    """As EMAGE's code leaves them: results and recordings in one folder, below other folders."""
    theirs = tmp_path / "emage" / "epoch_400"
    (theirs / ".cache").mkdir(parents=True)
    for clip in CLIPS[:2]:
        lively = (folders / "lively" / f"{clip}.npz").read_bytes()
        (theirs / f"res_{clip}{'_output' * (clip == 'b')}.npz").write_bytes(lively)
        (theirs / f"gt_{clip}.npz").write_bytes((folders / "gt" / f"{clip}.npz").read_bytes())
    (theirs / ".cache" / "res_c.npz").write_bytes(b"no motion")
    top, out = tmp_path / "emage", tmp_path / "out"
    result = diagnose_folders(diagnose_request(motions=(top,), out=out, reference=top))
    assert tuple(result.batch_json["clips"]) == CLIPS[:2]
    told = json.loads((out / "batch.json").read_text())["measures"]
    assert {row["system"] for row in told} == {"emage", "reference"}
    for clip in CLIPS[:2]:
        deep, flat = (
            json.loads((place / "clips" / f"{clip}.json").read_text())["systems"]
            for place in (out, measured)
        )
        assert (deep["emage"], deep["reference"]) == (flat["lively"], flat["reference"])
    (theirs / "again").mkdir()
    (theirs / "again" / "res_a.npz").write_bytes((theirs / "res_a.npz").read_bytes())
    result = diagnose_folders(diagnose_request(motions=(top,), out=tmp_path / "two", reference=top))
    assert result.batch_json["clips"] == ["epoch_400/a", "epoch_400/b"]


def test_an_interval_holds_the_mean():
    mean, low, high = mean_with_interval([1.0, 2.0, 3.0, 4.0])
    assert mean == 2.5 and 1.0 <= low < mean < high <= 4.0
    assert mean_with_interval([2.0]) == (2.0, 2.0, 2.0)


def numbers(clips: int, systems: list[str]) -> list[dict]:
    told = [row.key for row in METRICS if not row.group.startswith("Beat")]
    return [
        {"systems": {name: {"numbers": dict.fromkeys(told, 1.0 + k)} for name in systems}}
        for k in range(clips)
    ]


def test_few_clips_have_no_figure(tmp_path: Path):
    systems = ["a", REFERENCE_NAME]
    assert draw_distribution_figure(
        tmp_path, systems, numbers(MIN_CLIPS_FOR_DISTRIBUTION - 1, systems)
    ) == (
        (),
        [],
    )
    files, said = draw_distribution_figure(
        tmp_path, systems, numbers(MIN_CLIPS_FOR_DISTRIBUTION, systems)
    )
    assert [path.name for path in files] == [
        f"distributions.{e}" for e in ("png", "svg", "pdf", "txt")
    ]
    assert all(path.is_file() for path in files) and not said
    drawn = re.sub(
        r"<metadata>.*</metadata>", "", (tmp_path / "distributions.svg").read_text(), flags=re.S
    )
    assert "Foot sliding" in drawn and "BeatAlign" not in drawn


def test_systems_beyond_the_styles_are_named(tmp_path: Path):
    systems = [f"system {k}" for k in range(12)] + [REFERENCE_NAME]
    files, said = draw_distribution_figure(
        tmp_path, systems, numbers(MIN_CLIPS_FOR_DISTRIBUTION, systems)
    )
    assert files and "system 11" in said[0]
