"""Files as people save them: those of the manifest, drawn ones, real ones, and damaged ones."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from model.formats.read import read_any_motion
from model.formats.reading import read_told
from tests.helpers import foreign_folder
from tests.model.formats.made import drawn, joints_of
from tests.model.formats.measured import INPUTS, can_be_told, drawn_outcomes, inputs, wrong


@pytest.mark.parametrize("name", inputs() or [""])
def test_files_as_people_save_them_are_read_or_refused_as_the_manifest_says(name: str):
    if not name:
        pytest.skip("no files as people save them here (shared/data/inputs)")
    assert wrong(name) == ""


@pytest.mark.parametrize(
    ("name", "assume", "frames"),
    [
        ("06_talkshow_4samples_short.npy", "motion=3", 24),
        ("30_nan_3frames.npz", "frames=bridge", 90),
        ("a02_clips_slash_keys.npz", "motion=clip2", 90),
        ("a26_gt_and_pred.npz", "motion=2", 90),
        ("a01_batch4_short.npz", "motion=4", 30),
        ("a25_10fps.npz", "rate=15", 179),
        ("41_classic_names_crlf_60fps.bvh", "rate=30", 60),
    ],
)
def test_what_is_refused_or_unsure_can_be_told(name: str, assume: str, frames: int):
    if not INPUTS.is_dir():
        pytest.skip("no files as people save them here (shared/data/inputs)")
    reading = can_be_told(name, assume)
    assert reading.motion.num_frames == frames
    told = reading.of(assume.split("=")[0])  # type: ignore[arg-type]
    assert told is not None and told.sure == "told"


@pytest.mark.parametrize("seed", range(20))
def test_a_motion_in_any_convention_is_that_motion(seed: int, tmp_path: Path):
    file = drawn(seed, tmp_path)
    outcome, _ = file.outcome()
    assert outcome == "right", file.said


@pytest.mark.slow
def test_of_300_drawn_files_nearly_all_are_right_and_hardly_any_wrong_untold():
    counts = Counter(outcome for outcome, _ in drawn_outcomes(range(300)))
    assert counts["right"] >= 285 and counts["silent"] <= 3, counts


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_what_is_told_overrules_what_the_motion_says(seed: int, tmp_path: Path):
    """Told its conventions, a file is read as without help; told others, otherwise."""
    file = drawn(seed, tmp_path)
    right = f"up={file.said['up']}"
    assert file.apart_m(read_any_motion(file.path, read_told(right)).motion) < file.tolerance_m
    other = "z" if file.said["up"] != "z" else "x"
    alone = read_told(f"elsewhere:up={other}")
    assert file.apart_m(read_any_motion(file.path, alone).motion) < file.tolerance_m
    if file.path.suffix != ".bvh":
        told = read_told(f"{file.path.stem}:up={other}")
        assert file.apart_m(read_any_motion(file.path, told).motion) > 0.5


@pytest.mark.parametrize(
    ("name", "frames", "told"),
    [
        ("talkshow_french.npy", 288, {"up": "-y", "hands": "mean", "rate": "30"}),
        pytest.param("zeroeggs_067_Speech_2.bvh", 2065, {"units": "cm"}, marks=pytest.mark.slow),
        ("freetalker_10_kieks_0_96_96_1.bvh", 10, {"units": "cm", "rate": "120.005"}),
        ("seg_MOUTH_CLASP-3.bvh", 71, {"units": "cm", "rate": "59.999"}),
        ("chgs_3_vq.npz", 2016, {}),
        ("emage_female.npz", 704, {}),
    ],
)
def test_files_of_others_open(name: str, frames: int, told: dict[str, str]):
    reading = read_any_motion(foreign_folder() / name)
    assert reading.motion.num_frames == frames
    said = {each.kind: each.value for each in reading.assumptions if not each.is_usual}
    assert {kind: said.get(kind) for kind in told} == told
    assert bool(said) == bool(told)
    joints = joints_of(reading.motion)
    assert (joints[:, 15, 1] - joints[:, [7, 8], 1].mean(axis=1) > 0.8).all()  # they stand


def test_hands_of_published_results_keep_within_human_range_once_the_mean_hand_is_added():
    reading = read_any_motion(foreign_folder() / "talkshow_french.npy")
    flat = read_any_motion(foreign_folder() / "talkshow_french.npy", read_told("hands=flat"))
    assert reading.lacks == {"finger_angles", "place"}
    bends = [
        np.concatenate([-poses[:, 25:37, 2], poses[:, 40:52, 2]], axis=1)
        for poses in (each.motion.poses.reshape(-1, 55, 3) for each in (reading, flat))
    ]
    assert np.percentile(bends[0], 10) > -0.2 > np.percentile(bends[1], 10)
