"""BVH: any tree of a person, its text read as far as nothing is lost, and our own files back."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.run.bodies import body_motion
from conventions.joints import HANDS, JOINT_INDEX, JOINT_NAMES
from model.formats.read import read_any_motion, read_told
from model.storage.npz import MotionError
from renderer.body.body import load_body
from renderer.files.exports import write_bvh
from tests.model.formats.made import BODY_JOINTS, Person, bvh_text, joints_of

MOTION = Person(7).motion(20)
WANTED = joints_of(MOTION)
WHOLE = [*BODY_JOINTS, *HANDS]


def text_of(joints: list[int] = BODY_JOINTS, names=(), scale: float = 1.0, **more) -> str:
    names = list(names) or [JOINT_NAMES[joint] for joint in joints]
    return bvh_text(MOTION, joints, Rotation.identity(), scale, names, **more)


def read(folder: Path, text: str, assume: str = ""):
    path = folder / "a.bvh"
    path.write_bytes(text.encode("latin-1"))
    return read_any_motion(path, read_told(assume))


def test_our_own_bvh_comes_back(tmp_path: Path):
    path = tmp_path / "own.bvh"
    write_bvh(load_body(), body_motion(MOTION), path)
    reading = read_any_motion(path)
    np.testing.assert_allclose(joints_of(reading.motion), WANTED, atol=2e-3)
    assert reading.notes == ()


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
    told = read(tmp_path, text_of(WHOLE, names)).of("joints")
    assert told is not None and "; 10 have no place, " in told.why


def test_lengths_are_told_otherwise(tmp_path: Path):
    half = read(tmp_path, text_of(scale=50.0), "units=cm").motion
    np.testing.assert_allclose(joints_of(half)[:, 0], WANTED[:, 0] / 2, atol=1e-3)


def test_a_row_less_than_stated_is_told_and_rates_are_stated_or_told(tmp_path: Path):
    reading = read(tmp_path, text_of(fps=60.0).replace("Frames: 20", "Frames: 21"))
    assert "says 21 frames and holds 20" in reading.notes[0]
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
        (changed_row(4, lambda row: row.replace(" -", "-")), "ran together"),
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
        ("HIERARCHY\nROOT a\n{\nCHANNELS 1 Wposition", "no channels: wposition"),
        ("HIERARCHY\nROOT a {\nBONE", "'BONE' is none of"),
        ("HIERARCHY\n}", "a } has no {"),
        (TEXT.replace("Frames: 20", "Frames: many"), "'Frames: N' is expected; found"),
        (TEXT.replace("Frame Time: 0.03333333", "Frame Time: 0"), "cannot last 0 s"),
        (changed_row(2, lambda row: row + " 7"), f"line {ROW + 2}, a row of 70 numbers"),
        (changed_row(2, lambda row: row[:90]), f"line {ROW + 2}, a row of"),
        (changed_row(2, lambda row: "x" + row), "is no number"),
        (changed_row(2, lambda row: "nan " + row.split(" ", 1)[1]), "not finite in frames 2"),
        (TEXT.replace("\nMOTION", "\nMOVES"), "'MOVES' is none of"),
        ("HIERARCHY\n" + "ROOT a {\n" * 500, "over 400 joints"),
    ],
)
def test_text_that_is_none_is_refused_with_line_and_reason(tmp_path: Path, text: str, said: str):
    with pytest.raises(MotionError) as caught:
        read(tmp_path, text)
    assert said in str(caught.value)


UPPER = [joint for joint in BODY_JOINTS if joint not in (1, 2, 4, 5, 7, 8, 10, 11)]


def test_trees_that_are_no_person_are_refused(tmp_path: Path):
    with pytest.raises(MotionError, match="no trunk from which two arms go"):
        read(tmp_path, text_of([0, 3, 6, 9, 12, 15]))
    arm = [0, 3, 6, 9, 13, 16, 18, 20, *HANDS[:15]]
    with pytest.raises(MotionError, match="no joint from which two legs and a trunk go"):
        read(tmp_path, text_of(arm))
    lines = [
        "OFFSET 0 0.4 0" if line.startswith("OFFSET") and "-0.3" in line else line
        for line in TEXT.splitlines()
    ]
    with pytest.raises(MotionError, match=r"do legs hang below the trunk.* put a T-pose"):
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
    assert ("legs" in reading.lacks) == (joints == UPPER)
    unsure = {each.kind for each in reading.assumptions if each.sure == "unsure"}
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
    assert reading.of("joints") is not None
    assert np.degrees((turns[0].inv() * turns[1]).magnitude()).max() < 25  # another rest pose
