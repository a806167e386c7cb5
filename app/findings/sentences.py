"""One plain sentence under each plot, made from its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING

from app.findings.comparison import (
    mean,
    number_of,
    numbers_told,
    plain,
    point_title,
    samples_by_system,
    told_of,
    values_by_system,
)
from conventions.names import REFERENCE_NAME, listed, short_names

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics, Versions
    from model.measures.results import Measures

SEAM_STANDS_OUT = 1.5
"""From so many times the reference's ratio on, or 1 where that is less, joins are told to stand
out. A clip has few joins, so chance decides much: a recorded one, which has none, gave 0.7."""
SMALL_SHARE = 0.05


def jerk_of(measures: Measures) -> float:
    """Of the followed point."""
    return measures.point.tip_jerk_m_s3


def seams_of(measures: Measures) -> float:
    """How far the joins of windows stand out."""
    return measures.seams.seam_jerk_ratio


def fast_power_of(measures: Measures) -> float:
    """Of the followed point, in percent."""
    return 100 * measures.point.tip_velocity_power_above_5hz


def sentences_of(diagnostics: Diagnostics) -> dict[str, str]:
    """The sentences of a run's numbers, by plot; empty where there is nothing to say.

    Samples of one system, ``<system>.s2`` and on, are taken together, and called as on the page.
    """
    labels = short_names(diagnostics.systems)
    systems = {labels[name]: versions for name, versions in diagnostics.systems.items()}
    diagnostics = replace(diagnostics, systems=systems)
    point = point_title(diagnostics.point)
    return {
        "trajectory": numbers_told(diagnostics, jerk_of, f"{point} jerk in m/s³"),
        "depth": _depth(diagnostics),
        "spectrum": numbers_told(diagnostics, fast_power_of, f"{point} power above 5 Hz in %"),
        "attribution": _attribution(diagnostics),
        "seams": _periods(diagnostics) if diagnostics.windows is None else _seams(diagnostics),
        "beats": _beats(diagnostics),
        "step": _step(diagnostics),
    }


def _depth(diagnostics: Diagnostics) -> str:
    """How jerk grows along the chain."""
    root = values_by_system(diagnostics, lambda m: m.positions.jerk_by_depth_m_s3[0], "raw")
    tips = values_by_system(diagnostics, lambda m: m.positions.jerk_by_depth_m_s3[-1], "raw")
    told = [f"{name} {plain(mean(root[name]))} to {plain(mean(tips[name]))}" for name in tips]
    ends = "from the pelvis to the last finger joints"
    return f"Jerk of the joints in m/s³, {ends}: {', '.join(told)}." if told else ""


def _attribution(diagnostics: Diagnostics) -> str:
    """The joint of each system whose smoothing takes most jerk from the point."""
    told = []
    for system, samples in samples_by_system(diagnostics.systems).items():
        shares = _mean_shares([diagnostics.systems[name].raw for name in samples.values()])
        if not shares:
            continue
        joint = max(shares, key=lambda name: shares[name])
        if shares[joint] < SMALL_SHARE:
            told.append(f"of {system} none stands out")
        else:
            share = plain(100 * shares[joint])
            told.append(f"of {system} the {joint.replace('_', ' ')} ({share} %)")
    point = point_title(diagnostics.point).lower()
    start = f"The joint whose smoothing alone takes most jerk from the {point}"
    return f"{start}: {', '.join(told)}." if told else ""


def _mean_shares(samples: list[Measures]) -> dict[str, float]:
    """Joint to its share, mean over the samples that have one."""
    found: dict[str, list[float]] = {}
    for raw in samples:
        attribution = raw.point.tip_jerk_attribution
        for joint, share in zip(attribution.joints, attribution.share.tolist(), strict=True):
            if isfinite(share):
                found.setdefault(joint, []).append(share)
    return {joint: sum(shares) / len(shares) for joint, shares in found.items()}


def _seams(diagnostics: Diagnostics) -> str:
    """How far the joins of windows stand out."""
    raw = values_by_system(diagnostics, seams_of, "raw")
    if not raw or diagnostics.windows is None:
        return ""
    reference = number_of(diagnostics.reference, seams_of, "raw")
    limit = SEAM_STANDS_OUT * max(1.0, reference or 0.0)
    out = [system for system, samples in raw.items() if mean(samples) > limit]
    return (
        f"Peak jerk where windows join, every {diagnostics.windows.advance} frames, over that"
        f" elsewhere: {told_of(raw, reference)}."
        f" {f'Joins of {listed(out)}' if out else 'No joins'} stand out."
    )


def _periods(diagnostics: Diagnostics) -> str:
    """What was found where nobody says how motions were cut."""
    told = [
        f"that of {name} every {period.frames} frames, most in the {period.part}"
        for name, versions in diagnostics.systems.items()
        if (period := versions.raw.seams.period) is not None
    ]
    if not told:
        return "Jerk comes again after no number of frames, 2 to 240 were tried."
    return f"Jerk comes again: {'; '.join(told)}."


def _with_reference(diagnostics: Diagnostics) -> Mapping[str, Versions]:
    reference = diagnostics.reference
    return diagnostics.systems | ({} if reference is None else {REFERENCE_NAME: reference})


def _beats(diagnostics: Diagnostics) -> str:
    """In which motions beats follow the speech more than chance has it."""
    found = {name: versions.raw.beats for name, versions in _with_reference(diagnostics).items()}
    beats = {
        name: each
        for name, each in found.items()
        if each is not None and isfinite(each.beat_align - each.beat_align_chance)
    }
    told = [
        f"{name} {each.beat_align:.2f} (chance {each.beat_align_chance:.2f})"
        for name, each in beats.items()
        if each.beat_align > each.beat_align_chance_highest
    ]
    if not told:
        at_chance = "BeatAlign is at chance: the same speech shifted in time gives as much."
        return at_chance if beats else ""
    rest = "; the others are at chance" if len(told) < len(beats) else ""
    return f"BeatAlign above chance: {', '.join(told)}{rest}."


def _step(diagnostics: Diagnostics) -> str:
    """How late each motion is."""
    told = [
        f"{name} {lag.lag_s:+z.2f} s ({lag.lag_low_s:+z.2f} to {lag.lag_high_s:+z.2f}, by its"
        f" {lag.lag_ground})"
        if lag.is_known
        else f"{name} unknown, as neither its face nor its body follows this speech"
        for name, versions in _with_reference(diagnostics).items()
        if (lag := versions.raw.lag) is not None
    ]
    return f"Behind the speech: {'; '.join(told)}." if told else ""
