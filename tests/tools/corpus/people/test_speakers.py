"""The speakers are different people, by their styles alone, and nobody's habit is inhuman."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tools.corpus.gesture.gestures import FLEX, GENERIC, REST, SHAPES
from tools.corpus.gesture.manner import Manner
from tools.corpus.people.speaker import SPEAKERS, Speaker

PEOPLE = {s.name: s for s in SPEAKERS}


def habits(speaker: Speaker) -> np.ndarray:
    """What an onlooker could note down, each in units that one would just notice."""
    hand = {"left": 1.0, "right": -1.0}[speaker.dominant] * (speaker.dominance - 0.5)
    wait = [REST[speaker.rest_of(side)].position for side in ("left", "right")]
    shape = SHAPES[speaker.idle_shape][FLEX].mean() * speaker.finger_curl
    return np.concatenate(
        [
            np.array([speaker.outward_m, speaker.height_m, speaker.forward_m]) / 0.03,
            np.concatenate(wait) / 0.06,
            [hand / 0.4, speaker.two_hands / 0.3, shape / 12, speaker.amplitude / 0.2],
            [speaker.tempo / 0.15, speaker.energy / 0.25, speaker.rate / 0.2],
        ]
    )


@pytest.mark.parametrize(("a", "b"), list(combinations(sorted(PEOPLE), 2)))
def test_any_two_speakers_differ_in_several_habits(a: str, b: str) -> None:
    gap = habits(PEOPLE[a]) - habits(PEOPLE[b])
    assert np.linalg.norm(gap) > 2.5
    assert np.sum(np.abs(gap) > 0.5) >= 3


def test_no_two_speakers_prefer_the_same_gestures() -> None:
    tastes = [frozenset(s.favourites) for s in SPEAKERS]
    assert all(len(taste) >= 3 for taste in tastes)
    assert all(len(a & b) < min(len(a), len(b)) for a, b in combinations(tastes, 2))
    assert set().union(*tastes) <= set(GENERIC)


@pytest.mark.parametrize("speaker", SPEAKERS, ids=lambda s: s.name)
def test_habits_stay_human(speaker: Speaker) -> None:
    assert abs(speaker.outward_m) < 0.08
    assert abs(speaker.height_m) < 0.09
    assert abs(speaker.forward_m) < 0.06
    assert 0.55 <= speaker.amplitude <= 1.35
    assert 0.8 <= speaker.tempo <= 1.3
    assert 0.5 <= speaker.dominance <= 1.0


def test_a_habit_moves_the_poses_that_it_names() -> None:
    plain = replace(PEOPLE["anna"], outward_m=0.0, height_m=0.0, forward_m=0.0, wrist_deg=0.0)

    def drawn(speaker: Speaker):
        return Manner(speaker, np.random.default_rng(0)).settled(REST["ready"], 1.0)

    moved = drawn(replace(plain, outward_m=0.05, height_m=-0.04, forward_m=0.03))
    gap = moved.position - drawn(plain).position
    np.testing.assert_allclose(gap, [0.05, -0.04, 0.03], atol=1e-12)


def test_the_other_hand_waits_in_its_own_place() -> None:
    fay = PEOPLE["fay"]
    assert (fay.rest_of("right"), fay.rest_of("left")) == ("hip", "hang")
    assert {fay.waiting_of("right", chance) for chance in (0.1, 0.9)} == {"hip"}
    assert [fay.waiting_of("left", chance) for chance in (0.1, 0.9)] == ["low", "hang"]
