"""The researcher's key of a study: which system and clip each blind video shows."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.study.design.fields import FieldError, Fields, is_number, is_text, read_object
from model.storage.files import written_atomically

FORMAT = 1
PROTOCOLS = ("pairwise", "matched", "ranking", "rating")
QUESTION_KINDS = ("choice", "ranking", "slider")
TRIAL_KINDS = ("pair", "match", "rank", "rate", "attention")

MAX_KEY_BYTES = 64 * 2**20
MAX_SYSTEMS = 32
MAX_VIDEOS_OF_TRIAL = 32
MAX_QUESTIONS = 32
MAX_TRIALS_OF_LIST = 2000
MAX_PARTICIPANTS = 10_000
MAX_VIDEO_S = 3600.0


@dataclass(frozen=True)
class Question:
    """What a trial asks."""

    id: str
    text: str
    kind: str
    """One of `QUESTION_KINDS`."""


@dataclass(frozen=True)
class Video:
    """What stands behind a blind id."""

    system: str
    clip: str
    speech: str | None
    """Clip whose speech is heard; None when muted."""
    view: str
    sha256: str

    @property
    def is_matched(self) -> bool:
        """Whether the speech is the one that the motion belongs to."""
        return self.speech == self.clip


@dataclass(frozen=True)
class Expected:
    """What an attention check says to press."""

    question: str
    value: str | float


@dataclass(frozen=True)
class Trial:
    """One page of the study."""

    kind: str
    """One of `TRIAL_KINDS`."""
    clip: str
    videos: tuple[str, ...]
    """Blind ids of what is shown."""
    questions: tuple[str, ...]
    expected: Expected | None = None
    """For attention checks alone."""


@dataclass(frozen=True)
class Key:
    """Everything that participants must not know. Consistent: every id that it uses it has."""

    study: str
    """16 hexadecimal digits, also in the answers."""
    title: str
    protocol: str
    """One of `PROTOCOLS`."""
    systems: tuple[str, ...]
    questions: tuple[Question, ...]
    videos: Mapping[str, Video]
    trials: Mapping[str, Trial]
    lists: Mapping[int, tuple[str, ...]]
    """Trials of participant p, in order."""
    max_failed: int
    """Attention checks that a participant may fail and still count."""
    participants: int
    """How many are planned."""
    video_s: float | None = None
    """How long each video lasts; None where they differ."""
    link_secret: str | None = None
    """Signs participants' links; None where answers need none (`app.study.design.links`)."""

    def __post_init__(self) -> None:
        """
        Raises:
            FieldError: if an id points nowhere or a name is not among those allowed.
        """
        _check_names(self)
        for video_id, video in self.videos.items():
            if video.system not in self.systems:
                raise FieldError(f"video {video_id} shows {video.system!r}, which is no system")
        for trial_id, trial in self.trials.items():
            _check_trial(self, trial_id, trial)
        for number, trials in self.lists.items():
            if any(trial not in self.trials for trial in trials):
                raise FieldError(f"list {number} names a trial that the key does not have")

    @cached_property
    def question_by_id(self) -> dict[str, Question]:
        return {question.id: question for question in self.questions}


def _check_names(key: Key) -> None:
    if key.protocol not in PROTOCOLS:
        raise FieldError(f"the protocol {key.protocol!r} is none of {', '.join(PROTOCOLS)}")
    if not 1 <= len(set(key.systems)) == len(key.systems) <= MAX_SYSTEMS:
        raise FieldError(f"there must be 1 to {MAX_SYSTEMS} systems with different names")
    ids = [question.id for question in key.questions]
    if not 1 <= len(set(ids)) == len(ids) <= MAX_QUESTIONS:
        raise FieldError(f"there must be 1 to {MAX_QUESTIONS} questions with different ids")


def _check_trial(key: Key, trial_id: str, trial: Trial) -> None:
    if any(video not in key.videos for video in trial.videos):
        raise FieldError(f"trial {trial_id} shows a video that the key does not have")
    if (trial.expected is not None) != (trial.kind == "attention"):
        raise FieldError(f"trial {trial_id}: attention checks, and only they, expect an answer")
    known = {question.id for question in key.questions}
    if trial.kind != "attention" and not known.issuperset(trial.questions):
        raise FieldError(f"trial {trial_id} asks a question that the key does not have")


def read_key(path: Path) -> Key:
    """The key at ``path``, checked.

    Raises:
        RunError: if it is missing, damaged or contradicts itself.
    """
    if not path.is_file():
        raise RunError(f"There is no key at {path}; name the key.json of `researcher_only`.")
    try:
        return _key_of(read_object(path, MAX_KEY_BYTES))
    except FieldError as error:
        raise RunError(
            f"{path.name} is not the key of a study: {error}; use the file that the export wrote."
        ) from error


def write_key(key: Key, path: Path) -> None:
    """Write it so that no half-written key ever stands at ``path``; only its owner may read it."""
    with written_atomically(path) as part:
        part.touch(mode=0o600)
        part.write_text(json.dumps(_json_of(key), indent=1, allow_nan=False) + "\n", "utf-8")


def _key_of(fields: Fields) -> Key:
    if fields.raw("format") != FORMAT:
        raise FieldError(f"`format` must be {FORMAT}")
    return Key(
        study=fields.text("study"),
        title=fields.text("title"),
        protocol=fields.one_of("protocol", PROTOCOLS),
        systems=fields.texts("systems", MAX_SYSTEMS),
        questions=tuple(
            Question(item.text("id"), item.text("text"), item.one_of("kind", QUESTION_KINDS))
            for item in fields.objects("questions", MAX_QUESTIONS)
        ),
        videos={name: _video_of(item) for name, item in fields.named_objects("videos").items()},
        trials={name: _trial_of(item) for name, item in fields.named_objects("trials").items()},
        lists=_lists_of(fields.inner("lists")),
        max_failed=fields.inner("attention_rule").whole("max_failed", 0, MAX_TRIALS_OF_LIST),
        participants=fields.whole("participants", 1, MAX_PARTICIPANTS),
        video_s=_seconds(fields.raw("video_s")),
        link_secret=fields.text_or_none("link_secret"),
    )


def _seconds(value: Any) -> float | None:
    if value is None:
        return None
    if not is_number(value) or not 0 < value <= MAX_VIDEO_S:
        raise FieldError(f"`video_s` must be a number up to {MAX_VIDEO_S:g}")
    return float(value)


def _video_of(item: Fields) -> Video:
    return Video(
        system=item.text("system"),
        clip=item.text("clip"),
        speech=item.text_or_none("speech"),
        view=item.text("view"),
        sha256=item.text("sha256"),
    )


def _trial_of(item: Fields) -> Trial:
    expected = None
    if item.raw("expected") is not None:
        inner = item.inner("expected")
        value = inner.raw("value")
        if not (is_text(value) or is_number(value)):
            raise FieldError("an expected `value` must be a text or a number")
        expected = Expected(inner.text("question"), value)
    return Trial(
        kind=item.one_of("kind", TRIAL_KINDS),
        clip=item.text("clip"),
        videos=item.texts("videos", MAX_VIDEOS_OF_TRIAL),
        questions=item.texts("questions", MAX_QUESTIONS),
        expected=expected,
    )


def _lists_of(fields: Fields) -> dict[int, tuple[str, ...]]:
    names = fields.names()
    if len(names) > MAX_PARTICIPANTS or not all(name.isdecimal() for name in names):
        raise FieldError(f"`lists` must have at most {MAX_PARTICIPANTS} numbers as names")
    return {int(name): fields.texts(name, MAX_TRIALS_OF_LIST) for name in names}


def _json_of(key: Key) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "study": key.study,
        "title": key.title,
        "protocol": key.protocol,
        "systems": list(key.systems),
        "questions": [vars(question) for question in key.questions],
        "videos": {name: vars(video) for name, video in key.videos.items()},
        "trials": {name: _trial_json(trial) for name, trial in key.trials.items()},
        "lists": {str(number): list(trials) for number, trials in key.lists.items()},
        "attention_rule": {"max_failed": key.max_failed},
        "participants": key.participants,
        "video_s": key.video_s,
        **({} if key.link_secret is None else {"link_secret": key.link_secret}),
    }


def _trial_json(trial: Trial) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "kind": trial.kind,
        "clip": trial.clip,
        "videos": list(trial.videos),
        "questions": list(trial.questions),
    }
    if trial.expected is not None:
        fields["expected"] = vars(trial.expected)
    return fields
