"""The order test: exact where it can be, blind to chance, awake to every consistent order."""

import itertools

import numpy as np
import pytest

from app.study.design.tells import LEVEL, order_probability, value_tells
from app.study.design.trials import Stimulus

SYSTEMS = ("a", "b", "c")


def test_the_probability_of_perfect_agreement_is_exact() -> None:
    scene = {"a": 1.0, "b": 2.0, "c": 3.0}
    assert order_probability([scene]) == 1.0
    assert order_probability([scene] * 2) == pytest.approx(1 / 6)
    assert order_probability([scene] * 4) == pytest.approx(1 / 6**3)
    two = {"a": 1.0, "b": 2.0}
    assert order_probability([two] * 8) == pytest.approx(1 / 2**7)


def test_equal_values_tell_nothing() -> None:
    assert order_probability([dict.fromkeys(SYSTEMS, 5.0)] * 6) == 1.0


def test_it_is_a_test_at_its_level() -> None:
    """Over all orders of three scenes, at most a share p has a probability of p or less."""
    orders = list(itertools.permutations((1.0, 2.0, 3.0)))
    found = np.array(
        [
            order_probability([dict(zip(SYSTEMS, order, strict=True)) for order in scenes])
            for scenes in itertools.product(orders, repeat=3)
        ]
    )
    for level in np.unique(found):
        assert np.mean(found <= level) <= level + 1e-9


def test_many_systems_are_drawn_and_not_listed() -> None:
    scene = {f"s{i}": float(i) for i in range(7)}
    assert order_probability([scene] * 4) < LEVEL
    rng = np.random.default_rng(1)
    shuffled = [dict(zip(scene, rng.permutation(7).astype(float), strict=True)) for _ in range(4)]
    assert order_probability(shuffled) > LEVEL


def test_an_order_by_match_is_seen_even_when_systems_are_mixed() -> None:
    values = {
        Stimulus(system, clip, speech, "front"): float(speech == clip)
        for system in ("a", "b")
        for clip, wrong in (("1", "2"), ("2", "3"), ("3", "4"), ("4", "1"))
        for speech in (clip, wrong)
    }
    (tell,) = value_tells(values, "size")
    assert "matched from mismatched" in tell
