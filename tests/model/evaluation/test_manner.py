from itertools import combinations

import numpy as np
import pytest

from model.evaluation.speakers import calm_over_lively, manner_of, wrist_speed_m_s
from model.measures.hearing import arm_speed
from model.motion.motion import Motion
from tests.model.measures.test_hearing import FRAMES, motion_of

SPEAKERS = {"june": 1, "hana": 2, "gus": 3}


def moved(share: float) -> dict:
    """By speaker and noise seed; the speaker decides ``share`` of the speed's variance."""
    return {
        (name, seed): motion_of(number, seed, share)
        for name, number in SPEAKERS.items()
        for seed in range(3)
    }


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_the_share_of_the_speaker_is_that_of_every_pair_one_by_one(share):
    motions = moved(share)
    alike: dict[str, list[float]] = {"speaker": [], "neither": []}
    for ((one, seed), a), ((other, seed_), b) in combinations(motions.items(), 2):
        if seed != seed_:
            r = float(np.corrcoef(arm_speed(a), arm_speed(b))[0, 1])
            alike["speaker" if one == other else "neither"].append(r)
    found = manner_of(motions)
    wanted = np.mean(alike["speaker"]) - np.mean(alike["neither"])
    assert found.by_speaker == pytest.approx(wanted, abs=1e-6)
    assert found.by_speaker == pytest.approx(share, abs=0.25)


def test_rotations_of_the_same_noise_are_alike_whoever_speaks():
    same = {(name, seed): motion_of(7, seed, 0.0) for name in SPEAKERS for seed in range(2)}
    assert manner_of(same).arm_rotations_same_noise == pytest.approx(1 / 12, abs=1e-6)


def swinging(speed: float) -> Motion:
    """The left upper arm turns at a steady speed, radians a second."""
    motion = motion_of(0, 0, 0.5)
    poses = np.zeros_like(motion.poses)
    poses[:, 3 * 16 + 2] = speed * np.arange(FRAMES) / 30
    return Motion(poses, motion.trans, motion.expressions, "arkit52", motion.betas)


def test_a_calm_speaker_moves_the_wrists_so_much_less():
    calm, lively = swinging(0.25), swinging(0.5)
    assert calm_over_lively([calm], [lively]) == pytest.approx(0.5, rel=1e-3)
    assert calm_over_lively([calm, lively], [lively]) == pytest.approx(0.75, rel=1e-3)
    arm = wrist_speed_m_s(lively) / 0.5
    assert 0.4 < arm < 0.65, "metres from shoulder to wrist"
