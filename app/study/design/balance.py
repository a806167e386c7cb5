"""Order and side: Williams squares, fair tournaments, and how balanced a set of lists is."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass


def williams_square(size: int) -> list[list[int]]:
    """Orders of ``size`` treatments, balanced for position and for what comes before what.

    Over all rows each treatment stands equally often in each place and directly follows each other
    one equally often (Williams 1949): ``size`` rows when it is even, twice as many when it is odd.
    """
    zigzag = [(place + 1) // 2 if place % 2 else -(place // 2) for place in range(size)]
    rows = [[(start + step) % size for step in zigzag] for start in range(size)]
    if size % 2 == 0:
        return rows
    return [order for row in rows for order in (row, row[::-1])]


def is_first_left(first: int, second: int, num_systems: int, scene: int) -> bool:
    """Which of two systems stands left, so that within a scene each is left as often as right.

    Systems stand on a circle and each is left of those on the half that follows it; opposite ones
    (an even number of systems) take turns from scene to scene.
    """
    ahead = (second - first) % num_systems
    if 2 * ahead == num_systems:
        return (min(first, second) == first) == (scene % 2 == 0)
    return 2 * ahead < num_systems


@dataclass(frozen=True)
class Balance:
    """What was reached; a spread is the largest count minus the smallest, 0 is perfect."""

    appearances_spread: int
    """Over trials: in how many lists."""
    position_spread: int
    """Over trials and places."""
    follows_spread: int
    """Over ordered pairs of trials: how often one directly follows the other."""
    first_place_spread_within_trial: int
    """Largest over trials: over its videos, how often each is shown first (left)."""
    first_place_unfairness: float
    """Largest over lists and systems: times shown first minus its fair share of them, unsigned."""
    first_place_shares: dict[str, float]
    """By system: how often it is first where it is shown, over all lists."""


def measure_balance(
    lists: Sequence[Sequence[tuple[str, Sequence[str]]]],
    system_of: dict[str, str],
) -> Balance:
    """How balanced lists of (trial, videos as shown) are; attention checks show none.

    Args:
        system_of: system (or condition) behind each video.
    """
    shown_lists = [[page for page in pages if page[1]] for pages in lists]
    trials = sorted({trial for pages in shown_lists for trial, _ in pages})
    places = range(max((len(pages) for pages in shown_lists), default=0))
    position = Counter(
        (trial, place) for pages in shown_lists for place, (trial, _) in enumerate(pages)
    )
    follows = Counter(
        (before[0], after[0])
        for pages in shown_lists
        for before, after in itertools.pairwise(pages)
    )
    first = Counter((trial, shown[0]) for pages in shown_lists for trial, shown in pages)
    videos = {trial: shown for pages in shown_lists for trial, shown in pages}
    return Balance(
        appearances_spread=_spread(
            [sum(position[trial, place] for place in places) for trial in trials]
        ),
        position_spread=_spread([position[trial, place] for trial in trials for place in places]),
        follows_spread=_spread([follows[pair] for pair in itertools.permutations(trials, 2)]),
        first_place_spread_within_trial=max(
            (_spread([first[trial, video] for video in videos[trial]]) for trial in trials),
            default=0,
        ),
        first_place_unfairness=max(
            (_unfairness(pages, system_of) for pages in shown_lists), default=0.0
        ),
        first_place_shares=_first_place_shares(shown_lists, system_of),
    )


def _unfairness(pages: Sequence[tuple[str, Sequence[str]]], system_of: dict[str, str]) -> float:
    """How far a system is from being first as often as it should, in trials."""
    excess: dict[str, float] = {}
    for _, shown in pages:
        for place, video in enumerate(shown):
            system = system_of[video]
            excess[system] = excess.get(system, 0.0) + (place == 0) - 1 / len(shown)
    return round(max((abs(value) for value in excess.values()), default=0.0), 4)


def _first_place_shares(
    lists: Sequence[Sequence[tuple[str, Sequence[str]]]], system_of: dict[str, str]
) -> dict[str, float]:
    pages = [page for pages in lists for page in pages]
    first = Counter(system_of[shown[0]] for _, shown in pages)
    total = Counter(system_of[video] for _, shown in pages for video in shown)
    return {name: round(first[name] / total[name], 4) for name in sorted(total)}


def _spread(counts: Sequence[int]) -> int:
    return max(counts) - min(counts) if counts else 0
