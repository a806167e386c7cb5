"""Files as people save them: those of the manifest, drawn ones, real ones, and damaged ones."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from model.diagnostics import analyse_raw
from model.faults.table import find_faults
from model.formats.read import read_any_motion
from model.formats.reading import ImportedMotion, length_notes, parse_import_overrides
from model.motion.kinematics import open_body_skeleton
from model.storage.npz import MotionError
from tests.helpers import ROOT, foreign_folder
from tests.model.formats.made import drawn, joints_of

INPUTS = ROOT.parent / "shared" / "data" / "inputs"
REFUSED = {
    "07_show_pca.npz": "num_pca_comps",
    "28_humanml_263.npy": "HumanML3D",
    "30_nan_3frames.npz": "frames 30-32",
    "a02_clips_slash_keys.npz": "clip1, clip2",
    "a03_dict_of_clips_object.npz": "python -c",
    "a25_10fps.npz": "10 frames per second",
    "a26_gt_and_pred.npz": "gt, pred",
    "a41_poses.json": ".npz, .npy, .bvh",
    "a43_joint_positions_T55_3.npy": "joint positions, not rotations",
}
"""Files that are to be refused, and what the sentence names."""
SAID = {
    "01_seamless.npz": "frames 40-45",
    "05_talkshow_meanhands.npy": "hands relative to the mean pose",
    "06_talkshow_4samples_short.npy": "4 samples",
    "09_camera_depth_38m.npz": "units m",
    "10_trans_mm.npz": "units mm",
    "12_no_rate.npz": "rate 30",
    "15_betas_None.npz": "betas",
    "24_6d_columns.npy": "6d-columns",
    "47_blender_zup.bvh": "up axis z",
    "50_decimal_comma.bvh": "decimal commas",
    "54_last_row_cut.bvh": "row 60 of 60 is cut",
    "55_stated_more.bvh": "states 64 frames but has 60",
    "59_two_roots.bvh": "2 roots",
    "a01_batch4_short.npz": "batch of 4 motions",
    "a05_quat_xyzw_T55_4.npy": "quaternion-xyzw",
    "a18_transposed_165xT.npz": "second axis",
    "a21_two_rates.npz": "60",
    "a30_T337_emage_internal.npy": "EMAGE",
    "a44_zup_pelvis_tilt34.npz": "up axis z",
    "a45_x_up.npz": "up axis x",
    "b07_faces_x.bvh": "facing direction x",
}
"""What must be told of files that are read."""
OTHER_POSE = {
    "05_talkshow_meanhands.npy": "hands",
    "06_talkshow_4samples_short.npy": "",
    "47_blender_zup.bvh": "upright",
    "49_one_channel_knees.bvh": "knees",
    "58_apose.bvh": "arms",
    "a44_zup_pelvis_tilt34.npz": "upright",
}
"""Files that do not hold the reference's motion, and what is looked at instead."""
NEAR_M = 1e-3


def inputs() -> list[str]:
    """Names of all motion files of the manifest; none where it is not there."""
    manifest = INPUTS / "manifest.json"
    if not manifest.is_file():
        return []
    endings = (".npz", ".npy", ".bvh", ".json")
    names = [each["name"] for each in json.loads(manifest.read_text())]
    return [name for name in names if name.endswith(endings)]


def wrong(name: str) -> str:
    """Why the reading of a file of the manifest is not as it is to be; nothing where it is."""
    try:
        reading = read_any_motion(INPUTS / name)
    except MotionError as error:
        said = REFUSED.get(name)
        return "" if said is not None and said in str(error) else f"refused: {error}"
    if name in REFUSED:
        return "read"
    if SAID.get(name, "") not in " ".join(reading.notes):
        return f"not told: {SAID[name]}; {reading.notes}"
    return _wrong_pose(name, reading)


def _wrong_pose(name: str, reading: ImportedMotion) -> str:
    found = joints_of(reading.motion)
    look = OTHER_POSE.get(name)
    tall = found[:, 15, 1] - found[:, [10, 11], 1].min(axis=1)
    if look == "upright":
        return "" if tall.min() > 1.0 else f"stands {tall.min():.2f} m"
    if look == "hands":
        hands = reading.motion.poses.reshape(-1, 55, 3)[:, 25:37, 2]
        return "" if hands.mean() < -0.1 else "hands are flat"
    if look == "knees":
        angles = [_knee_deg(joints) for joints in found[[0, -1]]]
        return "" if abs(angles[0] - angles[-1]) > 10 else f"knees at {angles}"
    if look == "arms":
        arm = found[0, 18] - found[0, 16]
        down = np.degrees(np.arctan2(-arm[1], arm[0]))
        return "" if abs(down - 45) < 1 else f"arms rest {down:.0f} degrees down"
    if look is not None:
        return ""
    is_bvh = name.endswith(".bvh")
    against = "40_plain.bvh" if is_bvh else "reference_base.npz"
    wanted = joints_of(read_any_motion(INPUTS / against).motion)
    wanted = wanted[::2] if "60fps" in name else wanted
    frames = min(len(found), len(wanted))
    off = found[:frames] - found[:frames, :1] - wanted[:frames] + wanted[:frames, :1]
    off = off[:, :22] if "hands" in reading.missing_parts and not is_bvh else off
    off = np.delete(off, np.s_[40:46], axis=0) if name == "01_seamless.npz" else off
    apart_m = float(np.linalg.norm(off, axis=-1).max())
    return "" if apart_m < NEAR_M else f"{1000 * apart_m:.1f} mm apart"


def _knee_deg(joints: np.ndarray) -> float:
    thigh, shin = joints[4] - joints[1], joints[7] - joints[4]
    cosine = thigh @ shin / np.linalg.norm(thigh) / np.linalg.norm(shin)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


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
    reading = read_any_motion(INPUTS / name, parse_import_overrides(assume))
    assert reading.motion.num_frames == frames
    told = reading.assumption_of(assume.split("=")[0])  # type: ignore[arg-type]
    assert told is not None and told.confidence == "user"


@pytest.mark.parametrize("seed", range(20))
def test_a_motion_in_any_convention_is_that_motion(seed: int, tmp_path: Path):
    file = drawn(seed, tmp_path)
    outcome, _ = file.outcome()
    assert outcome == "right", file.said


@pytest.mark.slow
def test_of_300_drawn_files_nearly_all_are_right_and_hardly_any_wrong_untold(tmp_path: Path):
    counts = Counter(drawn(seed, tmp_path).outcome()[0] for seed in range(300))
    assert counts["right"] >= 285 and counts["silent"] <= 3, counts


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_what_is_told_overrules_what_the_motion_says(seed: int, tmp_path: Path):
    """Told its conventions, a file is read as without help; told others, otherwise."""
    file = drawn(seed, tmp_path)
    right = f"up={file.said['up']}"
    assert (
        file.apart_m(read_any_motion(file.path, parse_import_overrides(right)).motion)
        < file.tolerance_m
    )
    other = "z" if file.said["up"] != "z" else "x"
    alone = parse_import_overrides(f"elsewhere:up={other}")
    assert file.apart_m(read_any_motion(file.path, alone).motion) < file.tolerance_m
    if file.path.suffix != ".bvh":
        told = parse_import_overrides(f"{file.path.stem}:up={other}")
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
    said = {each.kind: each.value for each in reading.assumptions if not each.is_own_convention}
    assert {kind: said.get(kind) for kind in told} == told
    assert bool(said) == bool(told)
    joints = joints_of(reading.motion)
    assert (joints[:, 15, 1] - joints[:, [7, 8], 1].mean(axis=1) > 0.8).all()  # they stand


def test_hands_of_published_results_keep_within_human_range_once_the_mean_hand_is_added():
    reading = read_any_motion(foreign_folder() / "talkshow_french.npy")
    flat = read_any_motion(
        foreign_folder() / "talkshow_french.npy", parse_import_overrides("hands=flat")
    )
    assert reading.missing_parts == {"finger_angles", "place"}
    bends = [
        np.concatenate([-poses[:, 25:37, 2], poses[:, 40:52, 2]], axis=1)
        for poses in (each.motion.poses.reshape(-1, 55, 3) for each in (reading, flat))
    ]
    assert np.percentile(bends[0], 10) > -0.2 > np.percentile(bends[1], 10)


def test_of_a_file_with_a_wrong_frame_time_the_right_rate_is_offered():
    path = ROOT.parent / "shared" / "data" / "inputs5" / "full_frametime_24_should_be_30.bvh"
    if not path.is_file():
        pytest.skip("no files that outsiders met here (shared/data/inputs5)")
    reading = read_any_motion(path)
    (note,) = length_notes(14.06, {"a": reading.motion.duration_s}, {"a": reading.source_fps})
    assert "At 30 fps it would" in note and "--assume rate=30" in note
    assert read_any_motion(
        path, parse_import_overrides("rate=30")
    ).motion.duration_s == pytest.approx(14.0)


def test_a_body_that_bobs_is_found_and_one_that_stands_is_not():
    folder = ROOT.parent / "shared" / "data" / "inputs5"
    if not folder.is_dir():
        pytest.skip("no files that outsiders met here (shared/data/inputs5)")
    found = {
        name: find_faults(
            analyse_raw(read_any_motion(folder / f"{name}.npz").motion, open_body_skeleton())
        )
        for name in ("base", "emage_floats")
    }
    assert found["base"] == []
    (floating,) = found["emage_floats"]
    assert floating.kind == "floating" and "above the floor by up to 12 cm" in floating.sentence
