"""Answers as arrays: comparisons of two systems, ranks and ratings, with who gave them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int

from app.study.design.key import Key
from app.study.statistics.answers import TIE, Answer, Participant


@dataclass(frozen=True)
class Votes:
    """Comparisons of two systems, one row each.

    A row that a ranking implies has no left and right; its `left` is the system named first in
    the study.
    """

    rater: Int[np.ndarray, " N"]
    """Index of the participant."""
    clip: Int[np.ndarray, " N"]
    left: Int[np.ndarray, " N"]
    """Index of the system on the left."""
    right: Int[np.ndarray, " N"]
    score: Float[np.ndarray, " N"]
    """1 if the left one was preferred, 0 if the right one, 0.5 for a tie."""
    because_smooth: Bool[np.ndarray, " N"]
    """Whether motion smoothness was among the reasons given."""

    def __len__(self) -> int:
        return len(self.rater)

    def __getitem__(self, rows: Bool[np.ndarray, " N"]) -> Votes:
        return Votes(**{name: column[rows] for name, column in vars(self).items()})

    def turned(self, rows: Bool[np.ndarray, " N"]) -> Votes:
        """Left and right exchanged in some rows."""
        return replace(
            self,
            left=np.where(rows, self.right, self.left),
            right=np.where(rows, self.left, self.right),
            score=np.where(rows, 1 - self.score, self.score),
        )

    def of(self, system: int) -> Votes:
        """The rows that show the system, turned so that it is on the left."""
        rows = self[(self.left == system) | (self.right == system)]
        return rows.turned(rows.left != system)

    def between(self, first: int, second: int) -> Votes:
        """The rows that compare the two systems, turned so that ``first`` is on the left."""
        rows = self.of(first)
        return rows[rows.right == second]


SMOOTHNESS = "smoothness"
"""The reason that measured jitter is joined with."""


@dataclass(frozen=True)
class Values:
    """One number for each video judged: a rank (1 = best) or a rating, one row each."""

    rater: Int[np.ndarray, " N"]
    clip: Int[np.ndarray, " N"]
    system: Int[np.ndarray, " N"]
    value: Float[np.ndarray, " N"]

    def rater_means(self, num_systems: int) -> Float[np.ndarray, "R K"]:
        """Mean of each rater for each system; only raters who judged every system."""
        num_raters = int(self.rater.max()) + 1 if len(self.rater) else 0
        total = np.zeros((num_raters, num_systems))
        count = np.zeros((num_raters, num_systems))
        np.add.at(total, (self.rater, self.system), self.value)
        np.add.at(count, (self.rater, self.system), 1)
        is_whole = (count > 0).all(1)
        return total[is_whole] / count[is_whole]


def pair_votes(participants: Sequence[Participant], key: Key, question: str) -> Votes:
    """Comparisons of two different systems: those asked for, and those that rankings imply."""
    rows = []
    for rater, clip, answer in _answers(participants, key, question):
        systems = _systems(key, answer.shown)
        if isinstance(answer.value, list):
            place = {video: place for place, video in enumerate(answer.value)}
            by_system = {key.videos[video].system: place[video] for video in answer.shown}
            for first, second in combinations(sorted(map(key.systems.index, by_system)), 2):
                is_first = by_system[key.systems[first]] < by_system[key.systems[second]]
                rows.append((rater, clip, first, second, float(is_first), False))
        elif isinstance(answer.value, str) and len(systems) == 2 and systems[0] != systems[1]:
            score = _left_score(answer)
            rows.append((rater, clip, *systems, score, SMOOTHNESS in answer.reasons))
    return _votes(rows)


def match_votes(participants: Sequence[Participant], key: Key, question: str) -> dict[str, Votes]:
    """For each system: was the video with its own speech told from the one with another's?

    `left` is 0 where the matched video stood on the left, else 1 (`right` the reverse);
    `between(0, 1)` therefore scores right choices.
    """
    rows: dict[str, list[tuple]] = {name: [] for name in key.systems}
    for rater, clip, answer in _answers(participants, key, question):
        is_matched = [key.videos[video].is_matched for video in answer.shown]
        if isinstance(answer.value, str) and sorted(is_matched) == [False, True]:
            system = key.videos[answer.shown[0]].system
            left = 0 if is_matched[0] else 1
            rows[system].append((rater, clip, left, 1 - left, _left_score(answer), False))
    return {name: _votes(of_system) for name, of_system in rows.items() if of_system}


def ranks(participants: Sequence[Participant], key: Key, question: str) -> Values:
    """Places in rankings, 1 = best."""
    rows = [
        (rater, clip, system, place + 1)
        for rater, clip, answer in _answers(participants, key, question)
        if isinstance(answer.value, list)
        for place, system in enumerate(_systems(key, answer.value))
    ]
    return _values(rows)


def ratings(participants: Sequence[Participant], key: Key, question: str) -> Values:
    """Slider positions, 0 to 100."""
    rows = [
        (rater, clip, key.systems.index(key.videos[video].system), value)
        for rater, clip, answer in _answers(participants, key, question)
        if isinstance(answer.value, dict)
        for video, value in answer.value.items()
    ]
    return _values(rows)


def first_places(values: Values, system: int) -> Votes:
    """Whether ``system`` was ranked first, as votes for it (0) against all others (1)."""
    rows = values.system == system
    count = int(rows.sum())
    return Votes(
        values.rater[rows],
        values.clip[rows],
        np.zeros(count, dtype=int),
        np.ones(count, dtype=int),
        (values.value[rows] == 1).astype(float),
        np.zeros(count, dtype=bool),
    )


def joined(groups: Sequence[Votes]) -> Votes:
    """All rows of all groups."""
    return Votes(
        **{
            name: np.concatenate([vars(votes)[name] for votes in groups])
            for name in vars(groups[0])
        }
    )


def clips_of(key: Key) -> tuple[str, ...]:
    """Every clip that is judged, in the order of the index that rows use."""
    judged = {trial.clip for trial in key.trials.values() if trial.expected is None}
    return tuple(sorted(judged))


def _answers(
    participants: Sequence[Participant], key: Key, question: str
) -> Iterator[tuple[int, int, Answer]]:
    index = {clip: place for place, clip in enumerate(clips_of(key))}
    for rater, participant in enumerate(participants):
        for answer in participant.answers:
            is_check = key.trials[answer.trial].expected is not None
            if answer.question == question and not is_check:
                yield rater, index[key.trials[answer.trial].clip], answer


def _systems(key: Key, videos: Sequence[str]) -> list[int]:
    return [key.systems.index(key.videos[video].system) for video in videos]


def _left_score(answer: Answer) -> float:
    return 0.5 if answer.value == TIE else float(answer.value == answer.shown[0])


def _votes(rows: list[tuple]) -> Votes:
    columns = np.array(rows, dtype=float).reshape(-1, 6).T
    whole = columns[:4].astype(int)
    return Votes(*whole, score=columns[4], because_smooth=columns[5].astype(bool))


def _values(rows: list[tuple]) -> Values:
    columns = np.array(rows, dtype=float).reshape(-1, 4).T
    return Values(*columns[:3].astype(int), value=columns[3])
