from dataclasses import replace

import numpy as np
import pytest

from model.measures.face import count_blinks, face_measures, unit_columns
from tests.helpers import smooth_motion_example


def test_a_blink_is_one_closing_however_the_lid_trembles():
    lids = np.array([0, 0.2, 0.6, 0.45, 0.55, 0.9, 0.6, 0.2, 0.1, 0.4, 0.1, 0.7, 0.2])
    assert count_blinks(lids) == 2
    assert count_blinks(np.full(30, 0.9)) == 1  # closed from the start: it closed once
    assert count_blinks(np.full(30, 0.45)) == 0


def test_units_are_found_on_both_sides():
    assert len(unit_columns("eyeBlink")) == len(unit_columns("browDown")) == 2
    assert len(unit_columns("browInnerUp")) == 1
    assert set(unit_columns("eyeBlink")) != set(unit_columns("browDown"))


def test_a_face_is_measured_against_its_voice():
    motion = smooth_motion_example(300, 0)
    expressions = np.zeros((300, 100), np.float32)
    for start in (30, 120, 210):
        expressions[start : start + 4, unit_columns("eyeBlink")] = 1.0
    expressions[::2, unit_columns("browInnerUp")] = 0.4
    poses = motion.poses.copy()
    loudness = np.sin(np.arange(300) / 7.0)
    poses[:, 66:69] = 0
    poses[:, 66] = 0.1 + 0.05 * loudness  # the jaw
    living = replace(motion, poses=poses, expressions=expressions, expression_basis="arkit52")
    found = face_measures(living, loudness)
    assert found["blinks_per_min"] == pytest.approx(18.0)
    assert found["brow_std"] == pytest.approx(0.2)
    assert found["jaw_loudness"] == pytest.approx(1.0)
    assert face_measures(living, -loudness)["jaw_loudness"] == pytest.approx(-1.0)
    still = replace(living, poses=np.zeros_like(poses), expression_basis="flame100")
    assert face_measures(still, loudness) == {"jaw_loudness": 0.0}
