"""Zips of results: unpacked, measured as folders are, and clips left out that cannot be read."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import RunError
from app.run.batch.motion_sets import diagnose_folders, measure_uploaded_sets
from app.run.requests.convert import replace_fields
from conventions.rates import SAMPLE_RATE
from model.motion.motion import save_motion
from model.speech.audio import write_wav
from tests.app.recorded_callbacks import RecordedCallbacks
from tests.app.requests import diagnose_request
from tests.helpers import smooth_motion_example

CLIPS = ("a", "b", "c", "d", "e")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A system that trembles in one clip, the recorded clips, and their sound."""
    top = tmp_path_factory.mktemp("sets")
    for name in ("mine", "gt", "sound"):
        (top / name / "inner").mkdir(parents=True)
    rng = np.random.default_rng(0)
    for seed, clip in enumerate(CLIPS):
        motion = smooth_motion_example(90, seed)
        save_motion(motion, top / "gt" / "inner" / f"gt_{clip}.npz")
        noise = rng.normal(0, 0.2 if clip == "d" else 0.0, motion.poses.shape)
        trembling = replace(motion, poses=(motion.poses + noise).astype(np.float32))
        save_motion(trembling, top / "mine" / "inner" / f"res_{clip}.npz")
        wav = rng.uniform(-0.5, 0.5, 3 * SAMPLE_RATE).astype(np.float32)
        write_wav(top / "sound" / "inner" / f"{clip}.wav", wav)
    return top


def zipped(folder: Path, out: Path, **more: bytes) -> Path:
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*.*")):
            archive.write(path, path.relative_to(folder))
        for name, content in more.items():
            archive.writestr(f"inner/{name}.npz", content)
    return out


def test_a_zip_is_measured_as_its_folder(folders: Path, tmp_path: Path) -> None:
    callbacks = RecordedCallbacks()
    found = measure_uploaded_sets(
        diagnose_request(
            motions=(zipped(folders / "mine", tmp_path / "mine.zip", res_broken=b"no motion"),),
            names=("My system",),
            out=tmp_path / "out",
            reference=zipped(folders / "gt", tmp_path / "gt.zip", gt_broken=b"no motion"),
            speech=zipped(folders / "sound", tmp_path / "sound.zip"),
        ),
        callbacks,
    )
    assert found.batch_json["clips"] == list(CLIPS)
    shares = callbacks.shares
    assert sorted(shares) == shares and shares[-1] > 0.8, "the last clip could not be read"
    assert list(found.motion_files) == ["My system", "reference"]
    assert sorted(found.audio_files) == list(CLIPS)
    assert any("was left out" in note and "broken" in note for note in found.notes)
    worst = found.batch_json["worst"][0]
    assert (worst["system"], worst["clip"]) == ("My system", "d") and worst["kinds"]
    assert any(path.name == "distributions.png" for path in found.files)
    for name, files in found.motion_files.items():
        assert list(files) == list(CLIPS)
        for clip, path in files.items():
            kind = "gt_" if name == "reference" else "res_"
            (source,) = folders.rglob(f"{kind}{clip}.npz")
            assert path.read_bytes() == source.read_bytes()

    asked = diagnose_request(
        motions=(folders / "mine",),
        out=tmp_path / "plain",
        reference=folders / "gt",
        speech=folders / "sound",
    )
    diagnose_folders(asked)
    plain = json.loads((tmp_path / "plain" / "batch.json").read_text())
    named = json.loads(json.dumps(found.batch_json).replace("My system", "mine"))
    assert list(named.pop("left_out")) == ["broken"] and not plain.pop("left_out")
    for told in (named, plain):
        del told["provenance"]["made_at"]
    assert named == plain


def test_all_zips_together_hold_no_more_than_the_limit(folders, tmp_path, monkeypatch):
    mine, theirs = (zipped(folders / "mine", tmp_path / f"{name}.zip") for name in ("mine", "gt"))
    held = sum(path.stat().st_size for path in (folders / "mine").rglob("*.npz"))
    monkeypatch.setattr("app.run.batch.motion_sets.MAX_BYTES", round(1.5 * held))
    asked = diagnose_request(motions=(mine,), names=("mine",), out=tmp_path / "one")
    assert measure_uploaded_sets(asked).batch_json["clips"] == list(CLIPS)
    with pytest.raises(RunError, match="Split the archive"):
        measure_uploaded_sets(replace_fields(asked, out=tmp_path / "two", reference=theirs))
    monkeypatch.setattr("app.run.batch.motion_sets.MAX_FILES", len(CLIPS) + 1)
    monkeypatch.setattr("app.run.batch.motion_sets.MAX_BYTES", 10 * held)
    with pytest.raises(RunError, match="the limit is 1"):
        measure_uploaded_sets(replace_fields(asked, out=tmp_path / "three", reference=theirs))
    for out in ("two", "three"):
        assert not list((tmp_path / out).glob(".*")), "what was unpacked is gone"


def test_zips_of_one_name_and_without_a_common_clip_are_refused(folders, tmp_path):
    other = tmp_path / "other.zip"
    with zipfile.ZipFile(other, "w") as archive:
        archive.write(next(folders.rglob("res_a.npz")), "x.npz")
    mine = zipped(folders / "mine", tmp_path / "mine.zip")
    with pytest.raises(RunError, match=r"No clip is in all sets \(mine, other\)"):
        measure_uploaded_sets(
            diagnose_request(
                motions=(mine, other), names=("mine", "other"), out=tmp_path / "second"
            )
        )
    with pytest.raises(RunError, match="same name"):
        measure_uploaded_sets(
            diagnose_request(motions=(mine, mine), names=("mine", "mine"), out=tmp_path / "third")
        )
