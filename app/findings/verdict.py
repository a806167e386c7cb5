"""What the numbers of one run say of the claims of papers, and what it takes to say more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.findings.comparison import (
    ALIKE,
    Ratio,
    Samples,
    mean,
    number_of,
    plain,
    point_title,
    ratio_of,
    values_by_system,
)
from app.findings.sentences import jerk_of
from conventions.names import listed
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
        sentences += _ladder(claim, jerk, names)
    return Verdict(numbers, " ".join([*sentences, *_needed(jerk)]))


def short_names(systems: Iterable[str]) -> dict[str, str]:
    """Each system's name after its slash, where that is a word and no other's too."""
    systems = list(systems)
    ends = [name.rsplit("/", 1)[-1] for name in systems]
    return {
        name: end if ends.count(end) == 1 and not end.isdigit() else name
        for name, end in zip(systems, ends, strict=True)
    }


def _ladder(claim: Claim, jerk: Mapping[str, Samples], names: Mapping[str, str]) -> list[str]:
    """The way through the claim's systems: what the first step gains, and whether what is added
    after it gains more."""
    rungs = [name for name in (claim.plain, *claim.less) if name in jerk]
    if not rungs:
        return []
    base, sentences = rungs[0], []
    if claim.more in jerk:
        ratio = ratio_of(jerk[base], jerk[claim.more])
        shows = "shows" if _is_calmer(ratio) else "does not show"
        sentences.append(
            f"On this clip the paper's claim, that {claim.sentence}, {shows}: from "
            f"{names[claim.more]} to {names[base]} {_change(ratio)}."
        )
    added = {name: ratio_of(jerk[name], jerk[base]) for name in rungs if name != base}
    if not added:
        return sentences
    told = ", ".join(f"{names[name]} {_change(ratio)}" for name, ratio in added.items())
    calmer = [names[name] for name, ratio in added.items() if _is_calmer(ratio)]
    which = f"{listed(calmer)} {'is' if len(calmer) == 1 else 'are'}" if calmer else "none is"
    sentences.append(f"Beside {names[base]}: {told}; {which} calmer here.")
    full = added.get(claim.full)
    if full is not None and full.value >= ALIKE and not full.is_open:
        sentences.append(
            f"{names[claim.full].capitalize()} jerks more than {names[base]}: {claim.added} did not"
            " help."
        )
    return sentences


def _change(ratio: Ratio | None) -> str:
    """How much less or more, with the range of the interval where there are several samples."""
    if ratio is None:
        return "cannot be compared"
    if ratio.is_open:
        return f"not told apart by {ratio.num_samples} samples"
    if ratio.is_alike:
        return "alike within 5 %"
    share = f"{'less' if ratio.value < 1.0 else 'more'} by {abs(ratio.value - 1.0):.0%}"
    if ratio.low is None or ratio.high is None:
        return share
    low, high = sorted((abs(ratio.low - 1.0), abs(ratio.high - 1.0)))
    return f"{share} ({low:.0%} to {high:.0%}, {ratio.num_samples} samples)"


def _is_calmer(ratio: Ratio | None) -> bool:
    """By more than 5 %, and where there are several samples, by more than chance."""
    return ratio is not None and ratio.value <= 1.0 / ALIKE and not ratio.is_open


def _needed(jerk: Mapping[str, Samples]) -> list[str]:
    if len(jerk) < 2:
        return []
    samples = max(len(values) for values in jerk.values())
    seen = "one sample" if samples == 1 else f"{samples} samples"
    return [
        f"This is one clip, {seen} and one training of each: an example. To claim anything takes "
        f"several samples of {ENOUGH_CLIPS} clips or more, of systems trained from several seeds."
    ]
