"""One plain sentence under each plot, made from its numbers, and the findings in their order.

Every word that compares is chosen by the numbers: where two systems change places, so does the
sentence, and where they are alike it says that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite, log
from typing import TYPE_CHECKING

from app.findings.comparison import (
    ALIKE,
    Samples,
    comparison,
    extremes,
    mean,
    number_of,
    plain,
    point_title,
    samples_by_system,
    times,
    values_by_system,
    word,
)
from conventions.names import REFERENCE_NAME, listed, short_names

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics
    from model.faults.evidence import Finding
    from model.measures.results import Measures

SEAM_STANDS_OUT = 1.5
"""From this ratio on, and above the reference's, joins are told to stand out. A clip has few joins,
so chance decides much: a recorded one of 400 frames, which has none, gave 0.7."""
SMALL_SHARE = 0.05
CHANCE_SHIFTS = 20
"""As `model.measures.beats` makes them, which brings scipy; a test holds them equal."""
SPEEDS_OF = {
    "reference": "the reference's mean speeds",
    "own": "each motion's own mean speeds",
    "emage": "EMAGE's published mean speeds",
}
"""Whose mean speeds decide which minima are beats."""


def jerk_of(measures: Measures) -> float:
    """Of the followed point."""
    return measures.point.tip_jerk_m_s3


def seams_of(measures: Measures) -> float:
    """How far the joins of windows stand out."""
    return measures.seams.seam_jerk_ratio


def sentences_of(diagnostics: Diagnostics) -> dict[str, str]:
    """The sentences of a run's numbers, by plot; empty where there is nothing to say.

    The keys are trajectory, depth, spectrum, attribution, seams, reference, beats and step. Samples
    of one system, ``<system>.s2`` and on, are taken together; each is called as on the page.
    """
    labels = short_names(diagnostics.systems)
    systems = {labels[name]: versions for name, versions in diagnostics.systems.items()}
    diagnostics = replace(diagnostics, systems=systems)
    return {
        "trajectory": _trajectory(diagnostics),
        "depth": _depth(diagnostics),
        "spectrum": _spectrum(diagnostics),
        "attribution": _attribution(diagnostics),
        "seams": _seams(diagnostics),
        "reference": _reference(diagnostics),
        "beats": _beats(diagnostics),
        "step": _step(diagnostics),
    }


def _trajectory(diagnostics: Diagnostics) -> str:
    noun = f"{_point(diagnostics)} jerk"
    found = comparison(diagnostics, jerk_of, noun, "m/s³")
    return found or f"The motions are too short for {noun}: it takes four frames."


def _spectrum(diagnostics: Diagnostics) -> str:
    noun = "share of velocity power above 5 Hz"
    found = comparison(
        diagnostics, lambda m: m.point.tip_velocity_power_above_5hz, noun, "%", scale=100.0
    )
    return found or f"No motion is long enough, or moves enough, for the {noun}."


def _depth(diagnostics: Diagnostics) -> str:
    """How the two systems of the first sentence drift apart along the chain, if they do."""
    profiles = _profiles(diagnostics)
    jerks = values_by_system(diagnostics, jerk_of, "raw")
    shown = [system for system in jerks if system in profiles]
    if not shown:
        return "The motions are too short for a profile of jerk by depth."
    ends = {system: (profiles[system][0], profiles[system][-1]) for system in shown}
    last = len(profiles[shown[0]]) - 1
    places = f"the pelvis (depth 0) to the last finger joints (depth {last})"
    if len(shown) == 1:
        (root, tip) = ends[shown[0]]
        return f"With {shown[0]} the mean jerk of the joints {_course(root, tip)} from {places}."
    high, low = extremes({system: jerks[system] for system in shown})
    (high_root, high_tip), (low_root, low_tip) = ends[high], ends[low]
    if min(high_root, low_root, high_tip, low_tip) <= 0.0:
        return (
            f"The mean jerk of the joints {_course(high_root, high_tip)} with {high} and"
            f" {_course(low_root, low_tip)} with {low}, from {places}."
        )
    at_root, at_tip = high_root / low_root, high_tip / low_tip
    course = word(at_tip / at_root, "grows", "falls", "stays the same within 5 %")
    return (
        f"From {places} the jerk of {high} relative to {low} {course}: {times(at_root)} at the"
        f" pelvis, {times(at_tip)} at the fingers ({plain(high_tip)} against {plain(low_tip)}"
        " m/s³)."
    )


def _profiles(diagnostics: Diagnostics) -> dict[str, list[float]]:
    """Mean over samples of each system's jerk by depth, where it is known at every depth."""
    profiles = {}
    for system, samples in samples_by_system(diagnostics.systems).items():
        curves = [
            diagnostics.systems[name].raw.positions.jerk_by_depth_m_s3.tolist()
            for name in samples.values()
        ]
        depths = list(zip(*curves, strict=True))
        if all(isfinite(value) for depth in depths for value in depth):
            profiles[system] = [sum(depth) / len(depth) for depth in depths]
    return profiles


def _course(root: float, tip: float) -> str:
    numbers = f"{plain(root)} to {plain(tip)} m/s³"
    if root <= 0.0 or tip <= 0.0:
        return f"goes from {numbers}"
    return f"{word(tip / root, 'grows', 'falls', 'stays the same within 5 %')} ({numbers})"


def _attribution(diagnostics: Diagnostics) -> str:
    """The joint of each of two systems whose smoothing takes most jerk from the point."""
    point = _point(diagnostics)
    strongest = {}
    for system, samples in samples_by_system(diagnostics.systems).items():
        shares = _mean_shares([diagnostics.systems[name].raw for name in samples.values()])
        if shares:
            joint = max(shares, key=lambda name: shares[name])
            strongest[system] = (joint, shares[joint])
    if not strongest:
        return f"No motion has jerk at the {point} that could be told apart by joint."
    order = sorted(strongest, key=lambda system: -strongest[system][1])
    ends = dict.fromkeys((order[0], order[-1]))
    parts = "; with ".join(_strongest_part(name, strongest[name], point) for name in ends)
    return f"With {parts}. Shares of single joints do not add up to the whole."


def _mean_shares(samples: list[Measures]) -> dict[str, float]:
    """Joint to its share, mean over the samples that have one."""
    found: dict[str, list[float]] = {}
    for raw in samples:
        attribution = raw.point.tip_jerk_attribution
        for joint, share in zip(attribution.joints, attribution.share.tolist(), strict=True):
            if isfinite(share):
                found.setdefault(joint, []).append(share)
    return {joint: sum(shares) / len(shares) for joint, shares in found.items()}


def _strongest_part(system: str, strongest: tuple[str, float], point: str) -> str:
    joint, share = strongest
    name, percent = joint.replace("_", " "), f"{plain(100 * share)} %"
    if share <= 0.0:
        return f"{system} no joint's smoothing alone takes jerk from the {point}"
    if share < SMALL_SHARE:
        return f"{system} no single joint stands out ({name} most, {percent})"
    return f"{system} the {name} alone, smoothed, lowers {point} jerk most ({percent})"


def _seams(diagnostics: Diagnostics) -> str:
    """How far the joins of windows stand out, at most and at least."""
    if diagnostics.windows is None:
        return _periods(diagnostics)
    raw = values_by_system(diagnostics, seams_of, "raw")
    advance = diagnostics.windows.advance
    if not raw:
        return f"No motion is long enough for joins of windows, one every {advance} frames."
    filtered = values_by_system(diagnostics, seams_of, "savgol")
    reference = number_of(diagnostics.reference, seams_of, "raw")
    limit = max(SEAM_STANDS_OUT, ALIKE * (reference or 0.0))
    high, low = extremes(raw)
    parts = [_seam_part(system, raw, filtered, limit) for system in dict.fromkeys((high, low))]
    text = f"Where windows join, every {advance} frames, peak jerk is {' and '.join(parts)}"
    if reference is not None:
        text += f"; the reference, which has no joins, has {plain(reference)}"
    return f"{text}."


def _periods(diagnostics: Diagnostics) -> str:
    """What was found where nobody says how motions were cut."""
    periods = {name: of.raw.seams.period for name, of in diagnostics.systems.items()}
    found = [
        f"the jerk of {name} comes again every {period.frames} frames, most in the"
        f" {period.part} ({times(period.peak_over_least)} as high at one frame as at another)"
        for name, period in periods.items()
        if period is not None
    ]
    searched = "Every period from 2 to 240 frames was tried"
    if not found:
        return f"{searched}: jerk repeats in none of the motions beyond chance."
    without = [name for name, period in periods.items() if period is None]
    rest = f"; {', '.join(without)} has none" if len(without) == 1 else "; the others have none"
    return f"{searched}: {', and '.join(found)}{rest if without else ''}."


def _seam_part(
    system: str, raw: Mapping[str, Samples], filtered: Mapping[str, Samples], limit: float
) -> str:
    ratio = mean(raw[system])
    after = f", {plain(mean(filtered[system]))} after the filter" if system in filtered else ""
    verdict = "joins stand out" if ratio > limit else "joins do not stand out"
    return f"{times(ratio)} that elsewhere with {system} ({verdict}{after})"


def _reference(diagnostics: Diagnostics) -> str:
    """Which system's jerk is nearest to the recording's, and how far its joints are off."""
    recorded = number_of(diagnostics.reference, jerk_of, "raw")
    raw = values_by_system(diagnostics, jerk_of, "raw")
    if recorded is None or recorded <= 0.0 or not raw or min(map(mean, raw.values())) <= 0.0:
        return ""
    distance = {system: abs(log(mean(values) / recorded)) for system, values in raw.items()}
    order = sorted(distance, key=lambda system: distance[system])
    nearest, farthest = order[0], order[-1]
    noun = f"{_point(diagnostics)} jerk"
    nearest_has, farthest_has = (times(mean(raw[name]) / recorded) for name in (nearest, farthest))
    text = f"{nearest} has {nearest_has} the reference's {noun}"
    if len(order) > 1:
        if distance[farthest] - distance[nearest] < log(ALIKE):
            text += f" and is no nearer to it than {farthest}, within 5 %"
        else:
            text += f" and is nearest to it; {farthest} has {farthest_has} it"
    errors = _mean_errors(diagnostics)
    if errors:
        best = min(errors, key=lambda system: errors[system])
        worst = max(errors, key=lambda system: errors[system])
        text += f". Joints are {plain(100 * errors[best])} cm from the reference's with {best}"
        if worst != best:
            text += f" and {plain(100 * errors[worst])} cm with {worst}"
        text += "; a motion may differ from one recording and still fit the speech"
    return f"{text}."


def _mean_errors(diagnostics: Diagnostics) -> dict[str, float]:
    """Mean distance of all joints from the reference's, metres, by system."""
    errors = {}
    for system, samples in samples_by_system(diagnostics.systems).items():
        measured = [diagnostics.systems[name].raw.errors for name in samples.values()]
        found = [
            value
            for errors in measured
            if errors is not None
            for value in errors.position_error_m.tolist()
        ]
        if found:
            errors[system] = sum(found) / len(found)
    return errors


def _beats(diagnostics: Diagnostics) -> str:
    """BeatAlign with what it rests on: the number of beats, chance, and whose mean speeds."""
    measured = dict(diagnostics.systems)
    if diagnostics.reference is not None:
        measured["the reference"] = diagnostics.reference
    found = {name: versions.raw.beats for name, versions in measured.items()}
    beats = {
        name: each
        for name, each in found.items()
        if each is not None and isfinite(each.beat_align - each.beat_align_chance)
    }
    if not beats:
        return ""
    above = [
        name for name, each in beats.items() if each.beat_align > each.beat_align_chance_highest
    ]
    if not above:
        return (
            "BeatAlign says nothing here: none follows this speech better than the same speech"
            f" shifted in time ({CHANCE_SHIFTS} shifts)."
        )
    told = ", ".join(
        f"{name} {each.beat_align:.2f} (chance {each.beat_align_chance:.2f}) with"
        f" {each.beats_per_joint_s:.1f} beats a second of each joint"
        for name, each in beats.items()
    )
    speeds = SPEEDS_OF[next(iter(beats.values())).beat_speeds_of]
    onsets = min(each.beat_onsets for each in beats.values())
    return (
        f"BeatAlign over {onsets} onsets, with {speeds}: {told}. Above what these beats have on"
        f" each of {CHANCE_SHIFTS} shifts of the speech: {', '.join(above)}. Only what is above"
        " chance tells of this speech."
    )


def _step(diagnostics: Diagnostics) -> str:
    """How late each motion is."""
    measured = dict(diagnostics.systems)
    if diagnostics.reference is not None:
        measured["the reference"] = diagnostics.reference
    told = [
        f"{name} {lag.lag_s:+z.2f} s ({lag.lag_low_s:+z.2f} to {lag.lag_high_s:+z.2f}, by its"
        f" {lag.lag_ground})"
        if lag.is_known
        else f"{name} unknown, as neither its face nor its body follows this speech"
        for name, versions in measured.items()
        if (lag := versions.raw.lag) is not None
    ]
    return f"Behind the speech: {'; '.join(told)}." if told else ""


def _point(diagnostics: Diagnostics) -> str:
    """The followed point, inside a sentence."""
    return point_title(diagnostics.point).lower()


GRAVEST = 3


def told_findings(findings: Mapping[str, Sequence[Finding]]) -> list[str]:
    """One line each: the gravest few under a heading of their own, the rest by gravity too; last
    in what nothing was found."""
    from model.faults.evidence import ranked

    labels = short_names(findings)
    lines = [f"{labels[name]}: {finding.sentence}" for name, finding in ranked(findings)]
    if len(lines) > GRAVEST:
        lines = ["Gravest first:", *lines[:GRAVEST], "Also found:", *lines[GRAVEST:]]
    return [*lines, *filter(None, [clean_line(findings)])]


def clean_line(findings: Mapping[str, Sequence[object]]) -> str:
    """The motions in which nothing was found; empty where there is none."""
    motions = [name for name in findings if name != REFERENCE_NAME]
    clean = [name for name in motions if not findings[name]]
    if not clean:
        return ""
    labels = short_names(motions)
    which = listed([labels[name] for name in clean])
    return "Nothing stands out." if len(motions) == 1 else f"Nothing stands out in {which}."
