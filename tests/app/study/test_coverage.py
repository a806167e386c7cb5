from itertools import combinations

import numpy as np
import pytest

from app.study import coverage
from app.study.coverage import STRENGTHS, design
from app.study.simulate import ALIKE, RaterModel, World, davidson

PAIRS = list(combinations(range(len(STRENGTHS)), 2))
GIVEN = np.array(list(STRENGTHS.values()))


def test_the_truth_of_equal_raters_is_what_was_set() -> None:
    world = World(design("pairwise"), STRENGTHS, ALIKE, np.random.default_rng(0))
    chances = {pair: coverage._chances(world, "pairwise", pair) for pair in PAIRS}
    for (a, b), both_sides in chances.items():
        expected = davidson(GIVEN[a] - GIVEN[b] + ALIKE.left_advantage, ALIKE.tie)
        assert both_sides[0] == pytest.approx(expected)
    found = coverage._population_strengths(chances, len(GIVEN))
    # The prior and rounding to whole votes take a little.
    assert found - found.mean() == pytest.approx(GIVEN - GIVEN.mean(), abs=2e-3)


def test_the_truth_of_ranks_is_what_many_simulated_rankings_give() -> None:
    key = design("ranking", num_clips=2)
    world = World(key, STRENGTHS, RaterModel(), np.random.default_rng(0))
    chances = {pair: coverage._chances(world, "ranking", pair) for pair in PAIRS}
    places = np.zeros((2000, len(GIVEN)))
    for row in range(len(places)):
        for answer in world.answers(0):
            for place, video in enumerate(answer["value"]):
                places[row, key.systems.index(key.videos[video].system)] += (place + 1) / 2
    ranks = coverage._population_ranks(chances, len(GIVEN))
    assert ranks == pytest.approx(places.mean(0), abs=0.06)
    assert ranks.sum() == pytest.approx(sum(range(1, 5)))


def test_differing_raters_pull_shares_to_the_middle() -> None:
    key = design("pairwise")
    alike = coverage._share_over_clips(key, ALIKE, PAIRS)
    varied = coverage._share_over_clips(key, RaterModel(), PAIRS)
    assert all(0.5 < varied[pair] < alike[pair] for pair in PAIRS)
    wins = davidson(0.6 + np.array([0.1, -0.1]), ALIKE.tie).mean(0) @ [1, 0.5, 0]
    assert alike[0, 1] == pytest.approx(wins)


def test_intervals_are_held_against_the_truth() -> None:
    tallies = coverage.coverage("ranking", RaterModel(), studies=2, seed=3)
    assert set(tallies) == {"same", "other", "strength", "rank"}
    for tally in tallies.values():
        assert set(tally.held) == set(PAIRS)
        assert sum(tally.held.values()) >= 9  # of 12
        assert tally.width > 0
