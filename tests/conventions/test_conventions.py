"""What all rooms agree on: the joints of SMPL-X, and how samples and their files are named."""

import os

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from conventions import joints
from conventions.humanoid import JointTree
from conventions.names import COMPARISON, SampleName, safe_file_stem

HOSTILE = st.sampled_from("./\\ \0\n\x1b\u202e\udc80~a\u00e9\U0001f600")
SMPLX_PARENTS = (
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15,
    20, 25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35, 20, 37, 38,
    21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
)  # fmt: skip


def test_parents_are_those_of_smplx():
    assert joints.PARENTS == SMPLX_PARENTS
    assert joints.NUM_JOINTS == 55


def test_named_joints_stand_where_smplx_has_them():
    expected = {"pelvis": 0, "left_hip": 1, "head": 15, "right_wrist": 21, "jaw": 22,
                "right_eye": 24, "left_index1": 25, "left_thumb3": 39, "right_index1": 40,
                "right_middle3": 45, "right_ring3": 51, "right_thumb3": 54}  # fmt: skip
    assert {name: joints.JOINT_INDEX[name] for name in expected} == expected


def test_chain_and_depth_of_the_middle_fingertip():
    assert joints.chain_to_root(45) == (45, 44, 43, 21, 19, 17, 14, 9, 6, 3, 0)
    assert joints.JOINT_DEPTH[45] == 10
    assert joints.JOINT_DEPTH[0] == 0
    assert max(joints.JOINT_DEPTH) == 10


def test_groups_divide_the_joints():
    assert joints.LEFT_HAND == tuple(range(25, 40))
    assert joints.RIGHT_HAND == tuple(range(40, 55))
    assert joints.UPPER_BODY == (3, 6, 9, *range(12, 22))
    assert joints.LOWER_BODY == (0, 1, 2, 4, 5, 7, 8, 10, 11)
    groups = joints.HANDS + joints.UPPER_BODY + joints.LOWER_BODY + joints.FACE
    assert sorted(groups) == list(range(55))


def test_mirror_pairs_have_mirrored_parents():
    mirror = joints.MIRROR_PERMUTATION
    assert [mirror[mirror[joint]] for joint in range(55)] == list(range(55))
    assert [joint for joint in range(55) if mirror[joint] == joint] == [0, 3, 6, 9, 12, 15, 22]
    for joint in range(1, 55):
        assert joints.PARENTS[mirror[joint]] == mirror[joints.PARENTS[joint]]


def test_fingertips_belong_to_the_last_joints_of_their_fingers():
    assert joints.FINGERTIP_NAMES[6] == "right_middle"
    assert joints.FINGERTIP_JOINTS[6] == 45


@pytest.mark.parametrize(
    ("name", "system", "number"),
    [
        ("globaldiff/full", "globaldiff/full", 1),
        ("globaldiff/full.s2", "globaldiff/full", 2),
        ("a.s2.s10", "a.s2", 10),
        ("reference", "reference", 1),
    ],
)
def test_a_sample_is_named_by_its_system_and_number(name, system, number):
    assert SampleName.parse(name) == SampleName(system, number)
    assert str(SampleName(system, number)) == name


@pytest.mark.parametrize("name", ["a.s1", "a.s0", "a.s02", ".s2", "a.s", "a.s2 ", "a.s\u0662"])
def test_what_no_later_sample_is_called_is_a_name_as_it_stands(name):
    assert SampleName.parse(name) == SampleName(name)
    assert safe_file_stem("globaldiff/local") == "globaldiff-local"


def test_a_path_of_joints_begins_at_an_ancestor():
    tree = JointTree("a.bvh", ("Hips", "LeftLeg", "RightLeg"), (-1, 0, 0), np.zeros((3, 3)))
    assert tree.path_from_ancestor(0, 2) == [0, 2] and tree.path_from_ancestor(1, 1) == [1]
    with pytest.raises(ValueError, match="Joint 1 is not an ancestor of joint 2"):
        tree.path_from_ancestor(1, 2)


@given(st.text(HOSTILE, max_size=300) | st.text())
@example("..")
@example(".")
@example("a" * 500)
def test_a_file_stem_stays_in_its_folder_whatever_the_name(name):
    stem = safe_file_stem(name)
    assert stem not in ("", COMPARISON) and stem.isprintable() and len(stem.encode()) <= 220
    assert not stem.startswith(".") and not set(stem) & set("/\\") and stem == stem.rstrip(" .")
    assert os.path.normpath(f"/out/{stem}") == f"/out/{stem}"
    assert safe_file_stem(stem) == stem, "or names that were cleaned before would change"
