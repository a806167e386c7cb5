"""Results of a study from the included participants, with measured jerk and balance."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from app.errors import RunError
from app.study.design.key import Question, StudyKey
from app.study.statistics.answers import Participant
from app.study.statistics.models import Level, alpha_estimate, mean_estimates, strengths_and_elo
from app.study.statistics.proportions import (
    ALPHA,
    ResultEstimate,
    detectable_share,
    proportion_estimates,
    with_holm,
)
from app.study.statistics.votes import (
    MISMATCHED_SUFFIX,
    first_place_votes,
    rank_and_rating_table,
    swap_sides,
    votes_between,
    votes_of,
    votes_of_system,
)
from conventions.names import REFERENCE_NAME
from model.diagnostics import with_current_format

JERK = "tip_jerk_m_s3"
"""Mean jerk of the fingertip in m/s³, of the unfiltered motion ("raw")."""
JerkByVideo = Mapping[tuple[str, str], float]
"""Value of `JERK` by (clip, system)."""


@dataclass(frozen=True)
class QuestionResult:
    question: Question
    num_answers: int
    estimates: tuple[ResultEstimate, ...]
    """Numbers as in ``results.csv``; those that the protocol does not have are missing."""
    measurement_level: Level
    """Level of measurement for Krippendorff's alpha."""
    num_shared_items: int
    """Number of items judged by two raters or more."""
    num_raters: int
    num_complete_raters: int
    """Number of raters that judged every system, in rankings and ratings; 0 for choices."""
    num_comparisons: int
    detectable_share_after_holm: float | None
    """Smallest share that the sign test detects at Holm's first step over all comparisons."""

    def estimates_of(self, measure: str) -> list[ResultEstimate]:
        return [number for number in self.estimates if number.measure == measure]

    def find_estimate(
        self, measure: str, first: str | None = None, second: str | None = None
    ) -> ResultEstimate | None:
        """Return the estimate of a measure and systems, from either side, or None."""
        names = {first, second}
        for number in self.estimates_of(measure):
            if first is None or {number.first, number.second} == names:
                return (
                    number
                    if number.first == first or first is None
                    else number.with_systems_swapped()
                )
        return None

    @property
    def main_estimates(self) -> list[ResultEstimate]:
        """Means of the systems, else shares of the pairs, else right choices by system."""
        kinds = ("mean_rank", "mean_rating", "share", "right_choices")
        return next((estimates for kind in kinds if (estimates := self.estimates_of(kind))), [])

    @property
    def bar_measure(self) -> str:
        """Name of the measure of each system that the bars show."""
        kinds = ("right_choices", "first_places", "share_of_all_votes", "mean_rating")
        return next((kind for kind in kinds if self.estimates_of(kind)), kinds[-1])


def analyse_participants(
    participants: Sequence[Participant], key: StudyKey, jerk_by_video: JerkByVideo | None = None
) -> list[QuestionResult]:
    """Compute the results of every question with answers."""
    results = [_result(participants, key, question, jerk_by_video) for question in key.questions]
    return [result for result in results if result is not None]


def _result(
    participants: Sequence[Participant],
    key: StudyKey,
    question: Question,
    jerk_by_video: JerkByVideo | None,
) -> QuestionResult | None:
    votes = votes_of(participants, key, question.id)
    values = rank_and_rating_table(participants, key, question.id)
    if not len(votes) and not len(values):
        return None
    systems, is_matched = key.systems, key.protocol == "matched"
    is_ranking, is_rating = question.kind == "ranking", question.kind == "slider"
    pairs = list(combinations(systems, 2))
    estimates: list[ResultEstimate] = []
    if is_matched:
        for name in systems:
            estimates += proportion_estimates(
                "right_choices", votes_between(votes, name, name + MISMATCHED_SUFFIX), name
            )
    else:
        for pair in pairs:
            estimates += proportion_estimates("share", votes_between(votes, *pair), *pair)
    estimates = with_holm(estimates)
    num_compared = sum(number.p is not None for number in estimates)
    if not is_matched and not is_rating:
        for name in systems:
            rows = first_place_votes(values, name) if is_ranking else votes_of_system(votes, name)
            measure = "first_places" if is_ranking else "share_of_all_votes"
            estimates += proportion_estimates(measure, rows, name, is_tested=False)
        if len(systems) > 1:
            estimates += strengths_and_elo(votes, systems, has_sides=not is_ranking)
    num_of_means = 0
    if is_ranking or is_rating:
        measure = "mean_rank" if is_ranking else "mean_rating"
        num_of_means, means = mean_estimates(values, systems, measure)
        estimates += means
    level: Level = (
        "nominal" if question.kind == "choice" else "ordinal" if is_ranking else "interval"
    )
    if question.kind == "choice":
        estimates += proportion_estimates("left_chosen", votes)
        judged = swap_sides(votes, votes.left > votes.right).rename(columns={"score": "value"})
        things = ["trial", "left", "right"]
    else:
        judged, things = values.assign(value=values.value.round()), ["trial", "system"]
    # Two answers of one rater are not an agreement: a table of battles may hold the same one twice.
    units = judged.drop_duplicates([*things, "rater"]).groupby(things).value.apply(list)
    num_raters = (values if is_rating else votes).rater.nunique()
    estimates.append(alpha_estimate(units, level))
    alone = detectable_share(num_raters)
    estimates.append(ResultEstimate("detectable_share_of_participants", value=alone))
    if jerk_by_video and not is_matched and not is_rating:
        estimates += smoother_chosen_estimates(votes, jerk_by_video)
    comparisons = len(pairs) if is_rating else num_compared
    num_answers = len(values) if is_rating else len(votes)
    if is_ranking:
        num_answers = int((values.value == 1).sum())
    return QuestionResult(
        question=question,
        num_answers=num_answers,
        estimates=tuple(estimates),
        measurement_level=level,
        num_shared_items=int((units.map(len) > 1).sum()),
        num_raters=num_raters,
        num_complete_raters=num_of_means,
        num_comparisons=comparisons,
        detectable_share_after_holm=detectable_share(num_raters, ALPHA / max(1, comparisons)),
    )


def read_jerk(folder: Path, key: StudyKey) -> JerkByVideo:
    """Read `JERK` from ``folder``/CLIP/diagnostics.json by system.

    The recording's value has the name `REFERENCE_NAME`. Raises RunError if there is no file for any
    clip, or one is damaged.
    """
    jerk_by_video: dict[tuple[str, str], float] = {}
    for clip in key.clips:
        path = folder / clip / "diagnostics.json"
        if not path.is_file():
            continue
        try:
            diagnostics = with_current_format(json.loads(path.read_bytes()))
            measured = {REFERENCE_NAME: diagnostics.get("reference"), **diagnostics["systems"]}
            for name in (name for name in key.systems if measured.get(name)):
                if value := measured[name]["raw"][JERK]:
                    jerk_by_video[clip, name] = float(value)
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise RunError(
                f"{path} is not a valid diagnostics file; run `diagnose` again for this clip."
            ) from error
    if not jerk_by_video:
        raise RunError(
            f"{folder} contains no diagnostics of this study's clips; it should contain a file "
            f"such as {key.clips[0]}/diagnostics.json for each clip."
        )
    return jerk_by_video


def smoother_chosen_estimates(
    votes: pd.DataFrame, jerk_by_video: JerkByVideo
) -> list[ResultEstimate]:
    """Compute how often the smoother video is chosen, with and without smoothness as a reason.

    Ties, and votes without measured jerk, are left out.
    """
    jerk = {
        side: pd.Series(
            [jerk_by_video.get(at, np.nan) for at in zip(votes["clip"], votes[side], strict=True)],
            votes.index,
            dtype=float,
        )
        for side in ("left", "right")
    }
    are_apart = (jerk["left"] - jerk["right"]).abs() > 0
    rows = swap_sides(votes, jerk["left"] > jerk["right"])[are_apart & (votes.score != 0.5)]
    joined = []
    for measure, is_named in (
        ("smoother_chosen_naming_smoothness", True),
        ("smoother_chosen_otherwise", False),
    ):
        joined += proportion_estimates(measure, pd.DataFrame(rows[rows.is_smooth == is_named]))
    return joined


@dataclass(frozen=True)
class AnswerBalance:
    """Balance of the included answers without attention checks."""

    position_balance: pd.DataFrame
    """Columns by system: ``first``, share of its showings as the first video (leftmost; meaningless
    in matched trials, where every video is of one system), and ``place``, mean position of its
    trials on the list, 0 = first trial, 1 = last; 0.5 is balanced."""
    lists_used: int
    lists_planned: int
    max_participants_per_list: int
    """Most participants on one list."""


def measure_answer_balance(participants: Sequence[Participant], key: StudyKey) -> AnswerBalance:
    """Measure the balance of the included answers."""
    rows = []
    for participant in participants:
        trials = key.lists[participant.list_number]
        place_of = {trial: place for place, trial in enumerate(trials)}
        for answer in participant.answers:
            if key.trials[answer.trial].expected is None and answer.unplayable_video is None:
                place = place_of[answer.trial] / max(1, len(trials) - 1)
                systems = [key.videos[video].system for video in answer.videos]
                rows += [(system, systems[0] == system, place) for system in set(systems)]
    table = pd.DataFrame(rows, columns=["system", "first", "place"])
    used = Counter(participant.list_number for participant in participants)
    return AnswerBalance(
        position_balance=pd.DataFrame(table.groupby("system").mean()).reindex(key.systems).dropna(),
        lists_used=len(used),
        lists_planned=len(key.lists),
        max_participants_per_list=max(used.values(), default=0),
    )
