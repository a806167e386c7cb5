"""Researcher's key of a study: system and clip of each blind video, and the secret of signed links.

The page, which anyone can read, cannot verify a link: it copies the token into the answers, and the
analysis verifies it.
"""

from __future__ import annotations

import hashlib
import hmac
import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import urlencode, urlsplit

from pydantic import Field
from pydantic.dataclasses import dataclass

from app.errors import RunError
from model.storage.files import written_atomically
from model.storage.json_validation import STRICT, InvalidJsonError, Text, read_json, type_adapter

Protocol = Literal["pairwise", "matched", "ranking", "rating"]
TrialKind = Literal["pair", "match", "rank", "rate", "attention"]
KIND_OF_PROTOCOL: dict[Protocol, TrialKind] = {
    **{"pairwise": "pair", "matched": "match", "ranking": "rank", "rating": "rate"}
}
MAX_KEY_BYTES = 64 * 2**20
MAX_SYSTEMS = 32
MAX_TRIALS_OF_LIST = 2000
MAX_PARTICIPANTS = 10_000
MAX_LINKS = 10_000
_SIGNATURE_HEX = 32

PanelName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]{0,39}$")]
"""Name of an id in the address, such as PROLIFIC_PID."""
PanelValue = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.~\-]{1,64}$")]
MAX_PANEL_IDS = 8
Ids = Annotated[tuple[Text, ...], Field(max_length=32)]
Systems = Annotated[tuple[Text, ...], Field(min_length=1, max_length=MAX_SYSTEMS)]
List = Annotated[tuple[Text, ...], Field(max_length=MAX_TRIALS_OF_LIST)]
ListNumber = Annotated[int, Field(ge=0)]


@dataclass(frozen=True, config=STRICT)
class Question:
    id: Text
    text: Text
    kind: Literal["choice", "ranking", "slider"]


@dataclass(frozen=True, order=True, config=STRICT)
class Stimulus:
    """System, clip, speech and view of a video."""

    system: Text
    clip: Text
    speech_clip: Annotated[Text | None, Field(alias="speech")]
    """Clip with the speech that is played; None for a muted video."""
    view: Text

    @property
    def has_own_speech(self) -> bool:
        """True if the motion's own speech is played; false also for a muted video."""
        return self.speech_clip == self.clip


@dataclass(frozen=True, config=STRICT)
class Video(Stimulus):
    """Stimulus behind a blind id."""

    sha256: Text


@dataclass(frozen=True, config=STRICT)
class ExpectedAnswer:
    """Answer that an attention check expects."""

    question: Text
    value: Text | float


@dataclass(frozen=True, config=STRICT)
class Trial:
    """Trial: one page of the study."""

    kind: TrialKind
    clip: Text
    videos: Ids
    """Blind ids of the videos."""
    questions: Ids
    expected: ExpectedAnswer | None = None
    """Expected answer; only of attention checks."""


@dataclass(frozen=True, config=STRICT)
class AttentionRule:
    """Exclusion of participants by failed attention checks."""

    max_failed: Annotated[int, Field(ge=0, le=MAX_TRIALS_OF_LIST)]
    """Most attention checks that an included participant may fail."""


@dataclass(frozen=True, config=STRICT)
class StudyKey:
    """Everything that participants must not know; consistent, without dangling ids."""

    study_id: Annotated[Text, Field(alias="study")]
    """Id of 16 hexadecimal digits, also in the answers."""
    title: Text
    protocol: Protocol
    systems: Systems
    questions: Annotated[tuple[Question, ...], Field(min_length=1, max_length=32)]
    videos: Mapping[Text, Video]
    trials: Mapping[Text, Trial]
    lists: Annotated[Mapping[ListNumber, List], Field(max_length=MAX_PARTICIPANTS)]
    """Trial ids of each list, in order."""
    attention_rule: AttentionRule
    num_participants_planned: Annotated[int, Field(ge=1, le=MAX_PARTICIPANTS, alias="participants")]
    video_s: Annotated[float, Field(gt=0, le=3600)] | None = None
    """Duration of each video (s); None if they differ."""
    panel_id_names: Annotated[
        tuple[PanelName, ...], Field(max_length=MAX_PANEL_IDS, alias="panel_ids")
    ] = ()
    """Names of ids that the page copies from its address into answers, the participant's first."""
    link_secret: Text | None = None
    """Secret that signs participants' links; None if answers need no links."""
    inputs_digest: Annotated[Text | None, Field(alias="made_of")] = None
    """Digest of plan, files and weights, by which an interrupted export is resumed."""
    format: Literal[1] = 1

    def __post_init__(self) -> None:
        if len(set(self.systems)) < len(self.systems):
            raise ValueError("`systems` must have different names")
        if len(self.question_by_id) < len(self.questions):
            raise ValueError("`questions` must have different ids")
        for name, video in self.videos.items():
            if video.system not in self.systems:
                raise ValueError(
                    f"video {name} shows {video.system!r}, which is not a system of the study"
                )
        for name, trial in self.trials.items():
            is_check = trial.kind == "attention"
            if not self.videos.keys() >= set(trial.videos):
                raise ValueError(f"trial {name} shows a video that is not in the key")
            if (trial.expected is not None) != is_check:
                raise ValueError(
                    f"trial {name} has no expected answer, but is an attention check"
                    if is_check
                    else f"trial {name} has an expected answer, but is not an attention check"
                )
            if not is_check and not self.question_by_id.keys() >= set(trial.questions):
                raise ValueError(f"trial {name} asks a question that is not in the key")
        for number, trials in self.lists.items():
            if not self.trials.keys() >= set(trials):
                raise ValueError(f"list {number} contains a trial that is not in the key")

    @cached_property
    def question_by_id(self) -> dict[str, Question]:
        return {question.id: question for question in self.questions}

    @property
    def max_failed(self) -> int:
        return self.attention_rule.max_failed

    @cached_property
    def clips(self) -> tuple[str, ...]:
        """Names of the clips in trials that are not attention checks, sorted."""
        judged = {trial.clip for trial in self.trials.values() if trial.expected is None}
        return tuple(sorted(judged))

    def token(self, participant: int) -> str:
        """Return a link's token: the participant and 128 bits of its HMAC-SHA256 by the secret."""
        assert self.link_secret is not None
        message = f"{self.study_id}/{participant}".encode()
        signature = hmac.new(self.link_secret.encode(), message, hashlib.sha256).hexdigest()
        return f"{participant}-{signature[:_SIGNATURE_HEX]}"

    def list_number_of(self, participant: int) -> int:
        """Return the list of a participant: the lists in turn, then from the first again."""
        return sorted(self.lists)[participant % len(self.lists)]

    def link(self, participant: int, address: str) -> str:
        """Return the link of a participant.

        Args:
            address: URL of the hosted bundle.

        Raises:
            RunError: if the address is not a URL of a page.
        """
        parts = urlsplit(address)
        is_page = parts.scheme in ("http", "https") and parts.netloc
        if not is_page or parts.query or parts.fragment:
            raise RunError(
                f"{address!r} is not the URL of a page; it should look like "
                "https://lab.example/study/."
            )
        query = {"p": self.list_number_of(participant), "t": self.token(participant)}
        return f"{address}?{urlencode(query)}"

    def link_error(self, token: str | None, list_number: int) -> str | None:
        """Return why a link is invalid, as the end of a sentence; None if valid or not needed."""
        if self.link_secret is None:
            return None
        if token is None:
            return "the answers came without a signed link"
        number = token.partition("-")[0]
        is_number = number.isascii() and number.isdecimal() and len(number) <= len(str(MAX_LINKS))
        if not is_number or not hmac.compare_digest(
            self.token(int(number)).encode(), token.encode()
        ):
            return "the signature of the link is invalid"
        if self.list_number_of(int(number)) != list_number:
            return "the link is for another list of trials"
        return None


def read_key(path: Path) -> StudyKey:
    """Read and check the key at ``path``; raises RunError if it is missing or invalid."""
    if not path.is_file():
        raise RunError(
            f"There is no file {path}. The key is key.json in the folder `researcher_only`."
        )
    try:
        return read_json(path, StudyKey, MAX_KEY_BYTES)
    except InvalidJsonError as error:
        raise RunError(
            f"{path.name} is not a valid study key: {error}. Use the file that the export wrote."
        ) from error


def write_key(key: StudyKey, path: Path) -> None:
    """Write the key atomically; only its owner may read it."""
    written = {
        "format": key.format,
        **type_adapter(StudyKey).dump_python(key, mode="json", by_alias=True),
    }
    for trial in written["trials"].values():
        if trial["expected"] is None:
            del trial["expected"]
    for name in ("link_secret", "made_of", "panel_ids"):
        if not written[name]:
            del written[name]
    with written_atomically(path) as part:
        part.touch(mode=0o600)
        part.write_text(json.dumps(written, indent=1, allow_nan=False) + "\n", "utf-8")
