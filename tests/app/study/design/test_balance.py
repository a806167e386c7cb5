"""Order and side are as balanced as the squares promise."""

import itertools
from collections import Counter

import pytest

from app.study.design.trials import is_first_left, measure_balance, williams_square


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6, 9, 18])
def test_a_williams_square_balances_position_and_succession(size: int) -> None:
    rows = williams_square(size)
    assert len(rows) == (size if size % 2 == 0 else 2 * size)
    assert all(sorted(row) == list(range(size)) for row in rows)
    positions = Counter((place, name) for row in rows for place, name in enumerate(row))
    assert len(set(positions.values())) == 1
    follows = Counter(pair for row in rows for pair in itertools.pairwise(row))
    assert len(follows) == size * (size - 1)
    assert len(set(follows.values())) <= 1


@pytest.mark.parametrize("num_systems", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("num_scenes", [1, 2, 4])
def test_each_system_is_left_as_often_as_right(num_systems: int, num_scenes: int) -> None:
    lefts = Counter()
    for scene in range(num_scenes):
        for first, second in itertools.combinations(range(num_systems), 2):
            is_left = is_first_left(first, second, num_systems, scene)
            assert is_left != is_first_left(second, first, num_systems, scene)
            lefts[first if is_left else second] += 1
    fair = num_scenes * (num_systems - 1) / 2
    # An odd number of trials cannot be halved; everything else can.
    limit = 0.5 if num_scenes % 2 and num_systems % 2 == 0 else 0.0
    assert all(abs(lefts[system] - fair) <= limit for system in range(num_systems))


def test_the_balance_of_lists_is_told_as_it_is() -> None:
    system_of = {"a": "one", "b": "two", "c": "one", "d": "two"}
    first, second = ("t1", ("a", "b")), ("t2", ("c", "d"))
    check = ("check", ())
    fair = measure_balance(
        [[first, check, ("t2", ("d", "c"))], [second, ("t1", ("b", "a"))]], system_of
    )
    assert fair.position_spread == fair.follows_spread == fair.appearances_spread == 0
    assert fair.first_place_spread_within_trial == 0
    assert fair.first_place_unfairness == 0.0
    assert fair.first_place_shares == {"one": 0.5, "two": 0.5}

    unfair = measure_balance([[first, second], [first, second]], system_of)
    assert unfair.position_spread == unfair.follows_spread == 2
    assert unfair.first_place_spread_within_trial == 2
    assert unfair.first_place_unfairness == 1.0
    assert unfair.first_place_shares == {"one": 1.0, "two": 0.0}
