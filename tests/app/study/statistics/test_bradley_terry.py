import numpy as np
import pytest
from scipy import optimize

from app.study.simulate import ALIKE, davidson
from app.study.statistics.bradley_terry import PRIOR_SD, fit_strengths
from app.study.statistics.votes import Votes, pair_votes
from tests.app.study.made import STRENGTHS, made_key, made_participants, made_votes


def repeated(counts: dict[tuple[int, int, float], int]) -> Votes:
    """Votes from (left, right, score) -> how many; every one by another rater."""
    rows = [row for row, count in counts.items() for _ in range(count)]
    return made_votes([(rater, *row) for rater, row in enumerate(rows)])


def slow_maximum(votes: Votes, num_systems: int) -> np.ndarray:
    """Davidson's posterior written out vote by vote and searched without derivatives' help."""

    def loss(beta: np.ndarray) -> float:
        strength = np.exp(beta[:num_systems])
        side, tie = np.exp(beta[num_systems]), np.exp(beta[num_systems + 1])
        total = (beta**2).sum() / (2 * PRIOR_SD**2)
        for left, right, score in zip(votes.left, votes.right, votes.score, strict=True):
            first, second = strength[left] * side, strength[right]
            both = tie * np.sqrt(first * second)
            chance = {1.0: first, 0.5: both, 0.0: second}[score] / (first + second + both)
            total -= np.log(chance)
        return float(total)

    return optimize.minimize(loss, np.zeros(num_systems + 2), method="BFGS").x


def test_two_systems_are_as_far_apart_as_their_log_odds() -> None:
    found = fit_strengths(repeated({(0, 1, 1.0): 300, (0, 1, 0.0): 100}), 2, has_sides=False)
    gap, interval = found.differences[0, 1]
    assert gap == pytest.approx(np.log(3), abs=0.01)
    assert found.log_strength.sum() == pytest.approx(0, abs=1e-8)
    standard_error = np.sqrt(1 / 300 + 1 / 100)
    assert interval.high - interval.low == pytest.approx(2 * 1.96 * standard_error, rel=0.08)


def test_ties_and_sides_meet_their_likelihood_equations() -> None:
    counts = {(0, 1, 1.0): 400, (0, 1, 0.5): 200, (0, 1, 0.0): 100}
    counts |= {(1, 0, 1.0): 200, (1, 0, 0.5): 200, (1, 0, 0.0): 200}
    found = fit_strengths(repeated(counts), 2, has_sides=True)
    gap, side = found.differences[0, 1][0], found.left_advantage
    assert side is not None
    straight = 700 * davidson(gap + side, found.tie)
    turned = 600 * davidson(-gap + side, found.tie)
    # Seen minus expected totals are what the prior takes: parameter / variance.
    prior = 1 / PRIOR_SD**2
    ties = 400 - straight[1] - turned[1]
    lefts = (300 - (straight[0] - straight[2]) - (turned[0] - turned[2])) / 2
    wins = (300 - (straight[0] - straight[2]) + (turned[0] - turned[2])) / 2
    assert ties == pytest.approx(prior * np.log(found.tie), abs=1e-4)
    assert lefts == pytest.approx(prior * side, abs=1e-4)
    assert wins == pytest.approx(prior * found.log_strength[0], abs=1e-4)


def test_the_maximum_is_that_of_an_independent_slow_search() -> None:
    rng = np.random.default_rng(3)
    rows = []
    for rater in range(12):
        for _ in range(8):
            left, right = rng.choice(3, 2, replace=False)
            rows.append((rater, int(left), int(right), float(rng.choice([0, 0.5, 1]))))
    votes = made_votes(rows)
    slow = slow_maximum(votes, 3)
    found = fit_strengths(votes, 3, has_sides=True)
    assert found.log_strength == pytest.approx(slow[:3], abs=1e-4)
    assert found.left_advantage == pytest.approx(slow[3], abs=1e-4)
    assert found.tie == pytest.approx(np.exp(slow[4]), abs=1e-4)


def test_known_strengths_come_back() -> None:
    key = made_key(num_clips=10)
    people = made_participants(key, 200, ALIKE)
    found = fit_strengths(pair_votes(people, key, "realism"), 3, has_sides=True)
    mean = np.mean(list(STRENGTHS.values()))
    for index, name in enumerate(key.systems):
        assert found.log_strength[index] == pytest.approx(STRENGTHS[name] - mean, abs=0.1)
    assert found.tie == pytest.approx(ALIKE.tie, abs=0.05)
    assert found.left_advantage == pytest.approx(ALIKE.left_advantage, abs=0.08)


def test_rankings_give_back_the_same_strengths() -> None:
    key = made_key("ranking", num_clips=10)
    people = made_participants(key, 200, ALIKE)
    found = fit_strengths(pair_votes(people, key, "realism"), 3, has_sides=False)
    assert found.differences[1, 2][0] == pytest.approx(1.8, abs=0.15)
    assert found.tie == 0
    assert found.left_advantage is None


def test_a_system_that_wins_everything_stays_finite() -> None:
    found = fit_strengths(repeated({(0, 1, 1.0): 30}), 2, has_sides=False)
    gap, interval = found.differences[0, 1]
    assert 2 < gap < 8
    assert np.isfinite([interval.low, interval.high]).all()


def test_participants_are_drawn_whole() -> None:
    once = [(rater, 0, 1, float(rater < 14)) for rater in range(20)]
    single = fit_strengths(made_votes(once), 2, has_sides=False).differences[0, 1][1]
    tenfold = fit_strengths(made_votes(once * 10), 2, has_sides=False).differences[0, 1][1]
    # With less weight of the prior the interval may even grow; it must not shrink by sqrt(10).
    assert tenfold.high - tenfold.low >= single.high - single.low
