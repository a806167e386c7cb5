import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.measures.face import face_and_hands, head_speed, lagged_correlation, unit_columns
from model.motion.motion import Motion


def made(brow: np.ndarray, nod: np.ndarray) -> Motion:
    """A face whose brow and head follow these tracks."""
    frames = len(brow)
    poses = np.zeros((frames, 165), np.float32)
    poses[:, 3 * JOINT_INDEX["head"]] = nod
    units = np.zeros((frames, 100), np.float32)
    units[:, unit_columns("browInnerUp")] = brow[:, None]
    return Motion(poses=poses, trans=np.zeros((frames, 3), np.float32), expressions=units,
                  expression_basis="arkit52", betas=np.zeros(300, np.float32))  # fmt: skip


def strokes(seed: int, frames: int = 900) -> np.ndarray:
    """Some bumps of a third of a second."""
    track = np.zeros(frames)
    for at in np.random.default_rng(seed).integers(0, frames - 10, 25):
        track[at : at + 10] += np.hanning(10)
    return track


def hands(speed: np.ndarray) -> np.ndarray:
    joints = np.zeros((len(speed), 55, 3))
    joints[:, JOINT_INDEX["right_wrist"], 0] = np.cumsum(speed) / 30
    return joints


def test_a_face_that_goes_with_the_hands_is_told_from_one_that_does_not():
    own, other = strokes(1), strokes(2)
    together = face_and_hands(made(own, np.cumsum(own) / 30), hands(own))
    apart = face_and_hands(made(other, np.cumsum(other) / 30), hands(own))
    for name in ("brow_with_hands", "head_with_hands"):
        assert together[name] > 0.5 > 0.3 > abs(apart[name])
    late = face_and_hands(made(np.roll(own, 10), np.cumsum(own) / 30), hands(own))
    assert late["brow_with_hands"] > 0.5


def test_a_still_face_has_nothing_to_do_with_the_hands():
    still = np.zeros(900)
    assert set(face_and_hands(made(still, still), hands(strokes(1))).values()) == {0.0}
    assert face_and_hands(made(still[:200], still[:200]), hands(strokes(1)[:200])) == {}


def test_the_heads_speed_is_in_radians_a_second():
    turning = np.arange(30) * 0.02
    assert head_speed(made(turning, turning)) == pytest.approx(np.full(29, 0.6), abs=1e-3)


def test_the_best_lag_is_found_on_either_side():
    track = strokes(3)
    for lag in (-12, 0, 12):
        assert lagged_correlation(np.roll(track, lag)[50:-50], track[50:-50]) > 0.9
