"""What the numbers of a run, or of several clips, say of the claims of papers, and what it takes to
say more."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
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
    samples_by_system,
    told_of,
)
from app.findings.measure_rows import JERK, MEASURES, Numbers, numbers_of
from app.findings.sentences import jerk_of
from conventions.names import REFERENCE_NAME, listed, short_names
from model.systems.registry import families

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics
    from model.generation.family import Claim

Read = Callable[[str], Mapping[str, Samples]]
"""Gives one measure of each system, by its key."""
MORE_IS_WORSE = (
    *("All joints: Rotation noise", "All joints: Peak jerk at joins"),
    *("Feet: Slide on the ground", "Hands: Fingers beyond range"),
)
"""Of `MEASURES`, whatever people have."""
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
    told = {name: numbers_of(versions.raw) for name, versions in diagnostics.systems.items()}
    reference = number_of(diagnostics.reference, jerk_of, "raw")
    is_known = any(JERK in numbers for numbers in told.values())
    read = partial(_samples, told)
    return _verdict(diagnostics.point, read, reference, is_made=is_made) if is_known else None


def _samples(told: Mapping[str, Mapping[str, float]], key: str) -> dict[str, Samples]:
    """One measure of each system's samples."""
    known = {name: numbers[key] for name, numbers in told.items() if key in numbers}
    systems = samples_by_system(known).items()
    return {name: {n: known[each] for n, each in samples.items()} for name, samples in systems}


def over_clips(clips: Iterable[Mapping[str, Numbers]], key: str = JERK) -> dict[str, Samples]:
    """One measure, as generated, of each system and of the reference, by the number of the clip: of
    a clip's samples the mean.

    Args:
        clips: what was measured of each, by motion, as ``run.json`` has it.
    """
    found: dict[str, Samples] = {}
    for number, clip in enumerate(clips, 1):
        for system, samples in _samples(
            {name: of["raw"] for name, of in clip.items()}, key
        ).items():
            found.setdefault(system, {})[number] = mean(samples)
    return found


def verdict_over_clips(point: str, clips: Sequence[Mapping[str, Numbers]]) -> Verdict | None:
    """The verdict with its intervals over clips, as of `over_clips`; None where fewer than two were
    measured."""
    jerk = over_clips(clips)
    reference = mean(jerk[REFERENCE_NAME]) if REFERENCE_NAME in jerk else None
    count = max((len(of) for name, of in jerk.items() if name != REFERENCE_NAME), default=0)

    def read(key: str) -> dict[str, Samples]:
        return {name: of for name, of in over_clips(clips, key).items() if name != REFERENCE_NAME}

    return _verdict(point, read, reference, count) if count > 1 else None


def _verdict(
    point: str,
    read: Read,
    reference: float | None,
    clips: int = 1,
    is_made: bool = True,
) -> Verdict:
    """
    Args:
        read: one measure of the systems; of several clips a value for each, else for each sample.
    """
    jerk = read(JERK)
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
    sentences = [sentence for claim in claims for sentence in _ladder(claim, read, names, here)]
    if not sentences:
        order = sorted(jerk, key=lambda name: mean(jerk[name]))
        change = _change(ratio_of(jerk[order[0]], jerk[order[-1]]))
        sentences = [f"From {names[order[-1]]}, which jerks most, to {names[order[0]]} {change}."]
    return Verdict(numbers, " ".join([*sentences, _needed(samples, clips, is_made)]))


def _ladder(claim: Claim, read: Read, names: Mapping[str, str], here: str) -> list[str]:
    """The way through the claim's systems: what the first step gains, in what it is worse, and
    whether what is added after it gains more."""
    jerk = read(JERK)
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
        if worse := _worse(read, base, claim.more):
            sentences.append(f"{names[base].capitalize()} is worse in {listed(worse)}.")
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


def _worse(read: Read, system: str, other: str) -> list[str]:
    """In which measures a system has more than another of what nobody wants, and not by chance."""
    found = []
    for row in (each for each in MEASURES if each.key in MORE_IS_WORSE):
        values = read(row.key)
        if not {system, other} <= values.keys():
            continue
        ratio = ratio_of(values[system], values[other])
        if ratio is not None and ratio.low is not None and ratio.low > 1.0 and not ratio.is_alike:
            numbers = " against ".join(plain(mean(values[name])) for name in (system, other))
            found.append(f"{row.title.lower()} ({numbers} {row.unit})")
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
