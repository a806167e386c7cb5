import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.measures.hearing import (
    LEAST_FRAMES,
    TRACKS,
    arm_rotations_alike,
    arm_speed,
    decided,
    likeness,
)
from model.motion.kinematics import face_unit_names
from model.motion.motion import Motion

FRAMES = 600


def slow(rng: np.random.Generator, count: int = FRAMES) -> np.ndarray:
    """A signal of one to two turns a second, unit spread."""
    noise = np.convolve(rng.normal(size=count + 40), np.hanning(41), "valid")[:count]
    return noise / noise.std()


def motion_of(speech: int, noise: int, share: float, arm: str = "left_elbow") -> Motion:
    """Arm, brow and jaw of which the speech decides ``share`` of the variance, noise the rest."""
    heard, drawn = slow(np.random.default_rng(speech)), slow(np.random.default_rng(1000 + noise))
    mixed = np.sqrt(share) * heard + np.sqrt(1 - share) * drawn
    poses = np.zeros((FRAMES, 165), np.float32)
    poses[:, 3 * JOINT_INDEX[arm]] = np.cumsum(np.clip(4 + mixed, 0.1, None)) / 300
    poses[:, 3 * JOINT_INDEX["jaw"]] = 0.3 + 0.05 * mixed
    poses[:, 3 * JOINT_INDEX["head"] + 1] = np.cumsum(np.clip(4 + mixed, 0.1, None)) / 300
    units = np.zeros((FRAMES, 100), np.float32)
    units[:, face_unit_names().index("browInnerUp")] = 0.5 + 0.1 * mixed
    return Motion(
        poses, np.zeros((FRAMES, 3), np.float32), units, "arkit52", np.zeros(300, np.float32)
    )


def grid(share: float) -> dict:
    return {(str(k), n): motion_of(k, n, share) for k in range(5) for n in range(4)}


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_shares_are_those_that_were_planted(share):
    found = decided(grid(share))
    assert set(found) == set(TRACKS)
    for part, told in found.items():
        assert told.by_speech == pytest.approx(share, abs=0.12), part
        assert told.by_noise == pytest.approx(1 - share, abs=0.12), part
        assert abs(told.neither) < 0.15


def test_arm_speed_is_in_degrees_a_second_whichever_arm_turns():
    turning = np.zeros((90, 165), np.float32)
    for joint in ("left_shoulder", "right_elbow"):
        turning[:, 3 * JOINT_INDEX[joint] + 2] = np.deg2rad(np.arange(90))  # 30 degrees a second
    still = np.zeros((90, 3), np.float32)
    motion = Motion(
        turning, still, np.zeros((90, 100), np.float32), "arkit52", np.zeros(300, np.float32)
    )
    np.testing.assert_allclose(arm_speed(motion), 60.0, rtol=1e-3)


def test_likeness_is_the_correlation_of_what_both_have_and_0_of_what_is_still():
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=200), rng.normal(size=120)
    assert likeness(one, other) == pytest.approx(np.corrcoef(one[:120], other)[0, 1])
    assert likeness(one, np.ones(200)) == 0.0


def test_rotations_of_arms_alone_are_compared():
    one, other = motion_of(1, 2, 0.5), motion_of(1, 2, 0.5)
    other.poses[:, 3 * JOINT_INDEX["head"]] += slow(np.random.default_rng(5))
    assert arm_rotations_alike(one, other) == pytest.approx(1 / 12, abs=1e-6)  # 11 are still


def test_a_motion_in_other_units_has_no_brows():
    flame = {
        key: Motion(m.poses, m.trans, m.expressions, "flame100", m.betas)
        for key, m in grid(0.5).items()
    }
    assert set(decided(flame)) == set(TRACKS) - {"brows"}


@pytest.mark.parametrize("missing", ["speech", "seed", "one", "short"])
def test_what_cannot_be_compared_is_refused(missing):
    motions = grid(0.5)
    match missing:
        case "speech":
            motions = {key: m for key, m in motions.items() if key[0] == "0"}
        case "seed":
            motions = {key: m for key, m in motions.items() if key[1] == 0}
        case "one":
            del motions["0", 0]
        case "short":
            m = motions["0", 0]
            cut = slice(LEAST_FRAMES - 1)
            motions["0", 0] = Motion(
                m.poses[cut], m.trans[cut], m.expressions[cut], "arkit52", m.betas
            )
    with pytest.raises(ValueError, match="3 s" if missing == "short" else "two noise seeds"):
        decided(motions)
