"""Whether something that a participant can see orders the videos by method.

Within each scene (one clip from one view) the values of its videos are ranked. Were they unrelated
to the method, every assignment of systems within a scene would be equally likely; an exact
permutation test says how rare the orders found are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from app.study.design.trials import Stimulus

LEVEL = 0.01
"""Below this probability an order counts as a leak. The export draws names until it is above."""
_EXACT_LIMIT = 20_000
_DRAWS = 20_000


def order_probability(scenes: Sequence[Mapping[str, float]]) -> float:
    """Probability under chance of orders that agree over scenes at least as much as these.

    The statistic is Friedman's: the sum over systems of their squared rank totals. One scene alone
    tells nothing (every order is as likely as any other) and gives 1.

    Args:
        scenes: for each, a value by system. All have the same systems.
    """
    from scipy.stats import rankdata  # takes a second to import, for what the page seldom needs

    if len(scenes) < 2:
        return 1.0
    systems = sorted(scenes[0])
    ranks = np.array([rankdata([scene[name] for name in systems]) for scene in scenes])
    observed = _statistic(ranks.sum(axis=0))
    orders = math.factorial(len(systems)) ** (len(scenes) - 1)
    totals = _all_totals(ranks) if orders <= _EXACT_LIMIT else _drawn_totals(ranks)
    return float(np.mean(_statistic(totals) >= observed - 1e-9))


def order_tells(names: Mapping[Stimulus, str]) -> list[str]:
    """Ways in which the alphabetical order of the videos' names suggests the method.

    Returns:
        One sentence each; empty when nothing is suggested.
    """
    place = {name: float(rank) for rank, name in enumerate(sorted(names.values()))}
    return value_tells({stimulus: place[name] for stimulus, name in names.items()}, "file name")


def value_tells(values: Mapping[Stimulus, float], what: str) -> list[str]:
    """Ways in which the order of some value of the videos suggests the method.

    For matched and mismatched speech the two conditions of a motion are compared as well.
    """
    tells = []
    by_system = _scenes(
        values,
        lambda stimulus: (stimulus.clip, stimulus.view, stimulus.speech),
        lambda stimulus: stimulus.system,
    )
    if (chance := order_probability(by_system)) < LEVEL:
        tells.append(f"{what}: its order follows the system (probability {chance:.2g} by chance)")
    by_match = _scenes(
        values,
        lambda stimulus: (stimulus.clip, stimulus.view, stimulus.system),
        lambda stimulus: str(stimulus.speech == stimulus.clip),
    )
    if (chance := order_probability(by_match)) < LEVEL:
        tells.append(
            f"{what}: its order tells matched from mismatched speech (probability {chance:.2g} "
            "by chance)"
        )
    return tells


def _scenes(
    values: Mapping[Stimulus, float], scene_of: Any, label_of: Any
) -> list[dict[str, float]]:
    """Values by label in each scene; scenes with a single label have no order."""
    scenes: dict[Any, dict[str, float]] = {}
    for stimulus, value in values.items():
        scenes.setdefault(scene_of(stimulus), {})[label_of(stimulus)] = value
    return [scene for scene in scenes.values() if len(scene) > 1]


def _statistic(totals: np.ndarray) -> np.ndarray:
    return np.square(totals).sum(axis=-1)


def _all_totals(ranks: np.ndarray) -> np.ndarray:
    """Rank totals of every arrangement; the first scene may stay, as only agreement counts."""
    totals = ranks[:1]
    for scene in ranks[1:]:
        arranged = np.array(list(itertools.permutations(scene)))
        totals = (totals[:, None] + arranged[None]).reshape(-1, ranks.shape[1])
    return totals


def _drawn_totals(ranks: np.ndarray) -> np.ndarray:
    """Rank totals of many random arrangements, and of the one observed."""
    rng = np.random.default_rng(0)
    totals = np.zeros((_DRAWS, ranks.shape[1]))
    for scene in ranks:
        totals += rng.permuted(np.broadcast_to(scene, totals.shape), axis=1)
    return np.vstack([totals, ranks.sum(axis=0)])
