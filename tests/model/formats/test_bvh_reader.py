"""BVH: any tree of a person, its text read as far as nothing is lost, and our own files back."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.run.bodies import body_motion
from conventions.joints import HANDS, JOINT_INDEX, JOINT_NAMES
from model.formats.read import read_any_motion
from model.formats.reading import parse_import_overrides
from model.storage.npz import MotionError
from renderer.body.body import load_body
from renderer.files.exports import write_bvh
from tests.helpers import ROOT
from tests.model.formats.made import BODY_JOINTS, Person, bvh_text, joints_of
from tests.model.formats.made_conventions import CONVENTIONS, convention_text, joint_positions

MOTION = Person(7).motion(20)
WANTED = joints_of(MOTION)
WHOLE = [*BODY_JOINTS, *HANDS]


def text_of(joints: list[int] = BODY_JOINTS, names=(), scale: float = 1.0, **more) -> str:
    names = list(names) or [JOINT_NAMES[joint] for joint in joints]
    return bvh_text(MOTION, joints, Rotation.identity(), scale, names, **more)


def read(folder: Path, text: str, assume: str = ""):
    path = folder / "a.bvh"
    path.write_bytes(text.encode("latin-1"))
    return read_any_motion(path, parse_import_overrides(assume))


def test_our_own_bvh_comes_back(tmp_path: Path):
    path = tmp_path / "own.bvh"
    write_bvh(load_body(), body_motion(MOTION), path)
    reading = read_any_motion(path)
    np.testing.assert_allclose(joints_of(reading.motion), WANTED, atol=2e-3)
    assert reading.notes == () and "face" in reading.missing_parts


LIMBS = ("left upper arm", "left forearm", "right thigh", "right shin")
PINNED = {
    "CMU": ((0.997, -0.010, 0.073), (0.889, 0.292, -0.352),
            (-0.668, -0.719, -0.192), (-0.298, -0.898, -0.324)),
    "Mixamo": ((1.000, 0.008, -0.011), (0.973, 0.229, 0.033),
               (0.005, -0.923, -0.386), (0.178, -0.925, -0.336)),
    "Biovision": ((-0.224, -0.904, -0.364), (-0.400, -0.904, -0.153),
                  (0.087, -0.943, -0.322), (-0.348, -0.887, -0.303)),
    "Xsens": ((0.886, 0.307, -0.348), (0.579, 0.443, -0.684),
              (0.059, -0.900, -0.433), (0.006, -0.692, -0.722)),
    "Rokoko": ((0.812, -0.389, 0.435), (0.614, -0.704, 0.356),
               (-0.068, -0.969, 0.237), (-0.343, -0.939, -0.017)),
    "BEAT": ((0.888, 0.110, 0.447), (0.792, 0.570, 0.220),
             (-0.121, -0.961, -0.247), (-0.109, -0.849, -0.518)),
    "ZeroEGGS": ((0.965, 0.205, -0.162), (0.974, 0.203, -0.102),
                 (0.172, -0.902, -0.397), (0.303, -0.915, -0.265)),
    "Perception Neuron": ((0.610, 0.690, 0.391), (0.308, 0.929, 0.204),
                          (-0.077, -0.989, 0.125), (-0.394, -0.881, -0.262)),
    "MakeHuman": ((0.727, -0.495, -0.475), (0.356, -0.676, -0.645),
                  (-0.092, -0.909, 0.406), (0.101, -0.991, 0.088)),
}  # fmt: skip
"""Directions of `LIMBS` in the last frame, of `joint_positions`."""
AT_REST = {"CMU": 31, "Mixamo": 15, "Biovision": 37, "Xsens": 33, "Rokoko": 33, "BEAT": 15,
           "ZeroEGGS": 21, "Perception Neuron": 17, "MakeHuman": 3}  # fmt: skip
"""How many of our joints each convention lacks, the face's three among them."""


def directions(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    return (end - start) / np.linalg.norm(end - start, axis=-1, keepdims=True)


def angles_deg(path: Path, name: str, every: int = 1) -> dict[str, float]:
    """By how much each limb bone of our reading is off where the second reader has it, at most."""
    theirs, ours = joint_positions(path), joints_of(read_any_motion(path).motion)
    off = {}
    for bone, ((start, end), (our_start, our_end)) in CONVENTIONS[name].bones().items():
        wanted = directions(theirs[start], theirs[end])[::every]
        found = directions(ours[:, JOINT_INDEX[our_start]], ours[:, JOINT_INDEX[our_end]])
        cosine = (wanted * found[: len(wanted)]).sum(axis=-1)
        off[bone] = float(np.degrees(np.arccos(cosine.clip(-1, 1)).max()))
    return off


@pytest.mark.parametrize("name", CONVENTIONS)
def test_limbs_of_each_naming_convention_point_as_in_the_file(tmp_path: Path, name: str):
    path = tmp_path / "a.bvh"
    path.write_text(convention_text(name))
    theirs, bones = joint_positions(path), CONVENTIONS[name].bones()
    for limb, pinned in zip(LIMBS, PINNED[name], strict=True):
        (start, end), _ = bones[limb]
        np.testing.assert_allclose(directions(theirs[start], theirs[end])[-1], pinned, atol=1e-3)
    split = 2.0 if name == "MakeHuman" else 0.01  # its bones are two that turn apart
    assert max(angles_deg(path, name).values()) < split
    reading = read_any_motion(path)
    joints, layout = reading.assumption_of("joints"), reading.assumption_of("layout")
    assert joints is not None and f" {AT_REST[name]} SMPL-X joints stay at rest" in joints.reason
    assert joints.confidence == "sure" and layout is not None
    assert (layout.confidence == "unsure") == CONVENTIONS[name].is_unsure


def test_limbs_of_a_recording_of_cmu_point_as_in_the_file():
    path = ROOT.parent / "shared" / "data" / "inputs5" / "cmu_12_01_walk.bvh"
    if not path.is_file():
        pytest.skip("no recording of CMU's library here (shared/data/inputs5)")
    assert max(angles_deg(path, "CMU", every=4).values()) < 0.5


def test_without_names_an_elbow_that_lengths_do_not_tell_is_told_as_unsure(tmp_path: Path):
    (tmp_path / "a.bvh").write_text(convention_text("CMU"))
    text = (tmp_path / "a.bvh").read_text()
    for number, part in enumerate(("ForeArm", "Arm", "Hand", "Shoulder")):
        text = text.replace(f"Left{part}", f"Left{number}").replace(
            f"Right{part}", f"Right{number}"
        )
    told = read(tmp_path, text).assumption_of("joints")
    assert told is not None and told.confidence == "unsure"
    assert "their names do not say which joint is the elbow;" in told.reason


def test_a_hand_without_fingers_rests_along_its_forearm(tmp_path: Path):
    """As the arms rest so much lower, so do the hands: rotations are the same as of a T-pose."""
    low, plain = (read(tmp_path, text_of(arms_deg=deg)).motion.poses for deg in (45.0, 0.0))
    wrists = np.s_[:, 3 * JOINT_INDEX["left_wrist"] : 3 * JOINT_INDEX["right_wrist"] + 3]
    np.testing.assert_allclose(low[wrists], plain[wrists], atol=0.01)


TREES = {
    "names say nothing": {"joints": WHOLE, "names": [f"bone{n}" for n in range(len(WHOLE))]},
    "one side is named": {
        "names": [
            JOINT_NAMES[joint].replace("left", "Links").replace("right", "R")
            for joint in BODY_JOINTS
        ]
    },
    "arms rest lower": {"joints": WHOLE, "arms_deg": 45.0},
    "arms rest higher": {"joints": WHOLE, "arms_deg": -10.0},
    "a root above the hips walks": {"has_root": True},
    "each joint tells its place, as Mixamo and MotionBuilder write it": {"has_places": True},
    "long legs": {"scale": 50.0},
}


@pytest.mark.parametrize("how", TREES)
def test_any_tree_of_a_person_is_known_by_its_form_and_points_as_in_the_file(
    tmp_path: Path, how: str
):
    joints = TREES[how].get("joints", BODY_JOINTS)
    found = joints_of(read(tmp_path, text_of(**TREES[how])).motion)
    np.testing.assert_allclose(found[:, joints], WANTED[:, joints], atol=3e-3)


def test_numbers_in_names_say_which_joint_of_a_finger_it_is(tmp_path: Path):
    """Where a bone of the palm, which has none, stands before them."""
    less = str.maketrans({"1": "", "2": "1", "3": "2"})
    names = [JOINT_NAMES[j].translate(less) if j in HANDS else JOINT_NAMES[j] for j in WHOLE]
    told = read(tmp_path, text_of(WHOLE, names)).assumption_of("joints")
    assert told is not None and "; 10 are not used, " in told.reason


def test_lengths_are_told_otherwise(tmp_path: Path):
    half = read(tmp_path, text_of(scale=50.0), "units=cm").motion
    np.testing.assert_allclose(joints_of(half)[:, 0], WANTED[:, 0] / 2, atol=1e-3)


def test_a_row_less_than_stated_is_told_and_rates_are_stated_or_told(tmp_path: Path):
    reading = read(tmp_path, text_of(fps=60.0).replace("Frames: 20", "Frames: 21"))
    assert "states 21 frames but has 20" in reading.notes[0]
    assert reading.motion.num_frames == 10
    assert read(tmp_path, text_of(fps=60.0), "rate=30").motion.num_frames == 20


TEXT = text_of()
ROW = TEXT.splitlines().index("MOTION") + 4
"""The first row's line, from 1."""


def changed_row(number: int, change: Callable[[str], str]) -> str:
    lines = TEXT.splitlines()
    lines[ROW - 1 + number] = change(lines[ROW - 1 + number])
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TEXT.replace("\n", "\r\n"), ""),
        (TEXT.replace("Frame Time", "\n frame time"), ""),
        (TEXT.replace("Frames: ", "frames:\t"), ""),
        ("\xef\xbb\xbf" + TEXT, ""),
        (TEXT.replace("head", "K\xf6pf Head"), ""),
        (changed_row(3, lambda row: row.replace(".", ",")), "decimal commas"),
        (changed_row(4, lambda row: row.replace(" -", "-")), "without a space between them"),
        (changed_row(19, lambda row: row[: len(row) // 2]), "row 20 of 20 is cut"),
        (" ".join(TEXT.split("MOTION")[0].split()) + "\nMOTION" + TEXT.split("MOTION")[1], ""),
    ],
)
def test_text_is_read_where_nothing_is_lost(tmp_path: Path, text: str, said: str):
    reading = read(tmp_path, text)
    frames = 19 if "is cut" in said else 20
    found = joints_of(reading.motion)[:, BODY_JOINTS]
    np.testing.assert_allclose(found, WANTED[:frames, BODY_JOINTS], atol=2e-3)
    assert said in " ".join(reading.notes)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "line 1, there is no MOTION"),
        ("BIERARCHY", "line 1, it does not begin with HIERARCHY"),
        ("HIERARCHY\nROOT a\n{\nMOTION\n", "no joint has channels"),
        ("HIERARCHY\nROOT a\n{\nCHANNELS 9 x", "cannot have '9' channels"),
        ("HIERARCHY\nROOT a\n{\nCHANNELS 1 Wposition", "not channels: wposition"),
        ("HIERARCHY\nROOT a {\nBONE", "'BONE' is none of"),
        ("HIERARCHY\n}", "a } has no {"),
        (TEXT.replace("Frames: 20", "Frames: many"), "'Frames: N' is expected; found"),
        (TEXT.replace("Frame Time: 0.03333333", "Frame Time: 0"), "cannot last 0 s"),
        (TEXT.replace("{", "{\nCHANNELS 1 Xrotation", 3), "line 6, a joint has CHANNELS twice"),
        (TEXT.replace("OFFSET 0", "OFFSET 9000000", 1), "an offset must be under 1e+06"),
        (
            changed_row(2, lambda row: "1e300 " + row.split(" ", 1)[1]),
            "1e+300; the limit is 1e+06",
        ),
        (changed_row(2, lambda row: row + " 7"), f"line {ROW + 2}, a row has 70 numbers"),
        (changed_row(2, lambda row: row[:90]), f"line {ROW + 2}, a row has"),
        (changed_row(2, lambda row: "x" + row), "is not a number"),
        (changed_row(2, lambda row: "nan " + row.split(" ", 1)[1]), "not finite in frames 2"),
        (TEXT.replace("\nMOTION", "\nMOVES"), "'MOVES' is none of"),
        ("HIERARCHY\n" + "ROOT a {\n" * 500, "it exceeds the limit of 400 joints"),
    ],
)
def test_text_that_is_none_is_refused_with_line_and_reason(tmp_path: Path, text: str, said: str):
    with pytest.raises(MotionError) as caught:
        read(tmp_path, text)
    assert said in str(caught.value)


UPPER = [joint for joint in BODY_JOINTS if joint not in (1, 2, 4, 5, 7, 8, 10, 11)]


def test_trees_that_are_no_person_are_refused(tmp_path: Path):
    with pytest.raises(MotionError, match="no joint of its trunk has two arms"):
        read(tmp_path, text_of([0, 3, 6, 9, 12, 15]))
    arm = [0, 3, 6, 9, 13, 16, 18, 20, *HANDS[:15]]
    with pytest.raises(MotionError, match="no joint has two legs and a trunk"):
        read(tmp_path, text_of(arm))
    lines = [
        "OFFSET 0 0.4 0" if line.startswith("OFFSET") and "-0.3" in line else line
        for line in TEXT.splitlines()
    ]
    with pytest.raises(MotionError, match=r"legs are not below the trunk.* Put a T-pose"):
        read(tmp_path, "\n".join(lines))


@pytest.mark.parametrize("joints", [BODY_JOINTS, UPPER])
@pytest.mark.parametrize("is_along_x", [True, False])
def test_without_legs_or_a_rest_pose_it_is_read_and_told_as_unsure(
    tmp_path: Path, joints: list[int], is_along_x: bool
):
    """Bones rest along x as many rigs have them; limbs are where they are, but for their twist."""
    if joints == BODY_JOINTS and not is_along_x:
        return
    reading = read(tmp_path, text_of(joints, is_along_x=is_along_x))
    found, wanted = (each[:, joints] for each in (joints_of(reading.motion), WANTED))
    np.testing.assert_allclose(found, wanted, atol=0.02 if is_along_x else 2e-3)
    assert ("legs" in reading.missing_parts) == (joints == UPPER)
    unsure = {each.kind for each in reading.assumptions if each.confidence == "unsure"}
    assert unsure >= ({"layout"} if is_along_x else {"up", "facing"})


def test_twist_joints_within_a_limb_are_part_of_its_bones(tmp_path: Path):
    """As GENEA's skeleton has them, each with half of the bone's length."""
    lines, text = text_of().splitlines(), []
    depth = 0
    for line in lines[: lines.index("MOTION")]:
        if line == "JOINT left_elbow":
            text += ["JOINT left_arm_twist", "{", "OFFSET 0.1 0 0", "CHANNELS 0"]
            depth = 1
        text.append(line)
        if depth:
            depth += (line == "{") - (line == "}")
            if depth == 1 and line == "}":
                text.append("}")
                depth = 0
    moved = [
        "OFFSET 0.14 0 0" if text[at - 2] == "JOINT left_elbow" else line
        for at, line in enumerate(text)
    ]
    rows = lines[lines.index("MOTION") :]
    reading = read(tmp_path, "\n".join([*moved, *rows]))
    plain = read(tmp_path, text_of())
    joints = [JOINT_INDEX["left_shoulder"], JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]
    turns = [
        Rotation.from_rotvec(each.motion.poses.reshape(-1, 55, 3)[:, joints].reshape(-1, 3))
        for each in (reading, plain)
    ]
    assert reading.assumption_of("joints") is not None
    assert np.degrees((turns[0].inv() * turns[1]).magnitude()).max() < 25  # another rest pose
