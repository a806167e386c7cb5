"""Answers of participants: read, checked against the key, and one file per participant selected."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, PlainValidator
from pydantic.dataclasses import dataclass

from app.errors import RunError
from app.run.batch.pairing import is_hidden
from app.study.design.key import (
    MAX_PANEL_IDS,
    Ids,
    ListNumber,
    PanelName,
    PanelValue,
    Question,
    StudyKey,
)
from model.storage.json_validation import STRICT, InvalidJsonError, Text, parse_json, read_json

TIE = "tie"
SIMULATION_TRUTH_FILE = "truth.json"
"""Name of the parameters' file of a simulation, which is skipped in folders."""
MAX_FILES = 10_000
MAX_FILE_BYTES = 4 * 2**20
MAX_ANSWERS = 10_000
HIGHEST_RATING = 100

Count = Annotated[int, Field(ge=0, le=10**9)]
Time = Annotated[datetime, AfterValidator(lambda t: t if t.tzinfo else t.replace(tzinfo=UTC))]


@dataclass(frozen=True, config=STRICT)
class Answer:
    trial: Text
    question: Text
    videos: Annotated[Ids, Field(validation_alias="shown")]
    """Blind ids from left to right."""
    value: Any
    """Blind id or `TIE`; blind ids, best first; or ratings by id; anything in attention checks."""
    reasons: Ids = ()
    page_ms: Annotated[Count, Field(validation_alias="ms")] = 0
    """Time on the trial's page (ms)."""
    min_complete_plays: Annotated[Count, Field(validation_alias="watched")] = 0
    """Number of complete plays of the least played video."""
    is_strong: bool = False
    """True if the participant called the preference clear; false where that is not an option."""
    unplayable_video: Annotated[Text | None, Field(validation_alias="skipped")] = None
    """Blind id of a video that the browser could not play; its page was skipped without a value."""


def _listed(values: Any) -> tuple[Any, ...]:
    """Check that ``answers`` is a list within the limit; answers are checked one by one later."""
    if not isinstance(values, list | tuple) or len(values) > MAX_ANSWERS:
        raise ValueError(f"`answers` must be a list of at most {MAX_ANSWERS} answers")
    return tuple(values)


@dataclass(frozen=True, config=ConfigDict(strict=True, validate_by_name=True))
class Participant:
    """Answers file of one participant."""

    study: Text
    id: Annotated[Text, Field(validation_alias="participant")]
    list_number: Annotated[ListNumber, Field(validation_alias="list")]
    started: Time
    answers: Annotated[tuple[Answer, ...], PlainValidator(_listed)]
    """Unparsed JSON values until `drop_invalid_answers` has checked them."""
    finished: Time | None = None
    headphones: Any = None
    link_token: Annotated[Text | None, Field(validation_alias="link")] = None
    """Token of the participant's link."""
    panel_values: Annotated[
        Mapping[PanelName, PanelValue], Field(max_length=MAX_PANEL_IDS, validation_alias="panel")
    ] = field(default_factory=dict)
    """Panel ids from the page's address; only those that the plan names."""
    format: Literal[1] = 1
    file_name: str = ""
    """Name of the file."""


@dataclass(frozen=True)
class CollectedAnswers:
    """Participants of a study, each once, and sentences on all files and answers left out."""

    participants: tuple[Participant, ...]
    left_out_sentences: tuple[str, ...]


def collect_answers(paths: Iterable[Path], key: StudyKey) -> CollectedAnswers:
    """Read files and folders of answers, and note unusable ones; raises RunError."""
    participants: list[Participant] = []
    left_out: list[str] = []
    for path in _files(paths):
        try:
            sent = read_json(path, Participant, MAX_FILE_BYTES)
            participant, refused = drop_invalid_answers(replace(sent, file_name=path.name), key)
        except InvalidJsonError as error:
            left_out.append(f"{path.name} is left out: {error}.")
            continue
        participants.append(participant)
        if refused:
            left_out.append(_refused_sentence(participant, refused))
    valid, doubles = _each_once(participants, key)
    return CollectedAnswers(tuple(valid), tuple(left_out + doubles))


def _files(paths: Iterable[Path]) -> list[Path]:
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            answer_files = (
                file for file in sorted(path.rglob("*.json")) if file.name != SIMULATION_TRUTH_FILE
            )
            inside = (file for file in answer_files if not is_hidden(file.relative_to(path)))
            files.extend(file for file in inside if file.is_file())
        elif path.is_file():
            files.append(path)
        else:
            raise RunError(
                f"{path} does not exist; give answer files, or folders that contain them."
            )
        if len(files) > MAX_FILES:
            raise RunError(
                f"There are more than {MAX_FILES:,} files; the limit is {MAX_FILES:,}. Analyse "
                "one study at a time."
            )
    return list(dict.fromkeys(file.resolve() for file in files))


def drop_invalid_answers(sent: Participant, key: StudyKey) -> tuple[Participant, Counter[str]]:
    """Return the valid answers, and counts of others by reason; raises InvalidJsonError if none."""
    if sent.study != key.study_id:
        raise InvalidJsonError("it belongs to another study")
    if sent.list_number not in key.lists:
        raise InvalidJsonError(f"the study has no participant list {sent.list_number}")
    accepted: dict[tuple[str, str], Answer] = {}
    refused: Counter[str] = Counter()
    for item in sent.answers:
        try:
            answer = parse_json(json.dumps(item), Answer)
        except InvalidJsonError as error:
            refused[str(error)] += 1
            continue
        answered = answer.trial, answer.question
        fault = _answer_error(answer, key, key.lists[sent.list_number])
        fault = fault or ("the question was answered before" if answered in accepted else None)
        if fault:
            refused[fault] += 1
        else:
            accepted[answered] = answer
    panel = {one: sent.panel_values[one] for one in key.panel_id_names if one in sent.panel_values}
    return replace(sent, answers=tuple(accepted.values()), panel_values=panel), refused


def _answer_error(answer: Answer, key: StudyKey, trials: Sequence[str]) -> str | None:
    """Return why an answer is invalid for the participant's list; None if it is valid."""
    if answer.trial not in trials:
        return "the trial is not on the participant's list"
    trial = key.trials[answer.trial]
    if answer.question not in trial.questions:
        return "the answered question is not part of the trial"
    if trial.expected is not None:
        return None
    if sorted(answer.videos) != sorted(trial.videos):
        return "the videos shown are not those of the trial"
    if answer.unplayable_video is not None:
        return (
            None if answer.unplayable_video in answer.videos else "the skipped video was not shown"
        )
    if answer.min_complete_plays < 1:
        return "a video was not watched to its end"
    return _fault_of_value(answer, key.question_by_id[answer.question])


def _fault_of_value(answer: Answer, question: Question) -> str | None:
    videos, value = answer.videos, answer.value
    if question.kind == "choice":
        return None if value in (*videos, TIE) else "the chosen video was not shown"
    if question.kind == "ranking":
        is_list = isinstance(value, list) and all(isinstance(item, str) for item in value)
        if not is_list or sorted(value) != sorted(videos):
            return "the ranking does not contain each video exactly once"
    elif not isinstance(value, dict) or set(value) != set(videos):
        return "the rated videos are not those that were shown"
    elif not all(is_number(item) and 0 <= item <= HIGHEST_RATING for item in value.values()):
        return f"a rating is not between 0 and {HIGHEST_RATING}"
    return None


def is_number(value: object) -> bool:
    """Check whether a value is a JSON number; true and false are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _refused_sentence(participant: Participant, refused: Counter[str]) -> str:
    total = len(participant.answers) + refused.total()
    reasons = "; ".join(f"{reason} ({count})" for reason, count in refused.most_common())
    verb = "is" if refused.total() == 1 else "are"
    return (
        f"{participant.file_name}: {refused.total()} of {total} answers {verb} left out: "
        f"{reasons}. The others are used."
    )


_PRECEDENCE = ("has a valid link", "is finished", "is more recent", "has more answers")


def _each_once(
    participants: Sequence[Participant], key: StudyKey
) -> tuple[list[Participant], list[str]]:
    """Select one file per participant, and describe the others.

    Files with a valid link are preferred, if the study has links, then finished ones, then later
    ones: anybody can write a name and a time.
    """

    def standing(one: Participant) -> tuple[bool, bool, datetime, int]:
        is_signed = key.link_error(one.link_token, one.list_number) is None
        is_finished = one.finished is not None
        return is_signed, is_finished, one.finished or one.started, len(one.answers)

    best: dict[str, Participant] = {}
    for one in participants:
        other = best.get(one.id)
        if other is None or standing(one) > standing(other):
            best[one.id] = one
    others = [one for one in participants if one is not best[one.id]]
    under_way = [one for one in others if _is_superseded(one, best[one.id])]
    doubles = []
    for one in (one for one in others if one not in under_way):
        better = best[one.id]
        compared = zip(_PRECEDENCE, standing(better), standing(one), strict=True)
        reason = next((which for which, a, b in compared if a != b), "is equally complete")
        doubles.append(
            f"{one.file_name} is left out: its participant also sent {better.file_name}, "
            f"which {reason}."
        )
    if count := len(under_way):
        files = "file is" if count == 1 else "files are"
        doubles.append(
            f"{count} unfinished {files} left out: later files of the same participant include the "
            "answers."
        )
    return list(best.values()), doubles


def _is_superseded(participant: Participant, better: Participant) -> bool:
    """Check whether an unfinished file is contained in a later one."""
    return participant.finished is None and set(_named(participant)) <= set(_named(better))


def _named(participant: Participant) -> list[tuple[str, str, str]]:
    return [(one.trial, one.question, str(one.value)) for one in participant.answers]


def skipped_trials(participant: Participant) -> set[str]:
    """Return the trials that a participant skipped, as a video could not be played."""
    return {answer.trial for answer in participant.answers if answer.unplayable_video is not None}
