"""The plan of a study: a small TOML file, read and checked before anything is made; its wording."""

from __future__ import annotations

import functools
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from app.errors import RunError
from app.study.design.fields import FieldError, Fields, is_number
from app.study.design.key import MAX_SYSTEMS, PROTOCOLS, Question
from conventions.names import POST_FILTERS, PostFilter
from conventions.views import VIEWS, View
from model.systems.registry import families, planning_systems

if TYPE_CHECKING:
    from model.plan.style import StyleWish

FORMAT = 1
MAX_PLAN_BYTES = 1 << 20
MAX_CLIPS = 500
MAX_TRIALS = 5000
MAX_LENGTH_S = 120.0
FACES = ("still", "moving")

_SEPARATORS = set(",=")
"""Of what `study simulate --strengths` is given."""
_KEY_PART = r"""(?>[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_DEEP_KEY = re.compile(rf"(?<![\w-]){_KEY_PART}(?:[ \t]*\.[ \t]*{_KEY_PART}){{20}}")
_PLAIN_URL = re.compile(r"https?://[A-Za-z0-9.\-]+(:\d+)?(/[A-Za-z0-9._~/%\-?=&]*)?")


@dataclass(frozen=True)
class Clip:
    """One excerpt that every system shows."""

    name: str
    speech: Path | None
    start_s: float
    """Where the excerpt begins, in the speech and in every motion file."""


@dataclass(frozen=True)
class Generator:
    """How a bundled system makes its motions."""

    system: str
    seed: int = 0
    speaker: str | None = None
    """None is the first speaker that the system knows."""
    steps: int = 10
    sampler: str = "euler"
    """One of the system's own."""
    post_filter: PostFilter = "none"
    style: StyleWish | None = None
    """What is done to the plan that the system performs; None leaves it."""


@dataclass(frozen=True)
class PlannedSystem:
    """One condition: motion files by clip, or a system that generates them."""

    name: str
    motions: Mapping[str, Path] | None = None
    generator: Generator | None = None
    plans: Mapping[str, Path] | None = None
    """By clip what the system performs; None lets it draw plans from the speech."""


@dataclass(frozen=True)
class Plan:
    """Everything a study is made from."""

    title: str
    protocol: str
    clips: tuple[Clip, ...]
    systems: tuple[PlannedSystem, ...]
    participants: int
    seed: int = 0
    views: tuple[View, ...] = ("front",)
    length_s: float | None = None
    """Length of every excerpt; None takes clips whole, and then all their lengths must agree."""
    size: int = 512
    """Width and height of a video, pixels."""
    face: str = "still"
    trials_per_participant: int | None = None
    """None gives every participant every trial."""
    attention_checks: int = 2
    max_failed: int = 1
    has_reasons: bool = True
    consent: str | None = None
    """In place of the text in `questions.toml`."""
    post_to: str | None = None
    return_to: str | None = None
    """Where participants go at the end: the completion link of Prolific, SONA or the like."""
    hosted_at: str = ""
    """Address of the folder with `media/`, for the configurations of other tools."""

    @property
    def has_sound(self) -> bool:
        """Realism is judged without sound, everything else with it."""
        return self.protocol != "pairwise"


_PLAN_KEYS = {
    *("format", "title", "protocol", "clips", "systems", "participants", "seed", "views"),
    *("length_s", "size", "face", "trials_per_participant", "attention_checks", "max_failed"),
    *("reasons", "consent", "post_to", "return_to", "hosted_at"),
}
_CLIP_KEYS = {"name", "speech", "start_s"}
_SYSTEM_KEYS = {
    *("name", "motion", "system", "seed", "speaker", "steps", "sampler", "post_filter"),
    *("plan", "style"),
}


def read_plan(path: Path) -> Plan:
    """The plan at ``path``. Paths inside it are relative to its folder.

    Raises:
        RunError: if it is missing or asks for something that cannot be.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise RunError(f"There is no plan at {path}.") from None
    except OSError as error:
        raise RunError(f"The plan {path} cannot be read: {error.strerror}.") from error
    try:
        if len(content) > MAX_PLAN_BYTES:
            raise FieldError(f"it is larger than {MAX_PLAN_BYTES:,} bytes")
        plan = _plan_of(Fields(_parsed(content.decode("utf-8"))), path.parent)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RunError(f"{path.name} is no TOML file: {error}.") from error
    except FieldError as error:
        raise RunError(f"The plan {path.name} cannot be used: {error}.") from error
    check_plan(plan)
    return plan


def _parsed(text: str) -> dict[str, Any]:
    """
    Raises:
        TOMLDecodeError: if it is no TOML.
        FieldError: if it is TOML that no plan needs and no parser bears.
    """
    if _DEEP_KEY.search(text):  # its parser takes the square of a key's parts
        raise FieldError("it has a key of over 20 parts with dots between them")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError as error:
        raise FieldError("it is nested too deeply") from error
    except ValueError as error:  # of integers with thousands of digits
        raise FieldError("it holds a number with far too many digits") from error


def check_plan(plan: Plan) -> None:
    """Refuse what needs no other file to be seen as wrong.

    Raises:
        RunError: with one sentence.
    """
    for what, names in (
        ("clips", [clip.name for clip in plan.clips]),
        ("systems", [system.name for system in plan.systems]),
    ):
        double = next((name for name in names if names.count(name) > 1), None)
        if double is not None:
            raise RunError(f"Two {what} of the plan have the name {double!r}; rename one.")
    least = 1 if plan.protocol in ("matched", "rating") else 2
    if len(plan.systems) < least:
        raise RunError(
            f"The protocol {plan.protocol} compares at least {least} systems; "
            f"the plan has {len(plan.systems)}."
        )
    if plan.protocol == "matched" and len(plan.clips) < 2:
        raise RunError("The protocol matched needs at least 2 clips, to have other speech to play.")
    needs_speech = plan.has_sound or any(system.generator for system in plan.systems)
    silent = next((clip.name for clip in plan.clips if clip.speech is None), None)
    if needs_speech and silent is not None:
        raise RunError(
            f"The clip {silent!r} has no `speech`; only a pairwise study of motion files does "
            "without."
        )
    for index, system in enumerate(plan.systems):
        for other in plan.systems[:index]:
            is_same = (system.generator, system.plans) == (other.generator, other.plans)
            if system.generator is not None and is_same:
                raise RunError(
                    f"The systems {other.name!r} and {system.name!r} are the same: "
                    "give one another seed or setting."
                )


def _plan_of(fields: Fields, folder: Path) -> Plan:
    _only(fields, _PLAN_KEYS, "the plan")
    if fields.raw("format") not in (None, FORMAT):
        raise FieldError(f"`format` must be {FORMAT}")
    clips = tuple(_clip_of(item, folder) for item in fields.objects("clips", MAX_CLIPS))
    if not clips:
        raise FieldError("it has no [[clips]]")
    names = [clip.name for clip in clips]
    post_to = fields.text_or_none("post_to")
    return_to = fields.text_or_none("return_to")
    hosted_at = fields.text_or_none("hosted_at") or ""
    addresses = {"post_to": post_to, "return_to": return_to, "hosted_at": hosted_at}
    for name, url in addresses.items():
        if url and not (_PLAIN_URL.fullmatch(url) and urlsplit(url).hostname):
            raise FieldError(f"`{name}` must be an http or https address; it is {url[:80]!r}")
    return Plan(
        title=fields.text("title"),
        protocol=fields.one_of("protocol", PROTOCOLS),
        clips=clips,
        systems=tuple(
            _system_of(item, folder, names) for item in fields.objects("systems", MAX_SYSTEMS)
        ),
        participants=_whole(fields, "participants", 1, 1000),
        seed=_whole(fields, "seed", 0, 2**31 - 1, 0),
        views=_views_of(fields),
        length_s=_number_or_none(fields, "length_s", 0.5, MAX_LENGTH_S),
        size=_whole(fields, "size", 64, 1080, 512),
        face=_choice(fields, "face", FACES, "still"),
        trials_per_participant=_whole_or_none(fields, "trials_per_participant", 1, MAX_TRIALS),
        attention_checks=_whole(fields, "attention_checks", 0, 20, 2),
        max_failed=_whole(fields, "max_failed", 0, 20, 1),
        has_reasons=_flag(fields, "reasons", True),
        consent=fields.text_or_none("consent"),
        post_to=post_to,
        return_to=return_to,
        hosted_at=hosted_at,
    )


def _clip_of(item: Fields, folder: Path) -> Clip:
    _only(item, _CLIP_KEYS, "a clip")
    speech = item.text_or_none("speech")
    return Clip(
        name=_name_of(item),
        speech=None if speech is None else folder / speech,
        start_s=_number_or_none(item, "start_s", 0.0, 36_000.0) or 0.0,
    )


def _system_of(item: Fields, folder: Path, clips: list[str]) -> PlannedSystem:
    _only(item, _SYSTEM_KEYS, "a system")
    name = _name_of(item)
    if item.raw("motion") is not None:
        extra = sorted(set(item.names()) - {"name", "motion"})
        if extra:
            raise FieldError(f"the system {name!r} has `motion`, so it cannot have `{extra[0]}`")
        return PlannedSystem(name, motions=_files_of(item, "motion", name, folder, clips))
    system = item.text_or_none("system") or name
    samplers = _samplers_of(system)
    sampler = _choice(item, "sampler", tuple(samplers), next(iter(samplers)))
    asked = [key for key in ("plan", "style") if item.raw(key) is not None]
    if asked and system not in planning_systems():
        raise FieldError(f"the system {name!r} performs no plans, so it cannot have `{asked[0]}`")
    return PlannedSystem(
        name,
        plans=_files_of(item, "plan", name, folder, clips) if "plan" in asked else None,
        generator=Generator(
            system=system,
            seed=_whole(item, "seed", 0, 2**31 - 1, 0),
            speaker=item.text_or_none("speaker"),
            steps=_whole(item, "steps", 1, 1000, samplers[sampler]),
            sampler=sampler,
            post_filter=_choice(item, "post_filter", POST_FILTERS, "none"),
            style=_style_of(item, name, folder) if "style" in asked else None,
        ),
    )


def _style_of(item: Fields, name: str, folder: Path) -> StyleWish:
    """A style file, or its tables in place."""
    from model.plan.plan import PlanError
    from model.plan.style import read_wish, wish_of  # bring torch: only once they are needed

    style = item.raw("style")
    try:
        if isinstance(style, Mapping):
            return wish_of(style)
        return read_wish(folder / item.text("style"))
    except PlanError as error:
        raise FieldError(
            f"the style of {name!r} cannot be used: {str(error).rstrip('.')}"
        ) from None


def _samplers_of(system: str) -> dict[str, int]:
    """The samplers of a system with their usual steps; the first is the usual one."""
    for family in families():
        if system in family.systems:
            return {sampler.name: sampler.steps for sampler in family.samplers_of(system)}
    known = ", ".join(name for family in families() for name in family.systems)
    raise FieldError(f"there is no system {system!r}; the systems are {known}")


def _files_of(
    item: Fields, what: str, name: str, folder: Path, clips: list[str]
) -> dict[str, Path]:
    """A pattern with {clip}, or a table of one path for each clip."""
    value = item.raw(what)
    if isinstance(value, str):
        if "{clip}" not in value:
            raise FieldError(f"the {what} of {name!r} must hold {{clip}}, or be a table by clip")
        return {clip: folder / value.replace("{clip}", clip) for clip in clips}
    table = item.inner(what)
    missing = [clip for clip in clips if clip not in table.names()]
    if missing:
        raise FieldError(f"the system {name!r} has no {what} for the clip {missing[0]!r}")
    unknown = [clip for clip in table.names() if clip not in clips]
    if unknown:
        raise FieldError(f"the system {name!r} has a {what} for {unknown[0]!r}, which is no clip")
    return {clip: folder / table.text(clip) for clip in clips}


def _views_of(fields: Fields) -> tuple[View, ...]:
    names = fields.raw("views") or ["front"]
    if not isinstance(names, list) or any(name not in VIEWS for name in names):
        raise FieldError(f"`views` must be a list of some of {', '.join(VIEWS)}")
    return tuple(view for view in VIEWS if view in names)


def _only(fields: Fields, known: set[str], what: str) -> None:
    unknown = sorted(set(fields.names()) - known)
    if unknown:
        raise FieldError(
            f"{what} has no key `{unknown[0]}`; it may have {', '.join(sorted(known))}"
        )


def _name_of(item: Fields) -> str:
    name = item.text("name")
    is_plain = name.isprintable() and name.strip() == name
    if len(name) > 80 or not is_plain or set(name) & _SEPARATORS:
        raise FieldError(
            f"a name has 1 to 80 printable characters and no comma or =; {name[:80]!r} is none"
        )
    return name


def _whole(fields: Fields, name: str, least: int, most: int, default: int | None = None) -> int:
    if default is not None and fields.raw(name) is None:
        return default
    return fields.whole(name, least, most)


def _whole_or_none(fields: Fields, name: str, least: int, most: int) -> int | None:
    return None if fields.raw(name) is None else fields.whole(name, least, most)


def _number_or_none(fields: Fields, name: str, least: float, most: float) -> float | None:
    value = fields.raw(name)
    if value is None:
        return None
    if not is_number(value) or not least <= value <= most:
        raise FieldError(f"`{name}` must be a number from {least:g} to {most:g}")
    return float(value)


def _choice(fields: Fields, name: str, allowed: tuple[Any, ...], default: str) -> Any:
    return default if fields.raw(name) is None else fields.one_of(name, allowed)


def _flag(fields: Fields, name: str, default: bool) -> bool:
    value = fields.raw(name)
    if value is None:
        return default
    if not isinstance(value, bool):
        raise FieldError(f"`{name}` must be true or false")
    return value


QUESTIONS = Path(__file__).with_name("questions.toml")
CHOICE_VALUES = ("left", "right", "tie")
ATTENTION_QUESTION = "attention"


@functools.cache
def wording() -> dict[str, Any]:
    """All sentences that a participant reads."""
    return tomllib.loads(QUESTIONS.read_text("utf-8"))


def questions_of(protocol: str) -> tuple[Question, ...]:
    """What each trial of the protocol asks."""
    return tuple(Question(**item) for item in wording()["protocols"][protocol]["questions"])
