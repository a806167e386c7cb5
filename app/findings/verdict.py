"""What the numbers of a run, or of several clips, say of the claims of papers, and what it takes to
say more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.findings.comparison import (
    ALIKE,
    Ratio,
    Samples,
    Table,
    by_measure,
    mean,
    plain,
    point_title,
    ratio_of,
    told_of,
)
from app.findings.measure_rows import JERK, MEASURES, SPEED, Numbers
from conventions.names import REFERENCE_NAME, SampleName, counted, listed, short_names
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
AS_FAST = 0.95
"""From this share of the reference's speed on a calm motion is told not to be damped."""


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
    measured = by_measure({name: of["raw"] for name, of in clip.items()} for clip in clips)
    table = _of_the_same(measured, len(clips) > 1)
    jerk = table.get(JERK, {})
    systems = [name for name in jerk if name != REFERENCE_NAME]
    count = max((len(jerk[name]) for name in systems), default=0)
    if count < min(len(clips), 2):
        return None
    names = short_names(systems)
    drawn = f"{count} samples" if len(clips) == 1 else f"{count} clips"
    over = f", mean over {drawn}" if count > 1 else ""
    recorded = len(jerk.get(REFERENCE_NAME, {}))
    of_some = (
        f" (of {counted(recorded, 'clip')})" if 0 < recorded < count and len(clips) > 1 else ""
    )
    numbers = f"{point_title(point)} jerk in m/s³{over}: {told_of(jerk)}{of_some}."
    others = [*_calmer(table, names), *_without_jerk(clips, jerk)]
    if len(names) < 2:
        return Verdict(numbers, " ".join(others))
    here = "On this clip" if len(clips) == 1 else f"Over {count} clips"
    claims = [family.claim for family in families() if family.claim is not None]
    sentences = [sentence for claim in claims for sentence in _ladder(claim, table, names, here)]
    if not sentences:
        order = sorted(names, key=lambda name: mean(jerk[name]))
        ratio = ratio_of(jerk[order[0]], jerk[order[-1]])
        least, most = names[order[0]], names[order[-1]]
        sentences = [
            f"From {most}, which jerks most, to {least} {_change(ratio)}."
            if _is_calmer(ratio)
            else f"The largest difference in jerk, from {most} to {least}: {_change(ratio)}."
        ]
    worth = _needed(count, len(clips), is_made)
    return Verdict(numbers, " ".join([*sentences, *others, worth]))


def _of_the_same(table: Table, has_clips: bool) -> Table:
    """Keep those clips, or samples, alone whose jerk every system has, so that means and ratios are
    of the same ones."""
    own = [set(each) for name, each in table.get(JERK, {}).items() if name != REFERENCE_NAME]
    shared = set.intersection(*own) if own else set()
    if not shared and not has_clips:
        return table
    return {
        key: {
            name: found
            for name, each in values.items()
            if (found := each if name == REFERENCE_NAME and not has_clips else
                {number: value for number, value in each.items() if number in shared})
        }
        for key, values in table.items()
    }  # fmt: skip


def _without_jerk(clips: Sequence[Mapping[str, Numbers]], jerk: Mapping[str, Samples]) -> list[str]:
    """Say which motions have no jerk beside others', such as those filled in from few frames."""
    known = {SampleName.parse(name).system for name in jerk} | set(jerk)
    left_out = [
        name
        for name in dict.fromkeys(name for clip in clips for name in clip)
        if name not in known and SampleName.parse(name).system not in known
    ]
    return [f"No jerk to compare: {listed(left_out)}."] if left_out else []


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
            more, less = (plain(mean(values[name])) for name in (system, other))
            if more != less:
                numbers = f"{more} against {less} {row.unit}".replace(" °", "°")
                found.append(f"{row.title.lower()} ({numbers})")
    return found


def _calmer(table: Table, names: Mapping[str, str]) -> list[str]:
    """Which systems jerk much less than the reference, and whether they only move less."""

    def share(name: str, key: str) -> Ratio | None:
        own, recorded = (table.get(key, {}).get(each, {}) for each in (name, REFERENCE_NAME))
        return ratio_of(own, recorded) if own and recorded else None

    told = []
    for name, label in names.items():
        jerk, speed = share(name, JERK), share(name, SPEED)
        # By the numbers as they are printed.
        if jerk is None or jerk.is_open or float(plain(jerk.value)) >= CALM:
            continue
        if speed is None:
            told.append(f"{label} ({plain(jerk.value)} times its jerk)")
            continue
        moves = float(plain(speed.value))
        how = "smooth, not damped" if moves >= AS_FAST else "moves a little less"
        how = "moves less, may be damped" if moves < CALM else how
        shares = f"{plain(jerk.value)} times its jerk at {plain(speed.value)} times its speed"
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
    if ratio.low is None or ratio.high is None or ratio.low == ratio.high:
        return share
    low, high = sorted((ratio.low, ratio.high), key=lambda end: abs(end - 1.0))
    return f"{share} ({_percent(low)} to {_percent(high)} %)"


def _percent(ratio: float) -> str:
    """Format a difference with two digits, so that 5.2 is not taken for what is alike."""
    told = plain(100.0 * abs(ratio - 1.0))
    return "over 99" if ratio < 1.0 and told == "100" else told


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
