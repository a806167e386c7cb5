"""Folders of clips: paired by name, told with intervals, and gone on with after a stop."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import RunError
from app.run.many.motions import ManyRequest, diagnose_folders
from app.run.many.table import interval
from model.jobs.crew import Crew
from model.motion.motion import save_motion
from tests.helpers import smooth_motion_example

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


def asked(folders: Path, out: Path) -> ManyRequest:
    return ManyRequest((folders / "lively", folders / "same"), out, folders / "gt", crew=Crew(1))


def test_clips_are_paired_told_and_kept(folders: Path, tmp_path: Path):
    shares: list[float] = []
    result = diagnose_folders(asked(folders, tmp_path), shares.append)
    assert result.clips == CLIPS and shares[-1] == 1.0
    assert any("1 of 4 files have no partner" in note for note in result.notes)
    with (tmp_path / "many.csv").open() as file:
        rows = list(csv.DictReader(file))
    speed = [row for row in rows if row["measure"] == "Followed point: Speed"]
    means = {row["system"]: float(row["mean"]) for row in speed if row["mean"]}
    assert means["lively"] > 1.5 * means["reference"]
    assert means["same"] == pytest.approx(means["reference"])
    (apart,) = (r for r in speed if (r["system"], r["difference_to"]) == ("lively", "reference"))
    assert float(apart["difference_low"]) > 0
    assert float(apart["difference"]) == pytest.approx(means["lively"] - means["reference"])
    sheet = (tmp_path / "sheet.md").read_text()
    assert "# 3 clips" in sheet and "| identical | 0 | 3 | 0 |" in sheet
    kept = tmp_path / "clips" / "b.json"
    before = kept.stat().st_mtime_ns
    (tmp_path / "clips" / "c.json").write_text("{")  # half a file of a run that was stopped
    again = diagnose_folders(asked(folders, tmp_path))
    assert any("2 clips had been measured before" in note for note in again.notes)
    assert kept.stat().st_mtime_ns == before
    assert json.loads((tmp_path / "clips" / "c.json").read_text())["frames"] == 90


def test_folders_without_a_common_name_are_refused(folders: Path, tmp_path: Path):
    (tmp_path / "other").mkdir()
    with pytest.raises(RunError, match="paired by name"):
        diagnose_folders(ManyRequest((folders / "gt", tmp_path / "other"), tmp_path / "out"))
    with pytest.raises(RunError, match="is no folder"):
        diagnose_folders(ManyRequest((folders / "gt", tmp_path / "none"), tmp_path / "out"))


def test_an_interval_holds_the_mean():
    mean, low, high = interval([1.0, 2.0, 3.0, 4.0])
    assert mean == 2.5 and 1.0 <= low < mean < high <= 4.0
    assert interval([2.0]) == (2.0, 2.0, 2.0)
