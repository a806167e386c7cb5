"""Plain sentences under the plots, made from their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING

from app.findings import metric_table
from app.findings.comparison import (
    Table,
    format_means,
    format_two_digits,
    point_title,
    sample_names_by_system,
    values_by_metric,
)
from app.findings.metric_table import JERK, POWER_ABOVE_5_HZ, SEAMS
from conventions.names import (
    FILTER_VERSIONS,
    REFERENCE_NAME,
    FilterVersion,
    join_names,
    short_names,
)

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics, RawAndFiltered

SMOOTHED = "After Savitzky-Golay smoothing"
"""Start of a sentence on motion filtered by `model.motion.transforms` as in the official code."""
SMALL_SHARE = 0.05


def figure_sentences(diagnostics: Diagnostics) -> dict[str, str]:
    """Return one text per plot on a run's numbers, or ""; samples of a system are averaged."""
    labels = short_names(diagnostics.systems)
    systems = {labels[name]: versions for name, versions in diagnostics.systems.items()}
    findings = {labels.get(name, name): each for name, each in diagnostics.findings.items()}
    diagnostics = replace(diagnostics, systems=systems, findings=findings)
    of_all = diagnostics.metrics_by_name
    apart = {
        labels.get(name, name): of
        for name, of in metric_table.parts_others_have(diagnostics.missing_parts).items()
    }

    def table(kind: FilterVersion) -> Table:
        numbers = {
            name: metric_table.metric_values(each.version(kind), incomparable=apart.get(name, ()))
            for name, each in of_all.items()
        }
        return values_by_metric([numbers])

    tables: dict[FilterVersion, Table] = {kind: table(kind) for kind in FILTER_VERSIONS}
    unlike = {name for name, parts in apart.items() if parts & {"detail", "place"}}
    comparable = {name: each for name, each in of_all.items() if name not in unlike}
    point, is_cut = point_title(diagnostics.tracked_point), diagnostics.windows is not None
    return {
        "trajectory": _raw_and_filtered(tables, JERK, f"{point} jerk in m/s³"),
        "depth": _depth(comparable),
        "spectrum": _raw_and_filtered(tables, POWER_ABOVE_5_HZ, f"{point} power above 5 Hz in %"),
        "attribution": _attribution(diagnostics),
        "seams": _seams(diagnostics, tables["raw"]) if is_cut else _periods(diagnostics),
        "beats": _beats(diagnostics),
        "step": _lag_sentence(diagnostics),
    }


def _raw_and_filtered(tables: Mapping[FilterVersion, Table], key: str, noun: str) -> str:
    """Format one measure of all systems as generated and smoothed; empty if none was measured."""
    tables_by_noun = {noun: tables["raw"].get(key, {}), SMOOTHED: tables["savgol"].get(key, {})}
    return " ".join(
        f"{start}: {format_means(values)}."
        for start, values in tables_by_noun.items()
        if values.keys() - {REFERENCE_NAME}
    )


def _depth(of_all: Mapping[str, RawAndFiltered]) -> str:
    """Describe how jerk grows along the kinematic chain."""
    sentences = []
    for system, samples in sample_names_by_system(of_all).items():
        positions = [of_all[name].raw.positions for name in samples.values()]
        root, tips = (
            sum(e.jerk_by_depth_m_s3[end] for e in positions) / len(positions) for end in (0, -1)
        )
        if isfinite(root + tips):
            sentences.append(f"{system} {format_two_digits(root)} and {format_two_digits(tips)}")
    start = "Mean joint jerk in m/s³, at the pelvis and at the outermost finger joints"
    return f"{start}: {', '.join(sentences)}." if sentences else ""


def _attribution(diagnostics: Diagnostics) -> str:
    """Name the joint of each system that reduces the point's jerk most when it is smoothed."""
    sentences, without = [], []
    for system, samples in sample_names_by_system(diagnostics.systems).items():
        shares: dict[str, list[float]] = {}
        for name in samples.values():
            attribution = diagnostics.systems[name].raw.point.tip_jerk_attribution
            for joint, share in zip(attribution.joints, attribution.share.tolist(), strict=True):
                if isfinite(share):
                    shares.setdefault(joint, []).append(share)
        means = {joint: sum(each) / len(each) for joint, each in shares.items()}
        joint = max(means, key=lambda name: means[name], default="")
        if joint and means[joint] >= SMALL_SHARE:
            share = format_two_digits(100 * means[joint])
            sentences.append(f"{point_title(joint).lower()} in {system} (by {share} %)")
        elif joint:
            without.append(system)
    point = point_title(diagnostics.tracked_point).lower()
    least = f"{100 * SMALL_SHARE:.0f} %"
    if not sentences and not without:
        return ""
    if not sentences:
        return (
            f"In {join_names(without)}, smoothing a single joint never reduces the jerk of the "
            f"{point} by {least} or more."
        )
    few = ""
    if without:
        few = f"; in {join_names(without)}, smoothing one joint reduces it by less than {least}"
    start = f"Joint whose smoothing reduces the jerk of the {point} most"
    return f"{start}: {join_names(sentences)}{few}."


def _seams(diagnostics: Diagnostics, raw: Table) -> str:
    """Describe how far window seams stand out, and which motions have a finding about them."""
    values = raw.get(SEAMS, {})
    if not values.keys() - {REFERENCE_NAME} or diagnostics.windows is None:
        return ""
    names = _with_finding(diagnostics, "seams")
    motions = join_names(names) if names else "none"
    return (
        f"Peak jerk at window seams (every {diagnostics.windows.advance} frames) divided by the "
        f"peak jerk elsewhere: {format_means(values)}. Motions with jerk that "
        f"recurs significantly at the seams: {motions}."
    )


def _with_finding(diagnostics: Diagnostics, kind: str) -> list[str]:
    """Return the motions that have a finding of a kind."""
    return [
        name
        for name, findings in diagnostics.findings.items()
        if name != REFERENCE_NAME and any(finding.kind == kind for finding in findings)
    ]


def _periods(diagnostics: Diagnostics) -> str:
    """Describe detected jerk periods, for motions with unknown windows."""
    names = _with_finding(diagnostics, "period")
    periods = [
        f"every {period.frames} frames in {name}, strongest in the {period.part}"
        for name in names
        if (period := diagnostics.systems[name].raw.seams.period) is not None
    ]
    if periods:
        return f"Periodic jerk, a sign of window seams: {'; '.join(periods)}."
    if any("detail" in lacks for lacks in diagnostics.missing_parts.values()):
        return ""
    return "The jerk has no period between 2 and 240 frames, so there is no sign of window seams."


def _beats(diagnostics: Diagnostics) -> str:
    """List the motions with beats that follow the speech more than chance; empty without any."""
    beats_by_name = {name: each.raw.beats for name, each in diagnostics.metrics_by_name.items()}
    beats = {
        name: (of.beat_align, of.beat_align_chance, of.beat_align_chance_highest)
        for name, of in beats_by_name.items()
        if of is not None and isfinite(of.beat_align - of.beat_align_chance)
    }
    scores = [
        f"{name} {score:.2f} (time-shifted onsets: mean {chance:.2f}, maximum {highest:.2f})"
        for name, (score, chance, highest) in beats.items()
        if round(score, 2) > round(highest, 2)
    ]
    rest = "; the others are not above chance" if len(scores) < len(beats) else ""
    return f"BeatAlign above chance: {', '.join(scores)}{rest}." if scores else ""


def _lag_sentence(diagnostics: Diagnostics) -> str:
    """Describe the lag of each motion behind the speech."""
    lags = {name: versions.raw.lag for name, versions in diagnostics.metrics_by_name.items()}
    sentences = [
        f"{name} {lag.lag_s:z.2f} s (95 % confidence interval {lag.lag_low_s:z.2f} to "
        f"{lag.lag_high_s:z.2f}, measured from the {lag.lag_source})"
        for name, lag in lags.items()
        if lag is not None and lag.is_detected
    ]
    if unknown := [name for name, lag in lags.items() if lag is not None and not lag.is_detected]:
        sentences.append(
            f"{join_names(unknown)} unknown, because neither face nor body follows the speech "
            "closely enough"
        )
    return f"Lag behind the speech: {'; '.join(sentences)}." if sentences else ""
