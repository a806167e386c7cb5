"""FGD by EMAGE's encoder: of whole sets, and of sets drawn with replacement."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.linalg import sqrtm

from app.errors import RunError
from app.findings.metric_table import FGD_EMAGE
from app.run.batch.frechet_distances import (
    distance_rows,
    feature_encoders,
    min_num_codes,
    save_features,
)
from app.run.batch.motion_sets import diagnose_folders
from app.run.requests.convert import replace_fields
from app.run.requests.parts import MetricOptions
from app.run.requests.requests import AnyRun
from model.motion.motion import Motion, save_motion
from model.storage.cards import CheckpointError
from model.systems.helpers.emage import CODE_DIM, emage_codes, load_emage_encoder
from tests.app.requests import diagnose_request
from tests.helpers import csv_rows, smooth_motion_example
from tests.model.systems.helpers.made_emage import emage_tensors

FRAMES = {"a": 1000, "b": 1500, "c": 1700, "short": 20}
"""About 260 codes, and a clip that has none."""
SIZES = {"lively": 1.5, "calm": 0.8}
NUM_DRAWS = 10


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("emage") / "AESKConv_240_100.bin"
    torch.save({"model_state": emage_tensors(1)}, path)
    return path


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch):
    """Which take the time."""
    monkeypatch.setattr("app.run.batch.frechet_distances.DRAWS", NUM_DRAWS)


def _motions(frames: int, seed: int) -> dict[str, Motion]:
    recorded = smooth_motion_example(frames, seed)
    return {"reference": recorded} | {
        name: replace(recorded, poses=(size * recorded.poses).astype(np.float32))
        for name, size in SIZES.items()
    }


def test_an_encoder_file_that_was_replaced_is_read_anew(weights: Path, tmp_path: Path):
    path = Path(shutil.copy(weights, tmp_path / weights.name))
    metrics = MetricOptions(emage_weights=path)
    assert feature_encoders(metrics) is feature_encoders(metrics)
    path.write_bytes(b"no weights")
    with pytest.raises(CheckpointError):
        feature_encoders(metrics)


@pytest.mark.usefixtures("few_draws")
def test_distances_are_those_of_all_codes_and_of_each_draw(weights: Path, tmp_path: Path):
    encoder, metrics = load_emage_encoder(weights), MetricOptions(emage_weights=weights)
    codes: dict[str, list[np.ndarray]] = {"reference": [], **{name: [] for name in SIZES}}
    records: list[Path] = []
    for seed, (clip, length) in enumerate(FRAMES.items()):
        motions = _motions(length, seed)
        record = tmp_path / f"{clip}.json"
        save_features(record, {name: [motion] for name, motion in motions.items()}, metrics)
        records.append(record)
        for name, motion in motions.items():
            codes[name] += [emage_codes(encoder, motion)] * (length >= 32)
    rng = np.random.default_rng(0)
    indices = [np.arange(3), *(rng.integers(3, size=3) for _ in range(NUM_DRAWS))]
    told = {
        name: np.array([_plain_distance(codes["reference"], codes[name], i) for i in indices])
        for name in SIZES
    }
    rows, notes = distance_rows(["lively", "calm", "reference"], records, metrics)
    assert not notes
    lively, apart, calm = (row for row in rows if row[0] == FGD_EMAGE)
    for row, name, other in ((lively, "lively", ""), (calm, "calm", "")):
        wanted = [told[name][0], *np.percentile(told[name][1:], [2.5, 97.5])]
        assert row[:4] == (FGD_EMAGE, "", name, 3) and row[7] == other
        assert row[4:7] == pytest.approx(wanted, rel=1e-5)
    values = told["lively"] - told["calm"]
    assert apart[2:7] == ("lively", 3, "", "", "") and apart[7] == "calm"
    wanted = [values[0], *np.percentile(values[1:], [2.5, 97.5])]
    assert apart[8:11] == pytest.approx(wanted, rel=1e-5) and apart[11] == "fgd/emage"


def _save_sets(top: Path) -> None:
    for name in ("lively", "calm", "reference"):
        (top / name).mkdir()
    for seed, clip in enumerate("ab"):
        for name, motion in _motions(70, seed).items():
            save_motion(motion, top / name / f"{clip}.npz")


def _asked(top: Path, weights: Path) -> AnyRun:
    folders = (top / "lively", top / "calm")
    reference = top / "reference"
    return diagnose_request(
        motions=folders, out=top / "out", reference=reference, emage_weights=weights
    )


@pytest.mark.usefixtures("few_draws")
def test_tables_tell_them_and_codes_are_kept(weights, tmp_path, monkeypatch):
    monkeypatch.setattr("app.run.batch.frechet_distances.min_num_codes", lambda num_dims: 8)
    _save_sets(tmp_path)
    request = _asked(tmp_path, weights)
    diagnose_folders(request)
    rows = _rows(request.output.out)
    means = {row["system"]: row["mean"] for row in rows if row["mean"]}
    assert list(means) == ["lively", "calm"] and float(means["lively"]) > float(means["calm"]) > 0
    assert any(row["difference_to"] == "calm" for row in rows)
    assert "EMAGE's encoder" in (request.output.out / "summary.md").read_text()
    assert "EMAGE's encoder" in (request.output.out / "table.tex").read_text()
    kept = request.output.out / "clips" / "b.json"
    before = kept.stat().st_mtime_ns
    (request.output.out / "clips" / "a.codes.npz").unlink()
    again = diagnose_folders(replace_fields(request, motions=request.motions.motions[::-1]))
    assert any("1 clip had already been measured" in note for note in again.notes)
    assert kept.stat().st_mtime_ns == before
    swapped = {row["system"]: row["mean"] for row in _rows(request.output.out) if row["mean"]}
    assert swapped == means


def test_too_few_codes_are_told(weights: Path, tmp_path: Path):
    assert min_num_codes(CODE_DIM) == CODE_DIM + 1
    _save_sets(tmp_path)
    result = diagnose_folders(_asked(tmp_path, weights))
    assert any("have 8 feature vectors" in note and "at least 241" in note for note in result.notes)
    assert "EMAGE" not in (tmp_path / "out" / "summary.md").read_text()


def test_wrong_weights_are_told_before_anything_is_measured(tmp_path: Path):
    weights = tmp_path / "wrong.bin"
    torch.save({"model_state": {"encoder.weight": torch.zeros(2)}}, weights)
    request = _asked(tmp_path, weights)
    with pytest.raises(CheckpointError, match=r"encoder.layers.0.0.residual.0.weight is missing"):
        diagnose_folders(request)
    with pytest.raises(RunError, match="--reference FOLDER"):
        diagnose_folders(replace_fields(request, reference=None))
    assert not (tmp_path / "out").exists()


def _rows(out: Path) -> list[dict[str, str]]:
    return [row for row in csv_rows(out / "batch.csv") if row["measure"] == FGD_EMAGE]


def _plain_distance(recorded: list[np.ndarray], made: list[np.ndarray], index: np.ndarray) -> float:
    """By a matrix root, with EMAGE's 1e-6 under it."""
    a, b = (np.concatenate([clips[i] for i in index]).astype(float) for clips in (recorded, made))
    of_a, of_b = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    under = 1e-6 * np.eye(len(of_a))
    root = sqrtm((of_a + under) @ (of_b + under))
    mean = a.mean(0) - b.mean(0)
    return float(mean @ mean + np.trace(of_a) + np.trace(of_b) - 2 * np.trace(np.real(root)))
