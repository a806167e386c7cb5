"""What the speech decides of a motion, and what is done in silence."""

from dataclasses import replace

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.metrics.speech_effect import (
    LEAST_FRAMES,
    TRACK_FUNCTIONS,
    arm_axis_angle_correlation,
    silence_speed_ratio,
    smoothed_arm_speed_sum_deg_s,
    speech_and_noise_shares,
    speech_and_silence_start_masks,
    track_correlation,
)
from model.motion.kinematics import blendshape_names
from model.motion.motion import Motion
from tests.model.motion.made import about, posed

FRAMES = 600


def slow(rng: np.random.Generator, count: int = FRAMES) -> np.ndarray:
    """A signal of one to two turns a second, unit spread."""
    noise = np.convolve(rng.normal(size=count + 40), np.hanning(41), "valid")[:count]
    return noise / noise.std()


def motion_of(speech: int, noise: int, share: float, arm: str = "left_elbow") -> Motion:
    """Arm, brow and jaw of which the speech decides ``share`` of the variance, noise the rest."""
    heard, drawn = slow(np.random.default_rng(speech)), slow(np.random.default_rng(1000 + noise))
    mixed = np.sqrt(share) * heard + np.sqrt(1 - share) * drawn
    turned = np.cumsum(np.clip(4 + mixed, 0.1, None)) / 300
    units = np.zeros((FRAMES, 100), np.float32)
    units[:, blendshape_names().index("browInnerUp")] = 0.5 + 0.1 * mixed
    jaw = about(0, 0.3 + 0.05 * mixed)
    return posed(FRAMES, units=units, jaw=jaw, head=about(1, turned), **{arm: about(0, turned)})


def grid(share: float) -> dict:
    return {(str(k), n): motion_of(k, n, share) for k in range(5) for n in range(4)}


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_shares_are_those_that_were_planted(share):
    found = speech_and_noise_shares(grid(share))
    assert set(found) == set(TRACK_FUNCTIONS)
    for part, told in found.items():
        assert told.by_speech == pytest.approx(share, abs=0.12), part
        assert told.by_noise == pytest.approx(1 - share, abs=0.12), part
        assert abs(told.neither) < 0.15


def test_arm_speed_is_in_degrees_a_second_whichever_arm_turns():
    turning = about(2, np.deg2rad(np.arange(90)))  # 30 degrees a second
    motion = posed(90, left_shoulder=turning, right_elbow=turning)
    np.testing.assert_allclose(smoothed_arm_speed_sum_deg_s(motion), 60.0, rtol=1e-3)


def test_likeness_is_the_correlation_of_what_both_have_and_0_of_what_is_still():
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=200), rng.normal(size=120)
    assert track_correlation(one, other) == pytest.approx(np.corrcoef(one[:120], other)[0, 1])
    assert track_correlation(one, np.ones(200)) == 0.0


def test_rotations_of_arms_alone_are_compared():
    one, other = motion_of(1, 2, 0.5), motion_of(1, 2, 0.5)
    other.poses[:, 3 * JOINT_INDEX["head"]] += slow(np.random.default_rng(5))
    assert arm_axis_angle_correlation(one, other) == pytest.approx(1 / 12, abs=1e-6)  # 11 are still


def test_a_motion_in_other_units_has_no_brows():
    flame = {key: replace(m, expression_basis="flame100") for key, m in grid(0.5).items()}
    assert set(speech_and_noise_shares(flame)) == set(TRACK_FUNCTIONS) - {"brows"}


def test_what_cannot_be_compared_is_refused():
    motions = grid(0.5)
    one_less = {key: m for key, m in motions.items() if key != ("0", 0)}
    for missing in (
        {key: m for key, m in motions.items() if key[0] == "0"},
        {key: m for key, m in motions.items() if key[1] == 0},
        one_less,
    ):
        with pytest.raises(ValueError, match="two noise seeds"):
            speech_and_noise_shares(missing)
    for frames in (LEAST_FRAMES, LEAST_FRAMES - 1):
        short = motions | {("0", 0): motions["0", 0].part(slice(frames))}
        if frames == LEAST_FRAMES:
            speech_and_noise_shares(short)
            continue
        with pytest.raises(ValueError, match="3 s"):
            speech_and_noise_shares(short)


LONG = 150
"""Frames of a silence."""


def slowly(voiced: list[bool]) -> list[str]:
    """What each frame is, one after the other."""
    told = []
    for k in range(len(voiced)):
        before = [j for j in range(k + 1) if voiced[j]]
        after = [j for j in range(k, len(voiced)) if voiced[j]]
        if not before:
            told.append("")
            continue
        gap = (after[0] if after else len(voiced)) - before[-1] - 1
        if voiced[k]:
            told.append("spoken")
        elif gap >= LONG:
            told.append("silent" if k - before[-1] <= LONG else "")
        else:
            told.append("spoken" if after else "")
    return told


@pytest.mark.parametrize("end", [0, 30, 149, 150, 200])
def test_frames_are_told_as_one_by_one(end):
    speech = np.random.default_rng(end).random(200) < 0.3
    parts = [np.zeros(40), speech, np.zeros(LONG + 20), speech, np.zeros(LONG - 30), speech]
    voiced = np.concatenate([*parts, np.zeros(end)]).astype(bool)
    spoken, silent = speech_and_silence_start_masks(voiced)
    wanted = slowly(voiced.tolist())
    assert spoken.tolist() == [kind == "spoken" for kind in wanted]
    assert silent.tolist() == [kind == "silent" for kind in wanted]


@pytest.mark.parametrize(("joint", "part"), [("left_elbow", "arms"), ("jaw", "jaw")])
def test_speeds_are_those_of_the_silence_over_those_of_speaking(joint, part):
    voiced = np.zeros(400, bool)
    voiced[20:200] = True
    speeds = np.where(voiced, 0.2, 7.0)  # before the speech, and long after it, is not looked at
    speeds[200 : 200 + LONG] = 0.05
    motion = posed(400, **{joint: about(0, np.deg2rad(np.cumsum(speeds)))})
    assert silence_speed_ratio(motion, voiced) == {
        f"{part}_in_silence": pytest.approx(0.25, rel=1e-3)
    }
    voiced[:] = True
    assert silence_speed_ratio(motion, voiced) == {}
    voiced[300:] = False  # 3 s: a pause
    assert silence_speed_ratio(motion, voiced) == {}
    assert silence_speed_ratio(motion, np.zeros(400, bool)) == {}
