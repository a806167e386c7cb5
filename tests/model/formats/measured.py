"""What files as people save them and drawn files are read as: ``python -m
tests.model.formats.measured [DRAWN]`` prints the table of docs/formats.md."""

import json
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from model.formats.read import read_any_motion
from model.formats.reading import Reading, read_told
from model.storage.npz import MotionError
from tests.helpers import ROOT
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
    "a43_joint_positions_T55_3.npy": "positions of joints",
}
"""Files that are to be refused, and what the sentence names."""
SAID = {
    "01_seamless.npz": "frames 40-45",
    "05_talkshow_meanhands.npy": "hands mean",
    "06_talkshow_4samples_short.npy": "4 samples",
    "09_camera_depth_38m.npz": "units m",
    "10_trans_mm.npz": "units mm",
    "12_no_rate.npz": "rate 30",
    "15_betas_None.npz": "betas",
    "24_6d_columns.npy": "6d-columns",
    "47_blender_zup.bvh": "up z",
    "50_decimal_comma.bvh": "decimal commas",
    "54_last_row_cut.bvh": "row 60 of 60 is cut",
    "55_stated_more.bvh": "says 64 frames and holds 60",
    "59_two_roots.bvh": "2 roots",
    "a01_batch4_short.npz": "batch of 4 motions",
    "a05_quat_xyzw_T55_4.npy": "quaternion-xyzw",
    "a18_transposed_165xT.npz": "second axis",
    "a21_two_rates.npz": "60",
    "a30_T337_emage_internal.npy": "EMAGE",
    "a44_zup_pelvis_tilt34.npz": "up z",
    "a45_x_up.npz": "up x",
    "b07_faces_x.bvh": "facing x",
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


def _wrong_pose(name: str, reading: Reading) -> str:
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
    off = off[:, :22] if "hands" in reading.lacks and not is_bvh else off
    off = np.delete(off, np.s_[40:46], axis=0) if name == "01_seamless.npz" else off
    apart_m = float(np.linalg.norm(off, axis=-1).max())
    return "" if apart_m < NEAR_M else f"{1000 * apart_m:.1f} mm apart"


def _knee_deg(joints: np.ndarray) -> float:
    thigh, shin = joints[4] - joints[1], joints[7] - joints[4]
    cosine = thigh @ shin / np.linalg.norm(thigh) / np.linalg.norm(shin)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def drawn_outcomes(seeds: range) -> Iterator[tuple[str, str]]:
    """Of each drawn file: what became of it, and in which conventions it was written."""
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            file = drawn(seed, Path(folder))
            outcome, _ = file.outcome()
            file.path.unlink()
            yield outcome, f"{seed}{file.path.suffix} {file.said}"


def can_be_told(name: str, assume: str) -> Reading:
    """A file of the manifest as the user says."""
    return read_any_motion(INPUTS / name, read_told(assume))


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    names = inputs()
    problems = {name: why for name in names if (why := wrong(name))}
    out = sys.stdout.write
    out(f"inputs as the manifest says: {len(names) - len(problems)} of {len(names)}\n")
    for name, why in problems.items():
        out(f"  {name}: {why}\n")
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    found = list(drawn_outcomes(range(count)))
    counts = Counter(outcome for outcome, _ in found)
    out(f"drawn: {count}, {', '.join(f'{many} {what}' for what, many in counts.items())}\n")
    for outcome, said in found:
        if outcome != "right":
            out(f"  {outcome}: {said}\n")


if __name__ == "__main__":
    main()
