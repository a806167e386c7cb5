"""All statistics of a study, from the participants who count, and how balanced it came out."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from app.study.design.key import Key, Question
from app.study.statistics import votes as rows
from app.study.statistics.answers import Participant
from app.study.statistics.bradley_terry import Strengths, fit_strengths
from app.study.statistics.jitter_join import Jitter, JitterJoin, join_jitter
from app.study.statistics.means import Level, MeanValues, compare_means, krippendorff_alpha
from app.study.statistics.preference import ALPHA, Share, holm, share_of, smallest_share_detected
from app.study.statistics.votes import Values, Votes


@dataclass(frozen=True)
class PairResult:
    """Two systems compared, from the side of the first."""

    first: int
    second: int
    share: Share
    p_holm: float
    """Adjusted over the pairs of the question."""


@dataclass(frozen=True)
class SystemResult:
    """One system on its own, for the bars of the figure."""

    system: int
    share: Share
    """Pairs: of all its comparisons; rankings: of first places; matched: of right choices."""
    p_holm: float | None
    """Matched alone: that right choices differ from one half, adjusted over systems."""


@dataclass(frozen=True)
class Agreement:
    alpha: float | None
    """Krippendorff's; None where all answers are the same or nobody saw the same thing."""
    level: Level
    units: int
    """Things judged by two raters or more."""


@dataclass(frozen=True)
class Power:
    """What the sign test over participants sees 8 times in 10."""

    raters: int
    share_alone: float | None
    """Of participants on one side, for one comparison."""
    share_strictest: float | None
    """The same at Holm's first step over all comparisons of the question."""
    comparisons: int


@dataclass(frozen=True)
class QuestionResult:
    """Everything about one question; what its protocol does not have is empty or None."""

    question: Question
    num_answers: int
    pairs: tuple[PairResult, ...]
    systems: tuple[SystemResult, ...]
    strengths: Strengths | None
    means: MeanValues | None
    """Mean ranks (1 = best) or mean ratings."""
    left: Share | None
    """How often the left was chosen."""
    agreement: Agreement
    power: Power
    jitter: JitterJoin | None


def analyse_participants(
    participants: Sequence[Participant], key: Key, jitter: Jitter | None = None
) -> list[QuestionResult]:
    """Results of every question that was answered."""
    results = []
    for question in key.questions:
        if key.protocol == "matched":
            result = _matched(participants, key, question)
        elif question.kind == "slider":
            result = _rating(participants, key, question)
        else:
            result = _compared(participants, key, question, jitter)
        if result is not None:
            results.append(result)
    return results


def _compared(
    participants: Sequence[Participant], key: Key, question: Question, jitter: Jitter | None
) -> QuestionResult | None:
    """Pairwise choices, or rankings and the choices they imply."""
    votes = rows.pair_votes(participants, key, question.id)
    if not len(votes):
        return None
    is_ranking = question.kind == "ranking"
    count = len(key.systems)
    pairs = _pair_results(votes, count)
    values = rows.ranks(participants, key, question.id)
    clips = rows.clips_of(key)
    return QuestionResult(
        question=question,
        num_answers=int((values.value == 1).sum()) if is_ranking else len(votes),
        pairs=pairs,
        systems=_system_results(values, votes, count),
        strengths=fit_strengths(votes, count, has_sides=not is_ranking) if count > 1 else None,
        means=compare_means(values, count) if is_ranking else None,
        left=None if is_ranking else share_of(votes),
        agreement=_value_agreement(values, "ordinal") if is_ranking else _vote_agreement([votes]),
        power=_power(votes.rater, len(pairs)),
        jitter=join_jitter(votes, jitter, clips, key.systems) if jitter else None,
    )


def _matched(
    participants: Sequence[Participant], key: Key, question: Question
) -> QuestionResult | None:
    by_system = rows.match_votes(participants, key, question.id)
    if not by_system:
        return None
    shares = {name: share_of(votes.between(0, 1)) for name, votes in by_system.items()}
    adjusted = holm([share.p for share in shares.values()])
    together = np.concatenate([votes.rater for votes in by_system.values()])
    return QuestionResult(
        question=question,
        num_answers=len(together),
        pairs=(),
        systems=tuple(
            SystemResult(key.systems.index(name), share, p_holm)
            for (name, share), p_holm in zip(shares.items(), adjusted, strict=True)
        ),
        strengths=None,
        means=None,
        left=share_of(rows.joined(list(by_system.values()))),
        agreement=_vote_agreement([votes.between(0, 1) for votes in by_system.values()]),
        power=_power(together, len(by_system)),
        jitter=None,
    )


def _rating(
    participants: Sequence[Participant], key: Key, question: Question
) -> QuestionResult | None:
    values = rows.ratings(participants, key, question.id)
    if not len(values.rater):
        return None
    count = len(key.systems)
    return QuestionResult(
        question=question,
        num_answers=len(values.rater),
        pairs=(),
        systems=(),
        strengths=None,
        means=compare_means(values, count),
        left=None,
        agreement=_value_agreement(values, "interval"),
        power=_power(values.rater, count * (count - 1) // 2),
        jitter=None,
    )


def _pair_results(votes: Votes, count: int) -> tuple[PairResult, ...]:
    turned = {pair: votes.between(*pair) for pair in combinations(range(count), 2)}
    shares = {pair: share_of(between) for pair, between in turned.items() if len(between)}
    adjusted = holm([share.p for share in shares.values()])
    return tuple(
        PairResult(*pair, share, p_holm)
        for (pair, share), p_holm in zip(shares.items(), adjusted, strict=True)
    )


def _system_results(values: Values, votes: Votes, count: int) -> tuple[SystemResult, ...]:
    """First places where there are rankings, else all comparisons of the system."""
    results = []
    for system in range(count):
        own = rows.first_places(values, system) if len(values.rater) else votes.of(system)
        if len(own):
            results.append(SystemResult(system, share_of(own), None))
    return tuple(results)


def _vote_agreement(groups: Sequence[Votes]) -> Agreement:
    """On who is better (nominal: first, tie, second), over clips and pairs."""
    units: dict[tuple, list[float]] = defaultdict(list)
    for number, votes in enumerate(groups):
        alike = votes.turned(votes.left > votes.right)
        columns = (alike.clip, alike.left, alike.right, alike.score)
        for *thing, value in zip(*columns, strict=True):
            units[number, *thing].append(value)
    return _agreement(units, "nominal")


def _value_agreement(values: Values, level: Level) -> Agreement:
    """On the place or rating of each video; ratings to the nearest whole number."""
    units: dict[tuple, list[float]] = defaultdict(list)
    for clip, system, value in zip(values.clip, values.system, values.value, strict=True):
        units[clip, system].append(round(value))
    return _agreement(units, level)


def _agreement(units: dict[tuple, list[float]], level: Level) -> Agreement:
    shared = sum(len(unit) > 1 for unit in units.values())
    return Agreement(krippendorff_alpha(units.values(), level), level, shared)


def _power(rater: np.ndarray, comparisons: int) -> Power:
    raters = len(np.unique(rater))
    strictest = ALPHA / max(1, comparisons)
    return Power(
        raters=raters,
        share_alone=smallest_share_detected(raters),
        share_strictest=smallest_share_detected(raters, strictest),
        comparisons=comparisons,
    )


@dataclass(frozen=True)
class SystemBalance:
    """Where one system was seen."""

    system: str
    shown_first: float
    """Share of its showings in which it stood first (leftmost)."""
    mean_place: float
    """Mean place of its trials on the list, 0 = first trial, 1 = last; even is 0.5."""


@dataclass(frozen=True)
class Balance:
    systems: tuple[SystemBalance, ...]
    lists_used: int
    lists_planned: int
    most_of_one_list: int
    """Participants on the list that most worked on."""


def balance_reached(participants: Sequence[Participant], key: Key) -> Balance:
    """Counted over the answers that count, attention checks aside.

    In matched trials every video is of one system, so being first says nothing and is 1.
    """
    first: dict[str, list[bool]] = {name: [] for name in key.systems}
    places: dict[str, list[float]] = {name: [] for name in key.systems}
    for participant in participants:
        trials = key.lists[participant.list_number]
        place_of = {trial: place for place, trial in enumerate(trials)}
        for answer in participant.answers:
            if key.trials[answer.trial].expected is not None:
                continue
            place = place_of[answer.trial] / max(1, len(trials) - 1)
            systems = [key.videos[video].system for video in answer.shown]
            for system in set(systems):
                first[system].append(systems[0] == system)
                places[system].append(place)
    used = Counter(participant.list_number for participant in participants)
    return Balance(
        systems=tuple(
            SystemBalance(name, float(np.mean(first[name])), float(np.mean(places[name])))
            for name in key.systems
            if first[name]
        ),
        lists_used=len(used),
        lists_planned=len(key.lists),
        most_of_one_list=max(used.values(), default=0),
    )
