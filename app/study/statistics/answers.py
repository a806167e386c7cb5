"""Answers of participants: read, checked against the key, doubles settled."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.study.design.fields import FieldError, Fields, is_number, is_text, read_object
from app.study.design.key import MAX_QUESTIONS, MAX_VIDEOS_OF_TRIAL, Key, Question
from app.study.design.links import doubt_of

FORMAT = 1
TIE = "tie"
TRUTH_NAME = "truth.json"
"""What a simulation writes beside its answers; passed over in folders."""

MAX_FILES = 10_000
MAX_FILE_BYTES = 4 * 2**20
MAX_ANSWERS = 10_000
MAX_REASONS = 32
MAX_COUNT = 10**9
HIGHEST_RATING = 100


@dataclass(frozen=True)
class Answer:
    """One answer to one question of one trial."""

    trial: str
    question: str
    shown: tuple[str, ...]
    """Blind ids from left to right."""
    value: Any
    """Blind id or `TIE`; blind ids, best first; or blind id -> rating; anything in checks."""
    reasons: tuple[str, ...] = ()
    ms: int = 0
    """Spent on the page of the trial."""


@dataclass(frozen=True)
class Participant:
    """What one person sent; every answer fits the key."""

    id: str
    source: str
    """Name of the file."""
    list_number: int
    finished: datetime | None
    started: datetime
    answers: tuple[Answer, ...]
    headphones: str | None = None
    link: str | None = None
    """Token of the link by which they came."""


@dataclass(frozen=True)
class Collected:
    """All participants of a study, each once, and a sentence for everything left out."""

    participants: tuple[Participant, ...]
    left_out: tuple[str, ...]


def collect(paths: Iterable[Path], key: Key) -> Collected:
    """Read files and folders of answers; what cannot be used costs a sentence, not the rest.

    Raises:
        RunError: if a path does not exist or there are too many files.
    """
    participants: list[Participant] = []
    left_out: list[str] = []
    for path in _files(paths):
        try:
            participant, refused = participant_of(
                read_object(path, MAX_FILE_BYTES), key, source=path.name
            )
        except FieldError as error:
            left_out.append(f"{path.name} is left out: {error}.")
            continue
        participants.append(participant)
        if refused:
            left_out.append(_refused_sentence(participant, refused))
    kept, doubles = _each_once(participants, key)
    return Collected(tuple(kept), tuple(left_out + doubles))


def _files(paths: Iterable[Path]) -> list[Path]:
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside = (file for file in sorted(path.rglob("*.json")) if file.name != TRUTH_NAME)
            files.extend(file for file in inside if file.is_file())
        elif path.is_file():
            files.append(path)
        else:
            raise RunError(f"There are no answers at {path}; name files or folders that exist.")
        if len(files) > MAX_FILES:
            raise RunError(f"There are over {MAX_FILES:,} files; analyse one study at a time.")
    return list(dict.fromkeys(file.resolve() for file in files))


def participant_of(fields: Fields, key: Key, source: str) -> tuple[Participant, Counter[str]]:
    """One participant, and why answers were refused with how many there were of each reason.

    Raises:
        FieldError: if nothing of the file can be used.
    """
    if fields.raw("format") != FORMAT or not isinstance(fields.raw("study"), str):
        raise FieldError("it is no answers file of a study")
    if fields.raw("study") != key.study:
        raise FieldError("it belongs to another study")
    list_number = fields.whole("list", 0, MAX_COUNT)
    if list_number not in key.lists:
        raise FieldError(f"the study has no list {list_number}")
    accepted: dict[tuple[str, str], Answer] = {}
    refused: Counter[str] = Counter()
    for item in fields.objects("answers", MAX_ANSWERS):
        try:
            answer = _answer_of(item, key, key.lists[list_number])
            if (answer.trial, answer.question) in accepted:
                raise FieldError("the question was answered before")
            accepted[answer.trial, answer.question] = answer
        except FieldError as error:
            refused[str(error)] += 1
    headphones = fields.raw("headphones")
    participant = Participant(
        id=fields.text("participant"),
        source=source,
        list_number=list_number,
        finished=_time(fields, "finished") if fields.raw("finished") is not None else None,
        started=_time(fields, "started"),
        answers=tuple(accepted.values()),
        headphones=headphones if is_text(headphones) else None,
        link=fields.text_or_none("link"),
    )
    return participant, refused


def _time(fields: Fields, name: str) -> datetime:
    try:
        time = datetime.fromisoformat(fields.text(name))
    except ValueError as error:
        raise FieldError(f"`{name}` must be a time in ISO form") from error
    return time if time.tzinfo else time.replace(tzinfo=UTC)


def _answer_of(item: Fields, key: Key, trials: tuple[str, ...]) -> Answer:
    trial_id = item.text("trial")
    if trial_id not in trials:
        raise FieldError("its trial is not on the participant's list")
    trial = key.trials[trial_id]
    answer = Answer(
        trial=trial_id,
        question=item.text("question"),
        shown=item.texts("shown", MAX_VIDEOS_OF_TRIAL),
        value=item.raw("value"),
        reasons=item.texts("reasons", MAX_REASONS) if item.raw("reasons") else (),
        ms=item.whole("ms", 0, MAX_COUNT) if item.raw("ms") is not None else 0,
    )
    if trial.expected is not None:
        if answer.question != trial.expected.question:
            raise FieldError("its trial does not ask that question")
        return answer
    if answer.question not in trial.questions[:MAX_QUESTIONS]:
        raise FieldError("its trial does not ask that question")
    if sorted(answer.shown) != sorted(trial.videos):
        raise FieldError("the videos shown are not those of its trial")
    if item.whole("watched", 0, MAX_COUNT) < 1:
        raise FieldError("a video was not watched to its end")
    _check_value(answer, key.question_by_id[answer.question])
    return answer


def _check_value(answer: Answer, question: Question) -> None:
    shown, value = answer.shown, answer.value
    if question.kind == "choice":
        if value not in (*shown, TIE):
            raise FieldError("the answer is not among the videos shown")
    elif question.kind == "ranking":
        is_list = isinstance(value, list) and all(is_text(item) for item in value)
        if not is_list or sorted(value) != sorted(shown):
            raise FieldError("the ranking does not hold each video shown once")
    elif not isinstance(value, dict) or set(value) != set(shown):
        raise FieldError("the ratings are not those of the videos shown")
    elif not all(is_number(item) and 0 <= item <= HIGHEST_RATING for item in value.values()):
        raise FieldError(f"a rating is not between 0 and {HIGHEST_RATING}")


def _refused_sentence(participant: Participant, refused: Counter[str]) -> str:
    total = len(participant.answers) + refused.total()
    reasons = "; ".join(f"{reason} ({count})" for reason, count in refused.most_common())
    verb = "is" if refused.total() == 1 else "are"
    return (
        f"{participant.source}: {refused.total()} of {total} answers {verb} left out, "
        f"the others count: {reasons}."
    )


def _each_once(
    participants: Sequence[Participant], key: Key
) -> tuple[list[Participant], list[str]]:
    """Of files by one participant those that came by a link of the study, where it has links, of
    those the finished one, of those the later one: anybody can write a name and a time."""
    signed = {id(one) for one in participants if doubt_of(key, one.link, one.list_number) is None}

    def standing(participant: Participant) -> tuple[bool, bool, datetime, int]:
        return (id(participant) in signed, *_standing(participant))

    best: dict[str, Participant] = {}
    for participant in participants:
        other = best.get(participant.id)
        if other is None or standing(participant) > standing(other):
            best[participant.id] = participant
    others = [one for one in participants if one is not best[one.id]]
    under_way = [one for one in others if _is_part(one, best[one.id])]
    doubles = []
    for one in (one for one in others if one not in under_way):
        better = best[one.id]
        is_forged = id(better) in signed and id(one) not in signed
        why = "came by a signed link" if is_forged else f"is {_why(one, better)}"
        doubles.append(
            f"{one.source} is left out: its participant also sent {better.source}, which {why}."
        )
    if under_way:
        count = len(under_way)
        doubles.append(
            f"{count} {'file' if count == 1 else 'files'} of answers under way, all of them also "
            "in later ones."
        )
    return list(best.values()), doubles


def _is_part(participant: Participant, better: Participant) -> bool:
    """Whether it was sent after some page of what was sent whole later."""
    return participant.finished is None and set(_named(participant)) <= set(_named(better))


def _named(participant: Participant) -> list[tuple[str, str, str]]:
    return [(one.trial, one.question, str(one.value)) for one in participant.answers]


def _standing(participant: Participant) -> tuple[bool, datetime, int]:
    is_finished = participant.finished is not None
    return is_finished, participant.finished or participant.started, len(participant.answers)


def _why(participant: Participant, better: Participant) -> str:
    if participant.finished is None and better.finished is not None:
        return "finished"
    if _standing(participant) == _standing(better):
        return "its equal"
    return "later" if _standing(participant)[1] != _standing(better)[1] else "longer"
