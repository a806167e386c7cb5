"""Where the jitter sits: all numbers of a set of motions, and how ``diagnostics.json`` tells them.

Its keys are a public format, documented in ``docs/formats.md``. Jitter is always measured raw and
once more behind one and the same filter, the official GlobalDiff inference's
(`model.motion.altered`), here applied to the stitched sequence.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from conventions.joints import FINGERTIP_NAMES, JOINT_DEPTH, JOINT_NAMES
from conventions.names import REFERENCE_NAME, VERSIONS, Version
from conventions.rates import FPS
from model.faults.evidence import Evidence, Finding
from model.faults.table import find_faults
from model.generation.base import Windowing
from model.measures.beats import (
    BEAT_JOINTS,
    audio_to_motion_and_chance,
    beats_per_joint_s,
    counted,
    joint_speeds,
)
from model.measures.differences import diversity, error_to_reference
from model.measures.joints import (
    fingertip_measures,
    position_measures,
    range_measures,
    rotation_measures,
)
from model.measures.lag import find_lag
from model.measures.point import point_measures
from model.measures.posture import posture_measures
from model.measures.results import BeatMeasures, BeatSpeeds, Measures
from model.measures.seams import Period, find_period, seam_measures
from model.motion.altered import smooth_motion
from model.motion.kinematics import RestSkeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import POINT_NAMES, TipTrack, Tracks, moving_chain, track_points

OWN_WINDOWS = Windowing(frames=60, overlap=8)
"""Of GlobalDiff's systems: 60 frames, of which two windows share 8."""
TIP = "right_middle"
"""The fingertip of the paper's Figure 6."""


def measure_motion(
    motion: Motion,
    skeleton: RestSkeleton,
    tip: str = TIP,
    windows: Windowing | None = OWN_WINDOWS,
) -> Measures:
    """The numbers of one motion as it is.

    Args:
        tip: the fingertip or joint that the ``tip_`` measures follow.
        windows: how it was cut, if that is known.
    """
    tracks = track_points(motion, skeleton)
    period = find_period(tracks)
    return measure_tracks(tracks, tracks.point(tip), tip, skeleton, windows, period)


def measures(motion: Motion, skeleton: RestSkeleton, tip: str = TIP) -> dict[str, Any]:
    """What `measure_motion` finds, by the keys of ``diagnostics.json``."""
    return measure_motion(motion, skeleton, tip).as_json()


def measure_tracks(
    tracks: Tracks,
    point: Float[np.ndarray, "T 3"],
    name: str,
    skeleton: RestSkeleton,
    windows: Windowing | None,
    period: Period | None,
) -> Measures:
    """What `measure_motion` returns, where forward kinematics has been done.

    Args:
        point: positions of the followed point in metres, which is called ``name``.
        period: what `find_period` finds in the motion as it is, before any filter.
    """
    return Measures(
        point_measures(point, tracks, moving_chain(name)),
        fingertip_measures(tracks),
        position_measures(tracks),
        rotation_measures(tracks),
        seam_measures(tracks, windows, period),
        posture_measures(tracks),
        range_measures(tracks, skeleton),
        diversity(tracks.joints),
    )


JERK_FRAMES = 4


@dataclass(frozen=True)
class Versions:
    """One motion's measures as it is and filtered."""

    raw: Measures
    savgol: Measures

    def of(self, kind: Version) -> Measures:
        return self.raw if kind == "raw" else self.savgol

    def as_json(self) -> dict[str, Any]:
        return {"raw": self.raw.as_json(), "savgol": self.savgol.as_json()}


@dataclass(frozen=True)
class Diagnostics:
    """Each motion and the reference, raw and filtered."""

    point: str
    """The fingertip or joint that the ``tip_`` measures follow."""
    tip_source: str
    windows: Windowing | None
    """Those of all motions, where they are known and all the same."""
    num_frames: dict[str, int]
    notes: list[str]
    findings: dict[str, list[Finding]]
    reference: Versions | None
    systems: dict[str, Versions]
    assumed: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    """Of motions from files: as what they were understood (`formats.reading`)."""
    lacks: dict[str, list[str]] = field(default_factory=dict)
    """Parts that a file does not tell, of which nothing is found."""

    def as_json(self) -> dict[str, Any]:
        """The content of ``diagnostics.json``."""
        return {
            "fps": FPS,
            "tip": self.point if self.point in FINGERTIP_NAMES else None,
            "joint": self.point,
            "tip_source": self.tip_source,
            "window_advance_frames": self.windows and self.windows.advance,
            "window_overlap_frames": self.windows and self.windows.overlap,
            "joint_names": list(JOINT_NAMES),
            "depth_of_joint": list(JOINT_DEPTH),
            "fingertip_names": list(FINGERTIP_NAMES),
            "num_frames": self.num_frames,
            "notes": self.notes,
            "assumed": self.assumed,
            "lacks": self.lacks,
            "findings": {
                name: [finding.as_json() for finding in found]
                for name, found in self.findings.items()
            },
            "reference": None if self.reference is None else self.reference.as_json(),
            "systems": {name: versions.as_json() for name, versions in self.systems.items()},
        }


def diagnose(
    motions: Mapping[str, Motion],
    skeleton: RestSkeleton,
    reference: Motion | None = None,
    windows: Mapping[str, Windowing] | None = None,
    tip: str = TIP,
    tip_track: TipTrack | None = None,
    tip_source: str | None = None,
    joint: str | None = None,
    onsets_s: Float[np.ndarray, " onsets"] | None = None,
    heard: Float[np.ndarray, "frames bands"] | None = None,
    mean_speeds: Float[np.ndarray, " 13"] | None = None,
) -> Diagnostics:
    """Measure motions and the reference, raw and filtered.

    With a reference everything is measured over the same frames: all are cut to the shortest, and
    ``notes`` says so. Without one each motion is measured whole.

    Args:
        motions: by the name that the file shall give them.
        windows: how motions were cut, by name (also of `REFERENCE_NAME`), where that is known.
            The seam measures of another motion are folded on the period that is found in it.
        tip: the fingertip that the ``tip_`` measures follow.
        tip_track: gives its positions in place of the rigid fingertip, of a motion and its tracks.
        tip_source: what ``tip_track`` follows, such as 'vertex 7794'; without it 'rigid' for a
            fingertip and 'joint' for a joint.
        joint: a fingertip or joint to follow in place of ``tip``.
        onsets_s: times of the speech's onsets (`beats.speech_onsets`), for BeatAlign.
        heard: of the speech by frame (`lag.heard_of`), for how late the motion is.
        mean_speeds: published ones for BeatAlign (`beats.read_mean_speeds`).

    Raises:
        ValueError: if there is no such fingertip or joint.
    """
    settings = _Settings(
        skeleton=skeleton,
        point=_known_point(joint or tip),
        tip_track=tip_track,
        onsets_s=onsets_s,
        heard=heard,
        mean_speeds=mean_speeds,
    )
    windows = windows or {}
    motions, reference, notes = _cut_alike(motions, reference)
    notes += [
        f"{name} has {motion.num_frames} {'frame' if motion.num_frames == 1 else 'frames'}; speed "
        "needs 2, acceleration 3 and jerk 4."
        for name, motion in motions.items()
        if motion.num_frames < JERK_FRAMES
    ]
    recorded = None if reference is None else dict(_versions(reference, settings))
    findings: dict[str, list[Finding]] = {}
    faults: list[Finding] = []
    measured_reference = evidence = None
    if recorded is not None and reference is not None:
        measured_reference, faults, evidence = _measured(
            reference,
            iter(recorded.items()),
            None,
            settings,
            windows.get(REFERENCE_NAME),
            None,
            True,
        )
    systems = {}
    for name, motion in motions.items():
        systems[name], findings[name], _ = _measured(
            motion, _versions(motion, settings), recorded, settings, windows.get(name), evidence
        )
    if measured_reference is not None:
        findings[REFERENCE_NAME] = faults
    named = [*systems, REFERENCE_NAME] if measured_reference else [*systems]
    return Diagnostics(
        point=settings.point,
        tip_source=tip_source or ("rigid" if settings.point in FINGERTIP_NAMES else "joint"),
        windows=_common_windows([windows.get(name) for name in named]),
        num_frames={name: motion.num_frames for name, motion in motions.items()},
        notes=notes,
        findings=findings,
        reference=measured_reference,
        systems=systems,
    )


def raw_evidence(
    motion: Motion,
    skeleton: RestSkeleton,
    reference: Evidence | None = None,
    windows: Windowing | None = None,
    point: str = TIP,
    onsets_s: Float[np.ndarray, " onsets"] | None = None,
    heard: Float[np.ndarray, "frames bands"] | None = None,
    mean_speeds: Float[np.ndarray, " 13"] | None = None,
) -> Evidence:
    """One motion's measures as it is only, and what faults are looked for in, where filtered
    numbers are not asked for. A reference must be as long.

    Args:
        onsets_s, heard, mean_speeds: see `diagnose`.
    """
    tracks = track_points(motion, skeleton)
    period = find_period(tracks)
    numbers = measure_tracks(tracks, tracks.point(point), point, skeleton, windows, period)
    if reference is not None:
        numbers = replace(numbers, errors=error_to_reference(tracks, reference.tracks))
    if onsets_s is not None:
        recorded = None if reference is None else reference.tracks
        usual_speed = _usual_speed(mean_speeds, recorded, tracks)
        numbers = replace(numbers, beats=_measure_beats(tracks, *usual_speed, onsets_s))
    if heard is not None:
        numbers = replace(numbers, lag=find_lag(motion, heard))
    return Evidence(motion, tracks, numbers, point, reference)


@dataclass(frozen=True)
class _Settings:
    skeleton: RestSkeleton
    point: str
    tip_track: TipTrack | None
    onsets_s: Float[np.ndarray, " onsets"] | None
    heard: Float[np.ndarray, "frames bands"] | None
    mean_speeds: Float[np.ndarray, " 13"] | None


class _Version(NamedTuple):
    tracks: Tracks
    point: Float[np.ndarray, "T 3"]


def _versions(motion: Motion, settings: _Settings) -> Iterator[tuple[Version, _Version]]:
    """The motion as it is and filtered, one after the other: a long clip's tracks are large."""
    for kind in VERSIONS:
        version = motion if kind == "raw" else smooth_motion(motion)
        tracks = track_points(version, settings.skeleton)
        if settings.tip_track is None:
            point = tracks.point(settings.point)
        else:
            point = np.asarray(settings.tip_track(version, tracks), dtype=np.float64)
        yield kind, _Version(tracks, point)
        del tracks, point


def _measured(
    motion: Motion,
    versions: Iterator[tuple[Version, _Version]],
    recorded: dict[Version, _Version] | None,
    settings: _Settings,
    windows: Windowing | None,
    reference: Evidence | None,
    is_reference: bool = False,
) -> tuple[Versions, list[Finding], Evidence | None]:
    """Measures by version, the faults, and, of the reference itself, what others are held against.

    Like is compared with like, a filtered motion with the filtered reference.
    """
    found: list[Measures] = []
    faults: list[Finding] = []
    period = evidence = None
    usual_speed = None
    lag = None if settings.heard is None else find_lag(motion, settings.heard)
    for kind, version in versions:
        if kind == "raw":  # it comes first
            period = find_period(version.tracks)
            of_recorded = None if recorded is None else recorded["raw"].tracks
            usual_speed = _usual_speed(settings.mean_speeds, of_recorded, version.tracks)
        numbers = measure_tracks(
            version.tracks,
            version.point,
            settings.point,
            settings.skeleton,
            windows,
            period,
        )
        errors = beats = None
        if recorded is not None:
            errors = error_to_reference(version.tracks, recorded[kind].tracks)
        if settings.onsets_s is not None and usual_speed is not None:
            beats = _measure_beats(version.tracks, *usual_speed, settings.onsets_s)
        numbers = replace(numbers, errors=errors, beats=beats, lag=lag)
        found.append(numbers)
        if kind == "raw":
            evidence = Evidence(motion, version.tracks, numbers, settings.point, reference)
            faults = find_faults(evidence)
            if not is_reference:
                evidence = None  # a long clip's tracks are large
        del version  # before the next one is made
    return Versions(*found), faults, evidence


def _common_windows(windows: Sequence[Windowing | None]) -> Windowing | None:
    return windows[0] if len(set(windows)) == 1 else None


def _measure_beats(
    tracks: Tracks,
    usual_speed: Float[np.ndarray, " joints"],
    speeds_of: BeatSpeeds,
    onsets_s: Float[np.ndarray, " onsets"],
) -> BeatMeasures:
    num_onsets = len(counted(onsets_s, len(tracks.joints) / FPS))
    score = mean = highest = rate = math.nan
    if len(tracks.joints) > 1:
        positions = _rooted(tracks)
        rate = beats_per_joint_s(positions, usual_speed)
        if num_onsets:
            score, chance = audio_to_motion_and_chance(positions, onsets_s, usual_speed)
            mean, highest = float(chance.mean()), float(chance.max())
    return BeatMeasures(score, mean, highest, rate, num_onsets, speeds_of)


def _usual_speed(
    published: Float[np.ndarray, " joints"] | None, recorded: Tracks | None, own: Tracks
) -> tuple[Float[np.ndarray, " joints"], BeatSpeeds]:
    """Mean speeds of the joints, m/s, and whose: the published ones if there are any."""
    if published is not None:
        return published, "emage"
    if recorded is not None:
        return _mean_speed(recorded), "reference"
    return _mean_speed(own), "own"


def _mean_speed(tracks: Tracks) -> Float[np.ndarray, " joints"]:
    """Of the joints whose beats count, m/s, the pelvis in place."""
    if len(tracks.joints) < 2:
        return np.zeros(len(BEAT_JOINTS))
    return joint_speeds(_rooted(tracks)[:, BEAT_JOINTS]).mean(axis=0)


def _rooted(tracks: Tracks) -> Float[np.ndarray, "T 55 3"]:
    return tracks.joints - tracks.joints[:, :1]


def _known_point(name: str) -> str:
    if name not in POINT_NAMES:
        raise ValueError(
            f"{name} is neither a fingertip nor a joint; choose one of {', '.join(POINT_NAMES)}."
        )
    return name


def _cut_alike(
    motions: Mapping[str, Motion], reference: Motion | None
) -> tuple[dict[str, Motion], Motion | None, list[str]]:
    if reference is None or not motions:
        return dict(motions), reference, []
    named = {**motions, "The reference": reference}
    shortest = min(motion.num_frames for motion in named.values())
    notes = [
        f"{name} has {motion.num_frames} frames; the first {shortest} were measured, as many as "
        "the shortest motion has."
        for name, motion in named.items()
        if motion.num_frames > shortest
    ]
    return (
        {name: first_frames(motion, shortest) for name, motion in motions.items()},
        first_frames(reference, shortest),
        notes,
    )
