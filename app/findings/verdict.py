"""Verdict of a run or of several clips on the claims of papers, and the evidence it would need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.findings.comparison import (
    SIMILAR_RATIO,
    Ratio,
    Samples,
    Table,
    format_means,
    format_two_digits,
    mean,
    point_title,
    ratio_of_means,
    values_by_metric,
)
from app.findings.metric_table import JERK, METRICS, SPEED, Numbers
from conventions.names import REFERENCE_NAME, SampleName, join_names, pluralise, short_names
from model.systems.registry import families

if TYPE_CHECKING:
    from model.generation.family import Claim

LOWER_IS_BETTER = (
    *("joint_rotation_noise_deg", "seam_jerk_ratio"),
    *("foot_sliding_cm_s", "finger_limit_violations_percent"),
)
"""Keys of `METRICS` of which more is worse, whatever the reference has."""
MIN_CLIPS_FOR_CLAIM = 10
"""Fewest clips for a claim: with fewer, an interval over clips is too wide to separate systems that
differ by a tenth.
"""
LOW_RATIO = 0.8
"""Share of the reference's jerk below which a motion is called calmer, and of its speed below which
it is called less moving, as jerk falls with speed.
"""
AS_FAST = 0.95
"""Share of the reference's speed from which a calm motion is called not damped."""


@dataclass(frozen=True)
class Verdict:
    """Sentences above the videos."""

    jerk_sentence: str
    """Jerk of the tracked point in every system and in the reference."""
    comparison: str
    """Differences between systems and the evidence that a claim needs; empty without comparison."""

    @property
    def text(self) -> str:
        return f"{self.jerk_sentence} {self.comparison}".strip()


def make_verdict(
    point: str, clips: Sequence[Mapping[str, Numbers]], is_generated: bool = True
) -> Verdict | None:
    """Return the verdict on a run, or on several clips with intervals over them, from raw motion.

    None if no jerk was measured, or of several clips in only one. ``clips`` has each clip's values
    by motion, as in ``run.json``. Generated motions have claims and trainings.
    """
    measured = values_by_metric({name: of["raw"] for name, of in clip.items()} for clip in clips)
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
        f" (of {pluralise(recorded, 'clip')})" if 0 < recorded < count and len(clips) > 1 else ""
    )
    jerk_sentence = f"{point_title(point)} jerk in m/s³{over}: {format_means(jerk)}{of_some}."
    others = [*_lower_jerk_sentences(table, names), *_without_jerk(clips, jerk)]
    if len(names) < 2:
        return Verdict(jerk_sentence, " ".join(others))
    here = "On this clip" if len(clips) == 1 else f"Over {count} clips"
    claims = [family.claim for family in families() if family.claim is not None]
    sentences = [
        sentence for claim in claims for sentence in _ablation_sentences(claim, table, names, here)
    ]
    if not sentences:
        order = sorted(names, key=lambda name: mean(jerk[name]))
        ratio = ratio_of_means(jerk[order[0]], jerk[order[-1]])
        least, most = names[order[0]], names[order[-1]]
        sentences = [f"Jerk of {least} (lowest) compared with {most} (highest): {_change(ratio)}."]
    worth = _evidence_note(count, len(clips), is_generated)
    return Verdict(jerk_sentence, " ".join([*sentences, *others, worth]))


def _of_the_same(table: Table, has_clips: bool) -> Table:
    """Keep only the clips or samples with jerk in every system, so that means and ratios match."""
    own = [set(each) for name, each in table.get(JERK, {}).items() if name != REFERENCE_NAME]
    shared = set.intersection(*own) if own else set()
    if not shared and not has_clips:
        return table
    return {
        key: {
            name: common
            for name, each in values.items()
            if (common := each if name == REFERENCE_NAME and not has_clips else
                {number: value for number, value in each.items() if number in shared})
        }
        for key, values in table.items()
    }  # fmt: skip


def _without_jerk(clips: Sequence[Mapping[str, Numbers]], jerk: Mapping[str, Samples]) -> list[str]:
    """Name the motions without jerk to compare, such as those interpolated from few frames."""
    systems = {SampleName.parse(name).system for name in jerk} | set(jerk)
    left_out = [
        name
        for name in dict.fromkeys(name for clip in clips for name in clip)
        if name not in systems and SampleName.parse(name).system not in systems
    ]
    return [f"The jerk cannot be compared for {join_names(left_out)}."] if left_out else []


def _ablation_sentences(
    claim: Claim, table: Table, names: Mapping[str, str], here: str
) -> list[str]:
    """Compare the systems of a claim: gain and cost of its first step, then of each addition."""
    jerk = table[JERK]
    rungs = [one for one in (claim.first_less_jerk_system, *claim.less_jerk_systems) if one in jerk]
    if not rungs:
        return []
    base, sentences = rungs[0], []
    if claim.more_jerk_system in jerk:
        ratio = ratio_of_means(jerk[base], jerk[claim.more_jerk_system])
        as_claimed, has = (
            ("as the paper claims", "has")
            if _is_calmer(ratio)
            else ("contrary to the paper's claim", "does not clearly have")
        )
        which = (
            ""
            if base == claim.first_less_jerk_system
            else f", which also has {claim.less_jerk_property},"
        )
        sentences.append(
            f"{here}, {as_claimed}, the system with {claim.less_jerk_property} {has} less jerk "
            f"than the one with {claim.more_jerk_property}. Jerk of {names[base]}{which} "
            f"compared with {names[claim.more_jerk_system]}: {_change(ratio)}."
        )
        if worse := _worse(table, base, claim.more_jerk_system):
            sentences.append(
                f"{names[base].capitalize()} is worse than {names[claim.more_jerk_system]} "
                f"in {join_names(worse)}."
            )
    added = {name: ratio_of_means(jerk[name], jerk[base]) for name in rungs if name != base}
    if not added:
        return sentences
    changes = ", ".join(f"{names[name]} {_change(ratio)}" for name, ratio in added.items())
    calmer = [names[name] for name, ratio in added.items() if _is_calmer(ratio)]
    which = join_names(calmer) if calmer else "none"
    return [
        *sentences,
        f"Adding {claim.additions_name} one by one changes the jerk as follows (each compared with "
        f"{names[base]}): {changes}. Clearly less jerk: {which}.",
    ]


def _worse(table: Table, system: str, other: str) -> list[str]:
    """List the measures of `LOWER_IS_BETTER` in which a system is significantly worse."""
    worse = []
    for row in (each for each in METRICS if each.key in LOWER_IS_BETTER):
        values = table.get(row.key, {})
        if not {system, other} <= values.keys():
            continue
        ratio = ratio_of_means(values[system], values[other])
        if ratio is not None and ratio.low is not None and ratio.low > 1.0 and not ratio.is_similar:
            more, less = (format_two_digits(mean(values[name])) for name in (system, other))
            if more != less:
                numbers = f"{more} against {less} {row.unit}".replace(" °", "°").strip()
                worse.append(f"{row.title.lower()} ({numbers})")
    return worse


def _lower_jerk_sentences(table: Table, names: Mapping[str, str]) -> list[str]:
    """Name the systems with much less jerk than the reference, and whether they also move less."""

    def share(name: str, key: str) -> Ratio | None:
        own, recorded = (table.get(key, {}).get(each, {}) for each in (name, REFERENCE_NAME))
        return ratio_of_means(own, recorded) if own and recorded else None

    sentences = []
    for name, label in names.items():
        jerk, speed = share(name, JERK), share(name, SPEED)
        # By the numbers as they are printed.
        if jerk is None or jerk.interval_includes_one or round(jerk.value, 2) >= LOW_RATIO:
            continue
        if speed is None:
            sentences.append(f"{label} ({_as_percent(jerk)} of the reference's jerk)")
            continue
        moves = round(speed.value, 2)
        how = "moves about as much" if moves >= AS_FAST else "moves slightly less"
        how = "moves less, possibly over-smoothed" if moves < LOW_RATIO else how
        shares = f"{_as_percent(jerk)} of the reference's jerk, {_as_percent(speed)} of its speed"
        sentences.append(f"{label} ({shares}: {how})")
    return [f"Less jerk than the reference: {join_names(sentences)}."] if sentences else []


def _as_percent(share: Ratio) -> str:
    return f"{100 * round(share.value, 2):.0f} %"


def _change(ratio: Ratio | None) -> str:
    """Format a ratio as a percentage of change, with the interval of several samples."""
    if ratio is None:
        return "not comparable"
    if ratio.interval_includes_one:
        return "no clear difference"
    if ratio.is_similar:
        return "equal within 5 %"
    share = f"{_percent(ratio.value)} % {'less' if ratio.value < 1.0 else 'more'}"
    if ratio.low is None or ratio.high is None or ratio.low == ratio.high:
        return share
    low, high = sorted((ratio.low, ratio.high), key=lambda end: abs(end - 1.0))
    return f"{share} ({_percent(low)} to {_percent(high)} %)"


def _percent(ratio: float) -> str:
    """Format a difference with two digits, so that 5.2 is not taken for what is alike."""
    percent = format_two_digits(100.0 * abs(ratio - 1.0))
    return "over 99" if ratio < 1.0 and percent == "100" else percent


def _is_calmer(ratio: Ratio | None) -> bool:
    """Check whether a system is calmer by over 5 % and, with several samples, significantly."""
    return (
        ratio is not None and ratio.value <= 1.0 / SIMILAR_RATIO and not ratio.interval_includes_one
    )


def _evidence_note(count: int, clips: int, is_generated: bool) -> str:
    """Describe the evidence of this many clips, or samples of one clip."""
    if not is_generated:
        return "One clip is an example, not evidence."
    samples = "one sample" if count == 1 else f"{count} samples"
    basis = f"{count} clips" if clips > 1 else f"One clip, {samples}"
    if clips > 1 and count >= MIN_CLIPS_FOR_CLAIM:
        return f"{basis}, one training run per system: other training runs may give other numbers."
    return (
        f"{basis}, one training run per system: an example, not evidence. A claim needs "
        f"{MIN_CLIPS_FOR_CLAIM} clips or more, several samples of each, and several training seeds "
        "per system."
    )
