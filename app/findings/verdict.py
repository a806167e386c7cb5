"""What the numbers of a run, or of several clips, say of the claims of papers, and what it takes to
say more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.findings.comparison import (
    ALIKE,
    Ratio,
    Samples,
    mean,
    number_of,
    point_title,
    ratio_of,
    samples_by_system,
    told_of,
    values_by_system,
)
from app.findings.measure_rows import JERK, MEASURES, Numbers, nearest
from app.findings.sentences import jerk_of
from conventions.names import REFERENCE_NAME, listed, short_names
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
    """The followed point's jerk in every system, and in the reference."""
    judgement: str
    """What is more and what less, and what would be needed; empty where nothing is compared."""

    @property
    def text(self) -> str:
        return f"{self.numbers} {self.judgement}".strip()


def verdict_of(diagnostics: Diagnostics, is_made: bool = True) -> Verdict | None:
    """The verdict on a run, from the motion as generated; None where no jerk was measured.

    Args:
        is_made: by systems, whose claims and trainings are told of.
    """
    jerk = values_by_system(diagnostics, jerk_of, "raw")
    reference = number_of(diagnostics.reference, jerk_of, "raw")
    nearer = _nearer(diagnostics)
    return _verdict(diagnostics.point, jerk, reference, nearer, is_made) if jerk else None


def jerk_over_clips(clips: Iterable[Mapping[str, Numbers]]) -> dict[str, Samples]:
    """The followed point's jerk, as generated, of each system and of the reference, by the number
    of the clip: of a clip's samples the mean.

    Args:
        clips: what was measured of each, by motion, as ``run.json`` has it.
    """
    found: dict[str, Samples] = {}
    for number, clip in enumerate(clips, 1):
        known = {name: each["raw"][JERK] for name, each in clip.items() if JERK in each["raw"]}
        for system, names in samples_by_system(known).items():
            values = {sample: known[name] for sample, name in names.items()}
            found.setdefault(system, {})[number] = mean(values)
    return found


def verdict_over_clips(point: str, jerk: Mapping[str, Samples]) -> Verdict | None:
    """The verdict with its intervals over clips; None where fewer than two were measured.

    Args:
        jerk: of `jerk_over_clips`.
    """
    systems = {name: clips for name, clips in jerk.items() if name != REFERENCE_NAME}
    count = max(map(len, systems.values()), default=0)
    reference = mean(jerk[REFERENCE_NAME]) if REFERENCE_NAME in jerk else None
    return _verdict(point, systems, reference, clips=count) if count > 1 else None


def _verdict(
    point: str,
    jerk: Mapping[str, Samples],
    reference: float | None,
    nearer: Sequence[str] = (),
    is_made: bool = True,
    clips: int = 1,
) -> Verdict:
    """
    Args:
        jerk: of several clips a value for each, else for each sample.
        nearer: sentences of what the claims are not about.
    """
    names = short_names(jerk)
    samples = max(map(len, jerk.values()))
    drawn = f"{samples} samples" if clips == 1 else f"{clips} clips"
    over = f", mean over {drawn}" if max(clips, samples) > 1 else ""
    told = told_of({names[name]: values for name, values in jerk.items()}, reference)
    numbers = f"{point_title(point)} jerk in m/s³{over}: {told}."
    if len(jerk) < 2:
        return Verdict(numbers, "")
    here = "On this clip" if clips == 1 else f"Over {clips} clips"
    claims = [family.claim for family in families() if family.claim is not None]
    sentences = [sentence for claim in claims for sentence in _ladder(claim, jerk, names, here)]
    if not sentences:
        order = sorted(jerk, key=lambda name: mean(jerk[name]))
        change = _change(ratio_of(jerk[order[0]], jerk[order[-1]]))
        sentences = [f"From {names[order[-1]]}, which jerks most, to {names[order[0]]} {change}."]
    return Verdict(numbers, " ".join([*sentences, *nearer, _needed(samples, clips, is_made)]))


def _ladder(
    claim: Claim, jerk: Mapping[str, Samples], names: Mapping[str, str], here: str
) -> list[str]:
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
            f"{here} the paper's claim, that {claim.sentence}, {shows}: from "
            f"{names[claim.more]} to {names[base]} {_change(ratio)}."
        )
    added = {name: ratio_of(jerk[name], jerk[base]) for name in rungs if name != base}
    if not added:
        return sentences
    told = ", ".join(f"{names[name]} {_change(ratio)}" for name, ratio in added.items())
    calmer = [names[name] for name, ratio in added.items() if _is_calmer(ratio)]
    which = f"{listed(calmer)} {'is' if len(calmer) == 1 else 'are'}" if calmer else "none is"
    sentences.append(f"Compared with {names[base]}: {told}; {which} calmer here.")
    full = added.get(claim.full)
    if full is not None and full.value >= ALIKE and not full.is_open:
        sentences.append(
            f"{names[claim.full].capitalize()} jerks more than {names[base]}: {claim.added} did not"
            " help."
        )
    return sentences


def _nearer(diagnostics: Diagnostics) -> list[str]:
    """In which of the table's first measures a claim's weaker system is nearer to the reference."""
    names, found = short_names(diagnostics.systems), []
    for claim in (family.claim for family in families()):
        if claim is None or not {claim.more, claim.plain} <= diagnostics.systems.keys():
            continue
        titles = []
        for row in (each for each in MEASURES if each.is_first and each.has_target):
            values = values_by_system(diagnostics, row.read, "raw")
            both = {
                name: mean(values[name]) for name in (claim.more, claim.plain) if name in values
            }
            target = number_of(diagnostics.reference, row.read, "raw")
            if nearest(both, target) == (claim.more,):
                titles.append(row.title.lower())
        if titles:
            which = f"{names[claim.more].capitalize()} is nearer to the reference than"
            found.append(f"{which} {names[claim.plain]} in {listed(titles)}.")
    return found


def _change(ratio: Ratio | None) -> str:
    """How much less or more, with the range of the interval where several were drawn."""
    if ratio is None:
        return "cannot be compared"
    if ratio.is_open:
        return "not told apart"
    if ratio.is_alike:
        return "alike within 5 %"
    share = f"{_percent(ratio.value)} % {'less' if ratio.value < 1.0 else 'more'}"
    if ratio.low is None or ratio.high is None:
        return share
    low, high = sorted((ratio.low, ratio.high), key=lambda end: abs(end - 1.0))
    return f"{share} ({_percent(low)} to {_percent(high)} %)"


def _percent(ratio: float) -> str:
    """Of the difference, in two digits, so that 5.2 is not taken for what is alike."""
    return f"{100 * abs(ratio - 1.0):.2g}"


def _is_calmer(ratio: Ratio | None) -> bool:
    """By more than 5 %, and where there are several samples, by more than chance."""
    return ratio is not None and ratio.value <= 1.0 / ALIKE and not ratio.is_open


def _needed(samples: int, clips: int, is_made: bool) -> str:
    """What a comparison is worth."""
    if not is_made:
        return "One clip is an example, no evidence."
    seen = f"{clips} clips" if clips > 1 else "One clip, "
    if clips == 1:
        seen += "one sample" if samples == 1 else f"{samples} samples"
    if clips >= ENOUGH_CLIPS:
        return f"{seen} and one training of each: other trainings may give other numbers."
    return (
        f"{seen} and one training of each: an example, no evidence. A claim takes {ENOUGH_CLIPS} "
        "clips or more, several samples of each, and systems trained from several seeds."
    )
