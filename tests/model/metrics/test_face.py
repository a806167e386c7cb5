"""Blinks, brows and jaws, and faces that go with the hands."""

from dataclasses import replace

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.metrics.face import (
    blendshape_columns,
    count_blinks,
    face_hand_correlation_above_chance,
    face_measures,
    head_chest_angular_speed_rad_s,
    max_correlation_over_lags,
)
from model.motion.motion import Motion
from tests.model.motion.made import about, along, posed


def test_a_blink_is_one_closing_however_the_lid_trembles():
    lids = np.array([0, 0.2, 0.6, 0.45, 0.55, 0.9, 0.6, 0.2, 0.1, 0.4, 0.1, 0.7, 0.2])
    assert count_blinks(lids) == 2
    assert count_blinks(np.full(30, 0.9)) == 1  # closed from the start: it closed once
    assert count_blinks(np.full(30, 0.45)) == 0


def units_of(num_frames: int, **tracks: np.ndarray) -> np.ndarray:
    units = np.zeros((num_frames, 100), np.float32)
    for name, track in tracks.items():
        units[:, blendshape_columns(name)] = track[:, None]
    return units


def test_a_face_is_measured_against_its_voice():
    assert len(blendshape_columns("eyeBlink")) == len(blendshape_columns("browDown")) == 2
    assert len(blendshape_columns("browInnerUp")) == 1
    lids = np.isin(np.arange(300) % 90, range(30, 34)).astype(float)  # three times in ten seconds
    brows = 0.4 * (np.arange(300) % 2 == 0)
    loudness = np.sin(np.arange(300) / 7.0)
    jaw = about(0, 0.1 + 0.05 * loudness)
    living = posed(300, units=units_of(300, eyeBlink=lids, browInnerUp=brows), jaw=jaw)
    found = face_measures(living, loudness)
    assert found["blinks_per_min"] == pytest.approx(18.0)
    assert found["brow_std"] == pytest.approx(0.2)
    assert found["jaw_loudness"] == pytest.approx(1.0)
    assert face_measures(living, -loudness)["jaw_loudness"] == pytest.approx(-1.0)
    still = replace(living, poses=np.zeros_like(living.poses), expression_basis="flame100")
    assert face_measures(still, loudness) == {"jaw_loudness": 0.0}


def made(brow: np.ndarray, nod: np.ndarray) -> Motion:
    """A face whose brow and head follow these tracks."""
    return posed(len(brow), units=units_of(len(brow), browInnerUp=brow), head=about(0, nod))


def strokes(seed: int, frames: int = 900) -> np.ndarray:
    """Some bumps of a third of a second."""
    track = np.zeros(frames)
    for at in np.random.default_rng(seed).integers(0, frames - 10, 25):
        track[at : at + 10] += np.hanning(10)
    return track


def hands(speed: np.ndarray) -> np.ndarray:
    joints = np.zeros((len(speed), 55, 3))
    joints[:, JOINT_INDEX["right_wrist"]] = along(0, np.cumsum(speed) / 30)
    return joints


def test_a_face_that_goes_with_the_hands_is_told_from_one_that_does_not():
    own, other, still = strokes(1), strokes(2), np.zeros(900)
    together = face_hand_correlation_above_chance(made(own, np.cumsum(own) / 30), hands(own))
    apart = face_hand_correlation_above_chance(made(other, np.cumsum(other) / 30), hands(own))
    for name in ("brow_with_hands", "head_with_hands"):
        assert together[name] > 0.5 > 0.3 > abs(apart[name])
    late = face_hand_correlation_above_chance(
        made(np.roll(own, 10), np.cumsum(own) / 30), hands(own)
    )
    assert late["brow_with_hands"] > 0.5
    assert set(face_hand_correlation_above_chance(made(still, still), hands(own)).values()) == {0.0}
    assert (
        face_hand_correlation_above_chance(made(still[:200], still[:200]), hands(own[:200])) == {}
    )
    for lag in (-12, 0, 12):  # frames, found on either side
        assert max_correlation_over_lags(np.roll(own, lag)[50:-50], own[50:-50]) > 0.9


def test_the_heads_speed_is_in_radians_a_second():
    turning = np.arange(30) * 0.02
    assert head_chest_angular_speed_rad_s(made(turning, turning)) == pytest.approx(
        np.full(29, 0.6), abs=1e-3
    )
