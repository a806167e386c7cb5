"""Degrees between two motions, by part of the body."""

import re
from dataclasses import replace

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX, JOINT_NAMES
from model.measures.differences import PARTS, degrees_by_part
from tests.helpers import ROOT, smooth_motion_example


def test_a_turned_joint_counts_for_its_part_alone() -> None:
    """An elbow at rest, turned by .3 rad in the second half of the frames that both have: .15 on
    average, shared among the arm's four joints."""
    first = smooth_motion_example(90)
    poses = first.poses.copy().reshape(90, 55, 3)
    poses[:, JOINT_INDEX["right_elbow"]] = 0
    first = replace(first, poses=poses.reshape(90, 165))
    turned = poses.copy()
    turned[30:, JOINT_INDEX["right_elbow"], 1] = 0.3
    second = replace(first, poses=turned.reshape(90, 165)).part(slice(60))
    found = degrees_by_part(first, second)
    assert next(iter(found)) == "right arm"
    assert found["right arm"] == pytest.approx(np.rad2deg(0.15) / 4, rel=1e-3)
    assert max(value for part, value in found.items() if part != "right arm") < 0.01


def test_parts_are_those_of_the_page_and_leave_the_face_alone() -> None:
    script = (ROOT / "app" / "page" / "web" / "stage" / "difference.js").read_text()
    table = script[script.index("const PARTS") : script.index("};", script.index("const PARTS"))]
    assert [name.strip('"') for name in re.findall(r'^  ("[a-z ]+"|\w+):', table, re.M)] == list(
        PARTS
    )
    left = [n for n in JOINT_NAMES if not any(re.match(begin, n) for begin in PARTS.values())]
    assert left == ["jaw", "left_eye_smplhf", "right_eye_smplhf"] or left == [
        "jaw",
        "left_eye",
        "right_eye",
    ]
