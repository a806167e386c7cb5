"""Plan of a study: a small TOML file, read and checked before anything is made; and its wording."""

from __future__ import annotations

import functools
import itertools
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal, get_args
from urllib.parse import urlsplit

from pydantic import AfterValidator, ConfigDict, Field, PlainValidator, model_validator
from pydantic.dataclasses import dataclass

from app.errors import RunError
from app.study.design.key import MAX_PANEL_IDS, MAX_SYSTEMS, PanelName, Protocol, Question
from conventions.names import PostFilter, pluralise
from conventions.views import VIEWS, View
from model.storage.files import parse_toml, read_within_limit
from model.storage.json_validation import InvalidJsonError, Text, parse_json
from model.systems.registry import families, planning_systems

MAX_LENGTH_S = 120.0
MAX_PLAN_BYTES = 2 * 2**20
_NO_OTHERS = ConfigDict(strict=True, allow_inf_nan=False, extra="forbid", validate_by_name=True)
OWN_PARAMETERS = ("p", "t", "preview")
"""Parameters of the page's address that the page itself uses."""
_SEPARATORS = set(",=")
"""Separators in ``study simulate --strengths``, which names must not contain."""
_PLAIN_URL = re.compile(r"https?://[A-Za-z0-9.\-]+(:\d+)?(/[A-Za-z0-9._~/%\-?=&]*)?")


def _is_name(name: str) -> str:
    is_plain = name.isprintable() and name.strip() == name
    if len(name) > 80 or not is_plain or set(name) & _SEPARATORS:
        raise ValueError(
            "a name must have 1 to 80 printable characters, without commas or equals signs, and "
            f"must not start or end with a space; got {name[:80]!r}"
        )
    return name


def _is_address(url: str) -> str:
    if not (_PLAIN_URL.fullmatch(url) and urlsplit(url).hostname):
        raise ValueError(
            f"{url[:80]!r} is not a valid URL; it must start with http:// or https:// and contain "
            "only letters, digits and . _ ~ / % - ? = &"
        )
    return url


def _relative_path(path: Any, info: Any) -> Path:
    """Parse a path of the plan, relative to the plan's folder."""
    if not isinstance(path, str | Path) or not str(path):
        raise ValueError(f"`{info.field_name}` must name a file")
    return info.context["folder"] / path if info.context else Path(path)


def _files_by_clip(value: Any, info: Any) -> Mapping[str, Path]:
    """Parse paths by clip: a pattern with {clip}, or a table of one path for each clip."""
    if not info.context:
        return value
    what, name, clips = info.field_name, info.data.get("name"), info.context["clips"]
    if isinstance(value, str) and "{clip}" in value:
        value = {clip: value.replace("{clip}", clip) for clip in clips}
    if not isinstance(value, Mapping):
        raise ValueError(
            f"`{what}` must be a path with {{clip}} in it, or a table with a path for each clip"
        )
    for clip in (clip for clip in clips if clip not in value):
        raise ValueError(f"`{what}` of {name!r} has no path for the clip {clip!r}")
    for clip in (clip for clip in value if clip not in clips):
        raise ValueError(
            f"`{what}` of {name!r} contains {clip!r}, which is not a clip of the study"
        )
    return {clip: _relative_path(path, info) for clip, path in value.items()}


def _style(value: Any, info: Any) -> Any:
    """Parse a style: a path of a style file, or the tables of one."""
    from model.plan.plan import PlanError
    from model.plan.style import (  # import torch: only if needed
        StyleChange,
        parse_style,
        read_style_file,
    )

    try:
        if value is None or isinstance(value, StyleChange):
            return value
        return (
            parse_style(value)
            if isinstance(value, Mapping)
            else read_style_file(_relative_path(value, info))
        )
    except PlanError as error:
        raise ValueError(
            f"`style` of {info.data.get('name')!r} cannot be used: {str(error).rstrip('.')}"
        ) from None


def _in_order(views: tuple[View, ...]) -> tuple[View, ...]:
    return tuple(view for view in VIEWS if view in views) or ("front",)


def _no_own_names(names: tuple[str, ...]) -> tuple[str, ...]:
    for name in names:
        if name in OWN_PARAMETERS or names.count(name) > 1:
            raise ValueError(
                f"`panel_ids` contains {name!r}, which is a URL parameter of the page itself; "
                "choose another name"
                if name in OWN_PARAMETERS
                else f"`panel_ids` contains {name!r} twice"
            )
    return names


Name = Annotated[Text, AfterValidator(_is_name)]
PageUrl = Annotated[Text, AfterValidator(_is_address)]
File = Annotated[Path, PlainValidator(_relative_path)]
Files = Annotated[Mapping[str, Path], PlainValidator(_files_by_clip)]
Seed = Annotated[int, Field(ge=0, le=2**31 - 1)]


@dataclass(frozen=True, config=_NO_OTHERS)
class Clip:
    """Excerpt that every system shows."""

    name: Name
    speech: File | None = None
    start_s: Annotated[float, Field(ge=0, le=36_000)] = 0.0
    """Start of the excerpt in the speech and in every motion file (s)."""


@dataclass(frozen=True, config=_NO_OTHERS)
class Condition:
    """Compared condition: motion files by clip, or a bundled system that generates them."""

    name: Name
    motion: Files | None = None
    system: Text | None = None
    """Name of the bundled system, by default that of the condition; None with motion files."""
    seed: Seed = 0
    speaker: Text | None = None
    """Speaker style; None is the first speaker of the system."""
    steps: Annotated[int, Field(ge=1, le=1000)] = 10
    """Number of sampling steps; by default that of the sampler."""
    sampler: str = "euler"
    """Name of a sampler of the system; by default its first."""
    post_filter: PostFilter = "none"
    style: Annotated[Any, PlainValidator(_style)] = None
    """Style change (a `StyleChange`) of the plan that the system performs; None changes nothing."""
    plan: Files | None = None
    """Plan file by clip for the system to perform; None lets it sample plans from the speech."""

    @model_validator(mode="before")
    @classmethod
    def _usual(cls, values: Any) -> Any:
        """Fill in the defaults that depend on the system, and check its name, sampler and plans."""
        if not isinstance(values, dict):
            return values
        name = values.get("name")
        if values.get("motion") is not None:
            for other in sorted(set(values) - {"name", "motion"}):
                raise ValueError(
                    f"the system {name!r} has motion files (`motion`), so it cannot have `{other}`"
                )
            return values
        system = values.get("system", name)
        samplers = {
            sampler.name: sampler.default_steps
            for family in families()
            if system in family.systems
            for sampler in family.samplers_of(system)
        }
        if not samplers:
            system_names = ", ".join(name for family in families() for name in family.systems)
            raise ValueError(f"there is no system {system!r}; the systems are {system_names}")
        sampler = values.get("sampler", next(iter(samplers)))
        if sampler not in list(samplers):
            raise ValueError(f"`sampler` of {name!r} must be one of {', '.join(samplers)}")
        for field in ("plan", "style"):
            if values.get(field) is not None and system not in planning_systems():
                raise ValueError(
                    f"the system {name!r} does not follow gesture plans, so it cannot have "
                    f"`{field}`"
                )
        return {"system": system, "sampler": sampler, "steps": samplers[sampler], **values}


@dataclass(frozen=True, config=_NO_OTHERS)
class StudyPlan:
    """Settings of a study."""

    title: Text
    protocol: Protocol
    participants: Annotated[int, Field(ge=1, le=1000)]
    clips: Annotated[tuple[Clip, ...], Field(min_length=1, max_length=500)]
    conditions: Annotated[tuple[Condition, ...], Field(max_length=MAX_SYSTEMS, alias="systems")]
    format: Literal[1] = 1
    seed: Seed = 0
    views: Annotated[tuple[View, ...], AfterValidator(_in_order)] = ("front",)
    video_s: Annotated[
        Annotated[float, Field(ge=0.5, le=MAX_LENGTH_S)] | None, Field(alias="length_s")
    ] = None
    """Duration of every excerpt and video (s); None uses whole clips, which must
    then be equally long."""
    video_size_px: Annotated[int, Field(ge=64, le=1080, alias="size")] = 512
    """Width and height of a video."""
    face: Literal["still", "moving"] = "still"
    trials_per_participant: Annotated[int, Field(ge=1, le=5000)] | None = None
    """Trials per participant; None gives every participant every trial."""
    attention_checks: Annotated[int, Field(ge=0, le=20)] | None = None
    """Attention checks per list, at most one in ten pages; None is two, or one if two are too many.
    """
    max_failed: Annotated[int, Field(ge=0, le=20)] | None = None
    """Most attention checks that an included participant may fail; None is half of them."""
    asks_reasons: Annotated[bool, Field(validation_alias="reasons")] = True
    """True if the page asks for reasons after a choice; of effect in pairwise studies only."""
    consent: Text | None = None
    """Consent text; None uses that of `questions.toml`."""
    researchers: Text | None = None
    """Names of the researchers, shown to participants."""
    contact: Text | None = None
    """Contact for questions and for answer files that participants send."""
    ethics: Text | None = None
    """Ethics approval: institution and number."""
    panel_id_names: Annotated[
        tuple[PanelName, ...],
        Field(max_length=MAX_PANEL_IDS, alias="panel_ids"),
        AfterValidator(_no_own_names),
    ] = ()
    """Names of parameters of the page's address that are copied into the answers, the participant's
    id first: PROLIFIC_PID, STUDY_ID and SESSION_ID of Prolific. No others are copied."""
    post_to: PageUrl | None = None
    return_to: PageUrl | None = None
    """URL to which participants return at the end, such as Prolific's or SONA's completion link."""

    @property
    def has_sound(self) -> bool:
        """True if videos have sound; realism (pairwise) is judged without."""
        return self.protocol != "pairwise"

    def __post_init__(self) -> None:
        for what, named in (("clips", self.clips), ("systems", self.conditions)):
            names = [each.name for each in named]
            for double in (name for name in names if names.count(name) > 1):
                raise ValueError(f"two {what} have the name {double!r}; rename one")
        least = 1 if self.protocol in ("matched", "rating") else 2
        if len(self.conditions) < least:
            raise ValueError(
                f"the protocol {self.protocol!r} needs at least {pluralise(least, 'system')}; the "
                f"study plan has {len(self.conditions)}"
            )
        if self.protocol == "matched" and len(self.clips) < 2:
            raise ValueError(
                "the protocol 'matched' needs at least 2 clips, as each motion is also shown with "
                "the speech of another clip"
            )
        made = [system for system in self.conditions if system.motion is None]
        for clip in self.clips if self.has_sound or made else ():
            if clip.speech is None:
                raise ValueError(
                    f"the clip {clip.name!r} has no `speech`, which may be omitted only in a "
                    "pairwise study whose systems all have motion files"
                )
        for one, other in itertools.combinations(made, 2):
            if all(getattr(one, f.name) == getattr(other, f.name) for f in fields(one)[1:]):
                raise ValueError(
                    f"the systems {one.name!r} and {other.name!r} have the same settings; change "
                    "the seed or another setting of one of them"
                )


def read_study_plan(path: Path) -> StudyPlan:
    """Read a plan, with paths relative to its folder; raises RunError if missing or invalid."""
    if not path.exists():
        raise RunError(f"There is no study plan at {path}.")
    content = read_within_limit(path, MAX_PLAN_BYTES, RunError)
    try:
        content_table = parse_toml(content.decode("utf-8"))
    except ValueError as error:
        raise RunError(f"{path.name} is not a TOML file: {error}.") from error
    clips = content_table.get("clips")
    tables = [clip for clip in clips if isinstance(clip, dict)] if isinstance(clips, list) else []
    names = [name for clip in tables if isinstance(name := clip.get("name"), str)]
    try:
        return parse_json(
            json.dumps(content_table, default=str),
            StudyPlan,
            {"folder": path.parent, "clips": names},
        )
    except InvalidJsonError as error:
        raise RunError(f"The study plan {path.name} cannot be used: {error}.") from error


Choice = Literal["left", "right", "tie"]
CHOICES: tuple[Choice, ...] = get_args(Choice)
ATTENTION_QUESTION = "attention"


@functools.cache
def load_wording() -> dict[str, Any]:
    """Return all sentences for participants, from `questions.toml`."""
    return tomllib.loads(Path(__file__).with_name("questions.toml").read_text("utf-8"))


def protocol_questions(protocol: str) -> tuple[Question, ...]:
    """Return the questions of each trial of a protocol."""
    return tuple(Question(**item) for item in load_wording()["protocols"][protocol]["questions"])
