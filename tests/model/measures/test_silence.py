import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.measures.hearing import speed_in_silence, spoken_and_silent
from model.motion.motion import Motion

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
    rng = np.random.default_rng(end)
    speech = rng.random(200) < 0.3
    parts = [np.zeros(40), speech, np.zeros(LONG + 20), speech, np.zeros(LONG - 30), speech]
    voiced = np.concatenate([*parts, np.zeros(end)]).astype(bool)
    spoken, silent = spoken_and_silent(voiced)
    wanted = slowly(voiced.tolist())
    assert spoken.tolist() == [kind == "spoken" for kind in wanted]
    assert silent.tolist() == [kind == "silent" for kind in wanted]


def moving(speeds: np.ndarray, joint: str) -> Motion:
    """One joint that turns so many degrees into each frame."""
    frames = len(speeds)
    poses = np.zeros((frames, 165), np.float32)
    poses[:, 3 * JOINT_INDEX[joint]] = np.deg2rad(np.cumsum(speeds))
    return Motion(
        poses,
        np.zeros((frames, 3), np.float32),
        np.zeros((frames, 100), np.float32),
        "arkit52",
        np.zeros(300, np.float32),
    )


@pytest.mark.parametrize(("joint", "part"), [("left_elbow", "arms"), ("jaw", "jaw")])
def test_speeds_are_those_of_the_silence_over_those_of_speaking(joint, part):
    voiced = np.zeros(400, bool)
    voiced[20:200] = True
    speeds = np.where(voiced, 0.2, 7.0)  # before the speech, and long after it, is not looked at
    speeds[200 : 200 + LONG] = 0.05
    found = speed_in_silence(moving(speeds, joint), voiced)
    assert set(found) == {f"{part}_in_silence"}
    assert found[f"{part}_in_silence"] == pytest.approx(0.25, rel=1e-3)


def test_without_a_silence_nothing_is_told():
    voiced = np.ones(300, bool)
    assert speed_in_silence(moving(np.full(300, 0.2), "jaw"), voiced) == {}
    voiced[200:] = False  # 3 s: a pause
    assert speed_in_silence(moving(np.full(300, 0.2), "jaw"), voiced) == {}
    assert speed_in_silence(moving(np.full(300, 0.2), "jaw"), np.zeros(300, bool)) == {}
