"""The hand shapes, gestures and speakers agree with each other."""

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from tools.corpus.gesture.gestures import (
    FLEX,
    GENERIC,
    GESTURES,
    KEYWORDS,
    ONLY_WHEN_STRESSED,
    REST,
    SHAPES,
    HandPose,
    finger_rotations,
)
from tools.corpus.gesture.manner import BEAT_SHAPES, IDLE_SHAPES
from tools.corpus.people.rig import SIDES
from tools.corpus.people.speaker import SPEAKERS


def test_there_are_at_least_25_hand_shapes_apart_from_each_other() -> None:
    shapes = np.stack(list(SHAPES.values()))
    assert len(shapes) >= 25
    gaps = np.linalg.norm(shapes[:, None] - shapes[None], axis=-1)
    assert gaps[~np.eye(len(shapes), dtype=bool)].min() > 8.0


def test_all_names_exist() -> None:
    for gesture in GESTURES.values():
        assert set(gesture.shapes) <= set(SHAPES)
    assert {name for names in KEYWORDS.values() for name in names} <= set(GESTURES)
    assert set(GENERIC) <= set(GESTURES)
    assert set(ONLY_WHEN_STRESSED) <= set(GESTURES)
    assert {*IDLE_SHAPES, *BEAT_SHAPES} <= set(SHAPES)
    for speaker in SPEAKERS:
        assert speaker.beat_shape in SHAPES
        assert set(speaker.favourites) <= set(GENERIC)
        assert speaker.idle_shape in SHAPES
        assert {speaker.ready, *(speaker.rest_of(side) for side in SIDES)} <= set(REST)


def test_speaker_numbers_fit_the_table_and_names_are_unique() -> None:
    numbers = [s.number for s in SPEAKERS]
    assert len(SPEAKERS) >= 12
    assert len(set(numbers)) == len(numbers)
    assert set(numbers) <= set(range(1, 31))
    assert len({s.name for s in SPEAKERS}) == len(SPEAKERS)
    assert sum(s.held_out for s in SPEAKERS) == 2


@pytest.mark.parametrize("name", GESTURES)
def test_a_gesture_lies_in_front_within_reach(name: str) -> None:
    gesture = GESTURES[name]
    for pose in (gesture.prepare, gesture.stroke, *(pose for _, pose in gesture.via)):
        assert isinstance(pose, HandPose)
        out, up, forward = pose.position
        assert 0.04 < out < 0.40
        assert -0.40 < up < 0.30
        assert 0.05 < forward < 0.43
        assert abs(pose.flex_deg) < 60


def test_the_hands_are_mirror_images() -> None:
    curves = np.stack(list(SHAPES.values()))
    twist = np.zeros((len(curves), 12))
    left, right = (finger_rotations(side, curves, twist) for side in ("left", "right"))
    mirror = np.diag([-1.0, 1.0, 1.0])
    for finger in ("index", "middle", "ring", "pinky", "thumb"):
        for k in (1, 2, 3):
            a, b = left[JOINT_INDEX[f"left_{finger}{k}"]], right[JOINT_INDEX[f"right_{finger}{k}"]]
            np.testing.assert_allclose(mirror @ a @ mirror, b, atol=1e-9)


def test_flexing_bends_a_right_finger_towards_the_palm_and_never_backwards() -> None:
    curves = np.zeros((2, 19))
    curves[0, FLEX], curves[1, FLEX] = 60.0, -60.0
    rotations = finger_rotations("right", curves, np.zeros((2, 12)))
    # The right hand's fingers point to -x at rest and its palm down.
    tips = rotations[JOINT_INDEX["right_middle2"]] @ np.array([-1.0, 0.0, 0.0])
    assert tips[0, 1] < -0.8
    assert abs(tips[1, 1]) < 0.02
