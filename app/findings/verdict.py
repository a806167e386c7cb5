"""What the numbers of one run say of the claims of papers, and what it takes to say more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.findings.comparison import (
    ALIKE,
    Samples,
    mean,
    number_of,
    plain,
    point_title,
    ratio_of,
    values_by_system,
)
from app.findings.sentences import jerk_of
from model.systems.registry import families

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics
    from model.generation.family import Claim

ENOUGH_CLIPS = 10
"""With fewer, an interval over clips is too wide to tell systems apart that differ by a tenth."""


@dataclass(frozen=True)
class Verdict:
    """Two sentences above the videos."""

    numbers: str
    """The followed point's jerk in every system, and as recorded."""
    judgement: str
    """Whether the claim shows, and what would be needed; empty where nothing is compared."""

    @property
    def text(self) -> str:
        return f"{self.numbers} {self.judgement}".strip()


def verdict_of(diagnostics: Diagnostics) -> Verdict | None:
    """The verdict on a run, from the motion as generated; None where no jerk was measured."""
    jerk = values_by_system(diagnostics, jerk_of, "raw")
    if not jerk:
        return None
    names = short_names(jerk)
    told = ", ".join(f"{names[name]} {plain(mean(values))}" for name, values in jerk.items())
    recorded = number_of(diagnostics.reference, jerk_of, "raw")
    ending = "" if recorded is None else f"; recorded {plain(recorded)}"
    numbers = f"{point_title(diagnostics.point)} jerk in m/s³: {told}{ending}."
    sentences = []
    for claim in [family.claim for family in families() if family.claim is not None]:
        sentences += [*_claim(claim, jerk, names), *_worse(claim, jerk, names)]
    return Verdict(numbers, " ".join([*sentences, *_needed(jerk)]))


def short_names(systems: Iterable[str]) -> dict[str, str]:
    """Each system's name after its slash, where that is a word and no other's too."""
    systems = list(systems)
    ends = [name.rsplit("/", 1)[-1] for name in systems]
    return {
        name: end if ends.count(end) == 1 and not end.isdigit() else name
        for name, end in zip(systems, ends, strict=True)
    }


def _claim(claim: Claim, jerk: Mapping[str, Samples], names: Mapping[str, str]) -> list[str]:
    """Whether the systems that should jerk less do."""
    rungs = [name for name in claim.less if name in jerk]
    if claim.more not in jerk or not rungs:
        return []
    showing = [name for name in rungs if _is_less(jerk[claim.more], jerk[name])]
    if len(showing) == len(rungs):
        return [f"On this clip the paper's claim shows: {claim.sentence}."]
    if not showing:
        return [f"On this clip the paper's claim, that {claim.sentence}, does not show."]
    yes, no = (
        " and ".join(names[name] for name in rungs if (name in showing) == is_shown)
        for is_shown in (True, False)
    )
    return [
        f"On this clip the paper's claim, that {claim.sentence}, shows with {yes}, not with {no}."
    ]


def _worse(claim: Claim, jerk: Mapping[str, Samples], names: Mapping[str, str]) -> list[str]:
    """Whether all that the paper adds together jerks more than none of it."""
    plain_one, full = claim.plain, claim.full
    if not {plain_one, full} <= jerk.keys() or not _is_less(jerk[full], jerk[plain_one]):
        return []
    return [f"Here {names[full]} jerks more than {names[plain_one]}: {claim.added} did not help."]


def _is_less(more: Samples, other: Samples) -> bool:
    """By more than 5 %, and where there are several samples, by more than chance."""
    ratio = ratio_of(more, other)
    return ratio is not None and ratio.value >= ALIKE and not ratio.is_open


def _needed(jerk: Mapping[str, Samples]) -> list[str]:
    if len(jerk) < 2:
        return []
    samples = max(len(values) for values in jerk.values())
    seen = "one sample" if samples == 1 else f"{samples} samples"
    return [
        f"This is one clip, {seen} and one training of each: an example. To claim anything takes "
        f"several samples of {ENOUGH_CLIPS} clips or more, of systems trained from several seeds."
    ]
