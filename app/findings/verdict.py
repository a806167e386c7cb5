"""What the numbers of a run, or of several clips, say of the claims of papers, and what it takes to
say more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.findings.comparison import (
    ALIKE,
    Ratio,
    Table,
    by_measure,
    mean,
    plain,
    point_title,
    ratio_of,
    told_of,
)
from app.findings.measure_rows import JERK, MEASURES, SPEED, Numbers
from conventions.names import REFERENCE_NAME, listed, short_names
from model.systems.registry import families

if TYPE_CHECKING:
    from model.generation.family import Claim

MORE_IS_WORSE = (
    *("All joints: Rotation noise", "All joints: Peak jerk at joins"),
    *("Feet: Slide on the ground", "Hands: Fingers beyond range"),
)
"""Of `MEASURES`, whatever people have."""
ENOUGH_CLIPS = 10
"""With fewer, an interval over clips is too wide to tell systems apart that differ by a tenth."""
CALM = 0.8
"""Under this share of the reference's jerk a motion is told to be calmer, and under this share of
its speed, by which jerk falls too, to move less."""


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


def verdict_of(
    point: str, clips: Sequence[Mapping[str, Numbers]], is_made: bool = True
) -> Verdict | None:
    """The verdict on a run from the motion as generated, or on several clips with its intervals
    over them; None where no jerk was measured, or of several clips only one's.

    Args:
        clips: what was measured of each, by motion, as ``run.json`` has it.
        is_made: by systems, whose claims and trainings are told of.
    """
    table = by_measure({name: of["raw"] for name, of in clip.items()} for clip in clips)
    jerk = table.get(JERK, {})
    systems = [name for name in jerk if name != REFERENCE_NAME]
    count = max((len(jerk[name]) for name in systems), default=0)
    if count < min(len(clips), 2):
        return None
    names = short_names(systems)
    drawn = f"{count} samples" if len(clips) == 1 else f"{count} clips"
    over = f", mean over {drawn}" if count > 1 else ""
    numbers = f"{point_title(point)} jerk in m/s³{over}: {told_of(jerk)}."
    calmer = _calmer(table, names)
    if len(names) < 2:
        return Verdict(numbers, " ".join(calmer))
    here = "On this clip" if len(clips) == 1 else f"Over {count} clips"
    claims = [family.claim for family in families() if family.claim is not None]
    sentences = [sentence for claim in claims for sentence in _ladder(claim, table, names, here)]
    if not sentences:
        order = sorted(names, key=lambda name: mean(jerk[name]))
        change = _change(ratio_of(jerk[order[0]], jerk[order[-1]]))
        sentences = [f"From {names[order[-1]]}, which jerks most, to {names[order[0]]} {change}."]
    worth = _needed(count, len(clips), is_made)
    return Verdict(numbers, " ".join([*sentences, *calmer, worth]))


def _ladder(claim: Claim, table: Table, names: Mapping[str, str], here: str) -> list[str]:
    """The way through the claim's systems: what the first step gains, in what it is worse, and
    whether what is added after it gains more."""
    jerk = table[JERK]
    rungs = [name for name in (claim.plain, *claim.less) if name in jerk]
    if not rungs:
        return []
    base, sentences = rungs[0], []
    if claim.more in jerk:
        ratio = ratio_of(jerk[base], jerk[claim.more])
        shows = "shows" if _is_calmer(ratio) else "does not show"
        which = "" if base == claim.plain else f", which has {claim.what} too,"
        sentences.append(
            f"{here} the paper's claim, that {claim.what} jerk less than {claim.than}, {shows}: "
            f"from {names[claim.more]} to {names[base]}{which} {_change(ratio)}."
        )
        if worse := _worse(table, base, claim.more):
            sentences.append(
                f"{names[base].capitalize()} is worse than {names[claim.more]} in {listed(worse)}."
            )
    added = {name: ratio_of(jerk[name], jerk[base]) for name in rungs if name != base}
    if not added:
        return sentences
    told = ", ".join(f"{names[name]} {_change(ratio)}" for name, ratio in added.items())
    calmer = [names[name] for name, ratio in added.items() if _is_calmer(ratio)]
    which = f"{listed(calmer)} {'is' if len(calmer) == 1 else 'are'}" if calmer else "none is"
    start = f"Against {names[base]}, with {claim.added} added one by one"
    return [*sentences, f"{start}: {told}; {which} calmer here."]


def _worse(table: Table, system: str, other: str) -> list[str]:
    """In which measures a system has more than another of what nobody wants, and not by chance."""
    found = []
    for row in (each for each in MEASURES if each.key in MORE_IS_WORSE):
        values = table.get(row.key, {})
        if not {system, other} <= values.keys():
            continue
        ratio = ratio_of(values[system], values[other])
        if ratio is not None and ratio.low is not None and ratio.low > 1.0 and not ratio.is_alike:
            numbers = " against ".join(plain(mean(values[name])) for name in (system, other))
            found.append(f"{row.title.lower()} ({numbers} {row.unit})".replace(" °", "°"))
    return found


def _calmer(table: Table, names: Mapping[str, str]) -> list[str]:
    """Which systems jerk much less than the reference, and whether they only move less."""

    def share(name: str, key: str) -> float:
        own, recorded = (table.get(key, {}).get(each, {}) for each in (name, REFERENCE_NAME))
        return mean(own) / mean(recorded) if own and recorded and mean(recorded) > 0 else 1.0

    told = []
    for name, label in names.items():
        if (jerk := share(name, JERK)) < CALM:
            speed = share(name, SPEED)
            how = "moves less, may be damped" if speed < CALM else "smooth, not damped"
            shares = f"{plain(jerk)} times its jerk at {plain(speed)} times its speed"
            told.append(f"{label} ({shares}: {how})")
    return [f"Calmer than the reference: {listed(told)}."] if told else []


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


def _needed(count: int, clips: int, is_made: bool) -> str:
    """What a comparison of so many clips, or samples of one, is worth."""
    if not is_made:
        return "One clip is an example, no evidence."
    samples = "one sample" if count == 1 else f"{count} samples"
    seen = f"{count} clips" if clips > 1 else f"One clip, {samples}"
    if clips > 1 and count >= ENOUGH_CLIPS:
        return f"{seen} and one training of each: other trainings may give other numbers."
    return (
        f"{seen} and one training of each: an example, no evidence. A claim takes {ENOUGH_CLIPS} "
        "clips or more, several samples of each, and systems trained from several seeds."
    )
