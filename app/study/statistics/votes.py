"""Answers as tables: pairwise votes, ranks and ratings by rater; and tables of battles.

Battles have the format of the GENEA leaderboard's published analysis
(github.com/genea-workshop/leaderboard-statistical-analysis) and are written and read.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd

from app.errors import RunError
from app.study.design.key import AttentionRule, Question, StudyKey, Trial, Video
from app.study.statistics.answers import TIE, Answer, Participant

MISMATCHED_SUFFIX = "_Mismatched"
"""Suffix of a system's name under another clip's speech."""
SMOOTHNESS = "smoothness"
"""Id of the reason that measured jitter is compared with."""
VOTES = ("rater", "trial", "clip", "left", "right", "score", "is_smooth", "weight")
"""Columns of votes: rater (index of the participant), trial (one clip from one view), clip, both
names, score (1 if the left was preferred, 0 if the right, 0.5 for a tie), whether smoothness was a
reason, and weight (2 for a clear preference, else 1). In votes implied by a ranking the left system
is the first in the study.
"""
VALUES = ("rater", "trial", "clip", "system", "value")
"""Columns of ranks (1 = best) and ratings, one row per video."""
BATTLES = (
    *("user", "input_code", "model_a", "model_b", "winner", "is_strong"),
    *("juiceOptions", "juiceOtherReason"),
)
_LEADERBOARD_REASONS = {SMOOTHNESS: "MotionSmoothness", "amount": "AmountIntensityOfMotion"}
"""Leaderboard's names of reasons that it has as well."""
_MAX_BATTLES = 1_000_000


def votes_of(participants: Sequence[Participant], key: StudyKey, question: str) -> pd.DataFrame:
    """Return votes between two systems, also implied by rankings, or two speeches of a system."""
    rows = []
    for *about, answer in _judged(participants, key, question):
        names = [_name(key, video) for video in answer.videos]
        facts = SMOOTHNESS in answer.reasons, 2.0 if answer.is_strong else 1.0
        if isinstance(answer.value, list):
            place = {_name(key, video): place for place, video in enumerate(answer.value)}
            ranked = sorted(place, key=key.systems.index)
            rows += [
                (*about, one, other, float(place[one] < place[other]), *facts)
                for one, other in itertools.combinations(ranked, 2)
            ]
        elif isinstance(answer.value, str) and len(names) == 2 and names[0] != names[1]:
            score = 0.5 if answer.value == TIE else float(answer.value == answer.videos[0])
            rows.append((*about, *names, score, *facts))
    return pd.DataFrame(rows, columns=list(VOTES))


def rank_and_rating_table(
    participants: Sequence[Participant], key: StudyKey, question: str
) -> pd.DataFrame:
    """Return ranks (1 = best), or slider values from 0 to 100."""
    rows = []
    for *about, answer in _judged(participants, key, question):
        value = answer.value
        if isinstance(value, list):
            value = {video: place for place, video in enumerate(value, 1)}
        if isinstance(value, dict):
            rows += [(*about, key.videos[name].system, float(v)) for name, v in value.items()]
    return pd.DataFrame(rows, columns=list(VALUES))


def _judged(
    participants: Sequence[Participant], key: StudyKey, question: str
) -> Iterator[tuple[int, str, str, Answer]]:
    for rater, participant in enumerate(participants):
        for answer in participant.answers:
            trial = key.trials[answer.trial]
            is_judged = trial.expected is None and answer.unplayable_video is None
            if answer.question == question and is_judged:
                yield rater, answer.trial, trial.clip, answer


def _name(key: StudyKey, video: str) -> str:
    """Return the system's name, in matched studies with `MISMATCHED_SUFFIX` for other speech."""
    condition = key.videos[video]
    is_other = key.protocol == "matched" and not condition.has_own_speech
    return condition.system + MISMATCHED_SUFFIX if is_other else condition.system


def swap_sides(votes: pd.DataFrame, rows: pd.Series) -> pd.DataFrame:
    """Swap left and right in the rows of a mask."""
    return votes.assign(
        left=votes.left.where(~rows, votes.right),
        right=votes.right.where(~rows, votes.left),
        score=votes.score.where(~rows, 1 - votes.score),
    )


def votes_of_system(votes: pd.DataFrame, name: str) -> pd.DataFrame:
    """Return the votes on a system, swapped so that it is on the left."""
    rows = pd.DataFrame(votes[(votes.left == name) | (votes.right == name)])
    return swap_sides(rows, rows.left != name)


def votes_between(votes: pd.DataFrame, first: str, second: str) -> pd.DataFrame:
    """Return the votes between two systems, swapped so that ``first`` is on the left."""
    rows = votes_of_system(votes, first)
    return pd.DataFrame(rows[rows.right == second])


def first_place_votes(values: pd.DataFrame, system: str) -> pd.DataFrame:
    """Return first ranks of a system as votes (1 or 0) for it against all others."""
    rows = values[values.system == system]
    return rows.assign(score=(rows.value == 1).astype(float))


def battles_of(participants: Sequence[Participant], key: StudyKey) -> pd.DataFrame:
    """Return all choices between two videos as battles, sorted as by the leaderboard."""
    rows = []
    for question in key.questions:
        for rater, _, clip, answer in _judged(participants, key, question.id):
            if question.kind == "choice":
                names = [_name(key, video) for video in answer.videos]
                winner = "model_a" if answer.value == answer.videos[0] else "model_b"
                winner = "tie" if answer.value == TIE else winner
                juice = [_LEADERBOARD_REASONS.get(reason, reason) for reason in answer.reasons]
                listed = json.dumps(juice, separators=(",", ":")) if juice else "{}"
                user, strong = participants[rater].id, answer.is_strong
                rows.append((user, clip, *names, winner, strong, listed, None))
    table = pd.DataFrame(rows, columns=list(BATTLES))
    return table.sort_values(["user", "input_code"], kind="stable")


def read_battles(path: Path) -> tuple[StudyKey, list[Participant]]:
    """Read a table of battles as a study and its participants.

    Columns after ``winner`` may be missing. Raises RunError if the file is not a table of battles.
    """
    try:
        table = pd.read_csv(path, dtype=str, keep_default_na=False, nrows=_MAX_BATTLES)
        for name in BATTLES[:5]:
            if name not in table or not len(table):
                raise ValueError(f"it has no {f'column {name}' if len(table) else 'rows'}")
        return _battles_read(table, path.name)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise RunError(f"{path.name} is not a table of battles: {reason}.") from error


def _battles_read(table: pd.DataFrame, name: str) -> tuple[StudyKey, list[Participant]]:
    pairs = {tuple(pair) for pair in table[["model_a", "model_b"]].to_numpy()}
    is_matched = all(a + MISMATCHED_SUFFIX == b or b + MISMATCHED_SUFFIX == a for a, b in pairs)
    question = Question("match" if is_matched else "realism", name, "choice")
    videos, trials = {}, {}
    answers: dict[str, list[Answer]] = {user: [] for user in table["user"]}
    for row in table.to_dict("records"):
        clip, pair = row["input_code"], []
        for model in (row["model_a"], row["model_b"]):
            is_other = is_matched and model.endswith(MISMATCHED_SUFFIX)
            system = model.removesuffix(MISMATCHED_SUFFIX) if is_other else model
            speech = ("another" if is_other else clip) if is_matched else None
            videos[f"{clip}/{model}"] = Video(system, clip, speech, "front", "unknown")
            pair.append(f"{clip}/{model}")
        trial = " against ".join(sorted(pair))
        kind = "match" if is_matched else "pair"
        trials[trial] = Trial(kind, clip, tuple(sorted(pair)), (question.id,))
        winners = {"model_a": pair[0], "model_b": pair[1], "tie": TIE}
        if row["winner"] not in winners:
            raise ValueError(f"the winner {row['winner']!r} is not one of {', '.join(winners)}")
        juice = row.get("juiceOptions", "")
        reasons = tuple(mine for mine, theirs in _LEADERBOARD_REASONS.items() if theirs in juice)
        strong = row.get("is_strong") == "True"
        answers[row["user"]].append(
            Answer(
                trial,
                question.id,
                videos=tuple(pair),
                value=winners[row["winner"]],
                reasons=reasons,
                is_strong=strong,
            )
        )
    key = StudyKey(
        study_id=name,
        title=name,
        protocol="matched" if is_matched else "pairwise",
        systems=tuple(sorted({video.system for video in videos.values()})),
        questions=(question,),
        videos=videos,
        trials=trials,
        lists={n: tuple(each.trial for each in of) for n, of in enumerate(answers.values())},
        attention_rule=AttentionRule(0),
        num_participants_planned=len(answers),
    )
    then = datetime(2000, 1, 1, tzinfo=UTC)
    return key, [
        Participant(name, user, number, then, tuple(votes), then, file_name=user)
        for number, (user, votes) in enumerate(answers.items())
    ]
