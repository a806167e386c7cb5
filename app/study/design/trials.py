"""Stimuli, trials and lists of pages of a plan, balanced in order and side, and their statistics.

Everything here is determined by the plan and its seed. Random ids are assigned afterwards, so that
a resumed export keeps them (`app.study.design.blinding`).
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
import pandas as pd

from app.errors import RunError
from app.study.design.key import KIND_OF_PROTOCOL, MAX_TRIALS_OF_LIST, Stimulus, TrialKind
from app.study.design.plan import CHOICES, Choice, StudyPlan
from conventions.names import pluralise

PAGES_PER_CHECK = 10
"""Fewest pages per attention check."""
USUAL_CHECKS = 2


@dataclass(frozen=True)
class PlannedTrial:
    """One trial with its ``stimuli`` in the order that participant 0 sees."""

    kind: TrialKind
    clip: str
    stimuli: tuple[Stimulus, ...] = ()
    required_answer: Choice | None = None
    """Answer required by an attention check; None otherwise."""


@dataclass(frozen=True)
class Page:
    """Trial in a list, with the order of its videos on the screen."""

    trial_index: int
    """Index into `Design.trials`."""
    stimuli: tuple[Stimulus, ...]


@dataclass(frozen=True)
class Design:
    stimuli: tuple[Stimulus, ...]
    trials: tuple[PlannedTrial, ...]
    lists: tuple[tuple[Page, ...], ...]
    """Pages of each list, in order."""

    @property
    def num_checks(self) -> int:
        """Number of attention checks in each list."""
        return sum(trial.kind == "attention" for trial in self.trials)

    def max_failed(self, plan: StudyPlan) -> int:
        """Return how many attention checks an included participant may fail."""
        return self.num_checks // 2 if plan.max_failed is None else plan.max_failed


def make_design(plan: StudyPlan) -> Design:
    """Make the design of a study; raises RunError if a list has too many trials or checks."""
    rng = np.random.default_rng(plan.seed)
    trials = {"pairwise": _pairs, "matched": _matches}.get(plan.protocol, _groups)(plan)
    count = min(plan.trials_per_participant or len(trials), len(trials))
    num_checks = _num_checks(plan, count)
    if count + num_checks > MAX_TRIALS_OF_LIST:
        raise RunError(
            f"Each participant would see {count + num_checks} pages; the limit is "
            f"{MAX_TRIALS_OF_LIST}. Reduce `trials_per_participant`."
        )
    checks = [
        PlannedTrial("attention", "attention", required_answer=CHOICES[index % 2])
        for index in range(num_checks)
    ]
    lists = []
    sharing = -(-len(trials) // count)  # so many participants see all trials between them
    for participant, order in enumerate(_orders(len(trials), count, plan.participants, rng)):
        turn = participant // sharing
        pages = [Page(index, _screen_order(trials[index], index, turn)) for index in order]
        for number, place in enumerate(_check_places(count, len(checks), rng)):
            pages.insert(place + number, Page(len(trials) + number, ()))
        lists.append(tuple(pages))
    stimuli = {stimulus for trial in trials for stimulus in trial.stimuli}
    in_order = sorted(
        stimuli, key=lambda one: (one.clip, one.view, one.system, one.speech_clip or "")
    )
    return Design(tuple(in_order), (*trials, *checks), tuple(lists))


def _num_checks(plan: StudyPlan, count: int) -> int:
    """Return the number of attention checks among ``count`` trials.

    More than one in ten pages would make people expect them. Raises RunError if the plan sets more.
    """
    most = max(1, count // (PAGES_PER_CHECK - 1))
    num_checks = plan.attention_checks
    if num_checks is None:
        return min(USUAL_CHECKS, most)
    if num_checks > most:
        raise RunError(
            f"The plan sets {num_checks} attention checks for {pluralise(count, 'trial')} per "
            f"participant; the limit is {most}, because at most one page in {PAGES_PER_CHECK} may "
            "be a check. Remove `attention_checks` to use the default, or increase "
            "`trials_per_participant`."
        )
    return num_checks


def _scenes(plan: StudyPlan) -> list[tuple[str, str]]:
    return [(clip.name, view) for view in plan.views for clip in plan.clips]


def _pairs(plan: StudyPlan) -> list[PlannedTrial]:
    """Make a silent trial of every pair of systems in every scene."""
    names = [system.name for system in plan.conditions]
    trials = []
    for scene, (clip, view) in enumerate(_scenes(plan)):
        for first, second in itertools.combinations(range(len(names)), 2):
            is_left = is_first_left(first, second, len(names), scene)
            order = (first, second) if is_left else (second, first)
            stimuli = tuple(Stimulus(names[index], clip, None, view) for index in order)
            trials.append(PlannedTrial("pair", clip, stimuli))
    return trials


def _matches(plan: StudyPlan) -> list[PlannedTrial]:
    """Make a trial of each motion with its own and the next clip's speech, for every system."""
    names = [clip.name for clip in plan.clips]
    wrong = dict(zip(names, [*names[1:], names[0]], strict=True))
    trials = []
    for scene, (clip, view) in enumerate(_scenes(plan)):
        for index, system in enumerate(plan.conditions):
            speeches = (clip, wrong[clip])[:: -1 if (scene + index) % 2 else 1]
            stimuli = tuple(Stimulus(system.name, clip, speech, view) for speech in speeches)
            trials.append(PlannedTrial("match", clip, stimuli))
    return trials


def _groups(plan: StudyPlan) -> list[PlannedTrial]:
    """Make one trial with all systems for each scene."""
    kind = KIND_OF_PROTOCOL[plan.protocol]
    return [
        PlannedTrial(
            kind, clip, tuple(Stimulus(one.name, clip, clip, view) for one in plan.conditions)
        )
        for clip, view in _scenes(plan)
    ]


def is_first_left(first: int, second: int, num_systems: int, scene: int) -> bool:
    """Check whether the first of two systems is on the left; in a scene each is left equally often.

    Systems are arranged on a circle and each is left of those on the half that follows; opposite
    ones (with an even number of systems) alternate from scene to scene.
    """
    ahead = (second - first) % num_systems
    if 2 * ahead == num_systems:
        return (min(first, second) == first) == (scene % 2 == 0)
    return 2 * ahead < num_systems


def williams_square(size: int) -> list[list[int]]:
    """Return orders of ``size`` treatments, balanced for position and for direct succession.

    Over all rows each treatment stands equally often in each position and directly follows each
    other one equally often (Williams 1949): ``size`` rows if it is even, else twice as many.
    """
    zigzag = [(place + 1) // 2 if place % 2 else -(place // 2) for place in range(size)]
    rows = [[(start + step) % size for step in zigzag] for start in range(size)]
    if size % 2 == 0:
        return rows
    return [order for row in rows for order in (row, row[::-1])]


def _screen_order(trial: PlannedTrial, index: int, turn: int) -> tuple[Stimulus, ...]:
    """Return the videos in screen order: two swap each turn, more follow a Williams square."""
    stimuli = trial.stimuli
    if len(stimuli) <= 2:
        return stimuli[::-1] if turn % 2 else stimuli
    rows = williams_square(len(stimuli))
    return tuple(stimuli[place] for place in rows[(turn + index) % len(rows)])


def _orders(
    num_trials: int, count: int, participants: int, rng: np.random.Generator
) -> list[list[int]]:
    """Return the trials of each participant: rows of a Williams square with shuffled treatments.

    If a participant sees fewer than all trials, consecutive participants share a row, each
    continuing where the last one stopped, so that every trial is shown about equally often.
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
    """Return the trial before which each attention check comes: evenly spaced, plus or minus one.

    Two checks are never adjacent if there are enough trials. The only check of a short list is at
    its end, where it shows whether the participant still pays attention.
    """
    if num_checks == 1 and count < PAGES_PER_CHECK - 1:
        return [count]
    middles = [(i + 1) * count / (num_checks + 1) for i in range(num_checks)]
    shifted = [round(middle) + int(rng.integers(-1, 2)) for middle in middles]
    places = sorted(min(max(place, 0), count) for place in shifted)
    for i in range(1, num_checks):
        places[i] = max(places[i], places[i - 1] + 1)
    return [max(0, min(place, count - num_checks + 1 + i)) for i, place in enumerate(places)]


@dataclass(frozen=True)
class Balance:
    """Balance of a design; a spread is the largest count minus the smallest, 0 is perfect."""

    appearances_spread: int
    """Spread over trials of the number of lists with the trial."""
    trial_position_spread: int
    """Spread over trials and positions of how often a trial is at a position of a list."""
    succession_spread: int
    """Spread over ordered pairs of trials of how often one directly follows the other."""
    first_place_spread_within_trial: int
    """Largest spread within a trial of how often each of its videos is first (left)."""
    first_place_unfairness: float
    """Largest absolute difference, over lists and systems, of times first and their fair share."""
    first_place_shares: dict[str, float]
    """Share of showings in which a condition is first, over all lists."""


def measure_balance(design: Design) -> Balance:
    """Measure the balance of the lists without attention checks; speech match is a condition."""
    is_matched = any(trial.kind == "match" for trial in design.trials)

    def label(stimulus: Stimulus) -> str:
        kind = "matched" if stimulus.has_own_speech else "mismatched"
        return f"{stimulus.system} ({kind})" if is_matched else stimulus.system

    lists = [[page for page in pages if page.stimuli] for pages in design.lists]
    rows = [
        (
            number,
            place,
            page.trial_index,
            stimulus,
            label(stimulus),
            float(first == 0),
            len(page.stimuli),
        )
        for number, pages in enumerate(lists)
        for place, page in enumerate(pages)
        for first, stimulus in enumerate(page.stimuli)
    ]
    names = ["list", "place", "trial", "video", "condition", "is_first", "count"]
    videos = pd.DataFrame(rows, columns=names)
    pages = videos.drop_duplicates(["list", "place"])
    excess = (videos.is_first - 1 / videos["count"]).groupby([videos["list"], videos.condition])
    firsts = videos.groupby(["trial", "video"]).is_first.sum().groupby("trial")
    shares = videos.groupby("condition").is_first.mean().round(4)
    followed = [
        pair for each in lists for pair in itertools.pairwise(page.trial_index for page in each)
    ]
    pairs = list(itertools.permutations(sorted(set(pages.trial)), 2))
    follows = Counter(dict.fromkeys(pairs, 0))
    follows.update(followed)
    return Balance(
        appearances_spread=_spread(pages.trial.value_counts()),
        trial_position_spread=_spread(
            pd.Series(pd.crosstab(pages.trial, pages.place).to_numpy().ravel())
        ),
        succession_spread=_spread(pd.Series(follows)),
        first_place_spread_within_trial=int((firsts.max() - firsts.min()).max()),
        first_place_unfairness=round(float(excess.sum().abs().max()), 4),
        first_place_shares={str(name): float(share) for name, share in shares.items()},
    )


def _spread(counts: pd.Series) -> int:
    return int(counts.max() - counts.min()) if len(counts) else 0


INTRO_S, ANSWER_S, DEFAULT_LENGTH_S = 60.0, 8.0, 10.0
"""Estimated times (s) of reading and practice, of an answer, and of a video of unknown length."""
_UNITS_OF_TRIAL = {
    "pair": ("vote", "pair of systems"),
    "match": ("vote", "system"),
    "rank": ("ranking", "system"),
    "rate": ("rating", "system"),
}
"""Unit of an answer, and of what answers are counted for, by kind of trial."""


def study_minutes_and_summary(plan: StudyPlan, design: Design) -> tuple[int, str]:
    """Return the minutes of the longest list, and a sentence on duration, pages and votes."""
    length_s = plan.video_s or DEFAULT_LENGTH_S
    seconds = max(
        sum(len(page.stimuli) * length_s + ANSWER_S for page in pages) for pages in design.lists
    )
    num_shown = 2 if plan.protocol == "pairwise" else 1
    names = sorted(system.name for system in plan.conditions)
    votes = Counter({group: 0 for group in itertools.combinations(names, num_shown)})
    for page in itertools.chain.from_iterable(design.lists):
        shown = sorted({stimulus.system for stimulus in page.stimuli})
        votes.update(itertools.combinations(shown, num_shown))
    fewest, most = min(votes.values()), max(votes.values())
    vote, whom = _UNITS_OF_TRIAL[KIND_OF_PROTOCOL[plan.protocol]]
    count = pluralise(most, vote) if fewest == most else f"{fewest} to {pluralise(most, vote)}"
    minutes, pages = math.ceil((INTRO_S + seconds) / 60), max(map(len, design.lists))
    return minutes, (
        f"About {pluralise(minutes, 'minute')} and {pluralise(pages, 'page')} for each "
        f"participant; {count} for each {whom} if all participants finish."
    )
