"""From a plan to stimuli, trials and lists of pages, balanced in order and side.

Everything here follows from the plan and its seed. Random ids are given afterwards, so that an
export that is resumed keeps them (`app.study.design.blinding`).
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.errors import RunError
from app.study.design.key import MAX_TRIALS_OF_LIST
from app.study.design.plan import CHOICE_VALUES, Plan


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


KIND_OF_PROTOCOL = {"pairwise": "pair", "matched": "match", "ranking": "rank", "rating": "rate"}


@dataclass(frozen=True, order=True)
class Stimulus:
    """One video: what moves, and what is heard."""

    system: str
    clip: str
    speech: str | None
    """Clip whose speech is heard; None is silence."""
    view: str


@dataclass(frozen=True)
class PlannedTrial:
    """One page. ``stimuli`` stand in the order in which participant 0 sees them."""

    kind: str
    clip: str
    stimuli: tuple[Stimulus, ...] = ()
    press: str | None = None
    """Attention checks: which of `CHOICE_VALUES` the page says to press."""


@dataclass(frozen=True)
class Page:
    """A trial in a list, with the order of its videos on the screen."""

    trial: int
    """Index into `Design.trials`."""
    shown: tuple[Stimulus, ...]


@dataclass(frozen=True)
class Design:
    """Everything that is shown, to whom, in which order."""

    stimuli: tuple[Stimulus, ...]
    trials: tuple[PlannedTrial, ...]
    lists: tuple[tuple[Page, ...], ...]
    """Of participant p."""


def make_design(plan: Plan) -> Design:
    """The whole study.

    Raises:
        RunError: if there are more trials in a list than can be handled.
    """
    rng = np.random.default_rng(plan.seed)
    trials = _MAKERS[plan.protocol](plan)
    count = min(plan.trials_per_participant or len(trials), len(trials))
    if count + plan.attention_checks > MAX_TRIALS_OF_LIST:
        raise RunError(
            f"Each participant would see {count} trials; at most {MAX_TRIALS_OF_LIST} can be "
            "handled, so set `trials_per_participant`."
        )
    checks = [
        PlannedTrial("attention", "attention", press=CHOICE_VALUES[index % 2])
        for index in range(plan.attention_checks)
    ]
    orders = _orders(len(trials), count, plan.participants, rng)
    lists = []
    for participant, order in enumerate(orders):
        pages = [Page(index, _shown(trials[index], index, participant)) for index in order]
        for number, place in enumerate(_check_places(count, len(checks), rng)):
            pages.insert(place + number, Page(len(trials) + number, ()))
        lists.append(tuple(pages))
    stimuli = sorted({stimulus for trial in trials for stimulus in trial.stimuli}, key=_sort_key)
    return Design(tuple(stimuli), (*trials, *checks), tuple(lists))


def other_speech(plan: Plan) -> dict[str, str]:
    """The clip whose speech is played as the wrong one, the same for every system.

    The clips stand on a circle, so that each speech is as often right as it is wrong.
    """
    names = [clip.name for clip in plan.clips]
    return dict(zip(names, [*names[1:], names[0]], strict=True))


def _scenes(plan: Plan) -> list[tuple[str, str]]:
    return [(clip.name, view) for view in plan.views for clip in plan.clips]


def _pairs(plan: Plan) -> list[PlannedTrial]:
    """Every two systems in every scene, silent."""
    names = [system.name for system in plan.systems]
    trials = []
    for scene, (clip, view) in enumerate(_scenes(plan)):
        for first, second in itertools.combinations(range(len(names)), 2):
            order = (first, second)
            if not is_first_left(first, second, len(names), scene):
                order = (second, first)
            stimuli = tuple(Stimulus(names[index], clip, None, view) for index in order)
            trials.append(PlannedTrial("pair", clip, stimuli))
    return trials


def _matches(plan: Plan) -> list[PlannedTrial]:
    """The right and a wrong speech under each motion."""
    wrong = other_speech(plan)
    trials = []
    for scene, (clip, view) in enumerate(_scenes(plan)):
        for index, system in enumerate(plan.systems):
            speeches = (clip, wrong[clip])
            if (scene + index) % 2:
                speeches = speeches[::-1]
            stimuli = tuple(Stimulus(system.name, clip, speech, view) for speech in speeches)
            trials.append(PlannedTrial("match", clip, stimuli))
    return trials


def _groups(plan: Plan) -> list[PlannedTrial]:
    """All systems of a scene on one page."""
    kind = KIND_OF_PROTOCOL[plan.protocol]
    return [
        PlannedTrial(
            kind,
            clip,
            tuple(Stimulus(system.name, clip, clip, view) for system in plan.systems),
        )
        for clip, view in _scenes(plan)
    ]


_MAKERS = {"pairwise": _pairs, "matched": _matches, "ranking": _groups, "rating": _groups}


def _shown(trial: PlannedTrial, index: int, participant: int) -> tuple[Stimulus, ...]:
    """Two videos swap sides from one participant to the next; more follow a Williams square."""
    stimuli = trial.stimuli
    if len(stimuli) <= 2:
        return stimuli[::-1] if participant % 2 else stimuli
    rows = williams_square(len(stimuli))
    return tuple(stimuli[place] for place in rows[(participant + index) % len(rows)])


def _orders(
    num_trials: int, count: int, participants: int, rng: np.random.Generator
) -> list[list[int]]:
    """Trials of each participant: rows of a Williams square with its treatments shuffled.

    Where a participant sees fewer than all trials, consecutive ones share a row, each going on
    where the one before stopped, so that every trial is seen about equally often.
    """
    names = rng.permutation(num_trials)
    rows = williams_square(num_trials)
    sharing = -(-num_trials // count)
    orders = []
    for participant in range(participants):
        row = rows[(participant // sharing) % len(rows)]
        start = (participant % sharing) * count
        orders.append([int(names[row[(start + i) % num_trials]]) for i in range(count)])
    return orders


def _check_places(count: int, num_checks: int, rng: np.random.Generator) -> list[int]:
    """Before which trial each attention check stands: evenly spread, give or take one."""
    middles = [(i + 1) * count / (num_checks + 1) for i in range(num_checks)]
    shifted = [round(middle) + int(rng.integers(-1, 2)) for middle in middles]
    return sorted(min(max(place, 0), count) for place in shifted)


def _sort_key(stimulus: Stimulus) -> tuple[str, str, str, str]:
    return (stimulus.clip, stimulus.view, stimulus.system, stimulus.speech or "")
