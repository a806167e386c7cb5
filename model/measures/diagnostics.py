"""Where the jitter sits: the content of ``diagnostics.json`` for a set of motions.

The keys are a public format, documented in ``docs/formats.md``. Jitter is always measured raw and
once more behind one and the same filter, the official GlobalDiff inference's
(`model.motion.filtering`),
here applied to the stitched sequence.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from model.measures.beats import BEAT_JOINTS, MARGIN_S, beat_scores, joint_speeds
from model.measures.findings import find_faults
from model.measures.measures import (
    TIP,
    WINDOW_ADVANCE,
    WINDOW_OVERLAP,
    Measures,
    as_json,
    measures,
    measures_of_tracks,
    measures_to_reference,
)
from model.motion.filtering import smooth_motion
from model.motion.motion import Motion, first_frames
from model.motion.skeleton import (
    FINGERTIP_NAMES,
    JOINT_DEPTH,
    JOINT_NAMES,
    RestSkeleton,
)
from model.motion.timing import FPS
from model.motion.tracks import POINT_NAMES, TipTrack, Tracks, track_points

__all__ = ["diagnose", "first_frames", "measures", "smooth_motion", "track_points"]

JERK_FRAMES = 4
REFERENCE = "reference"
"""What the recorded motion is called beside the systems."""


def diagnose(
    motions: Mapping[str, Motion],
    skeleton: RestSkeleton,
    reference: Motion | None = None,
    window_advance: int = WINDOW_ADVANCE,
    window_overlap: int = WINDOW_OVERLAP,
    tip: str = TIP,
    tip_track: TipTrack | None = None,
    tip_source: str | None = None,
    joint: str | None = None,
    onsets_s: Float[np.ndarray, " onsets"] | None = None,
) -> dict[str, Any]:
    """The content of ``diagnostics.json``: each motion and the reference, raw and filtered.

    With a reference everything is measured over the same frames: all are cut to the shortest, and
    ``notes`` says so. Without one each motion is measured whole.

    Args:
        motions: by the name that the file shall give them.
        tip: the fingertip that the ``tip_`` measures follow.
        tip_track: gives its positions in place of the rigid fingertip, of a motion and its tracks.
        tip_source: what ``tip_track`` follows, such as 'vertex 7794'; without it 'rigid' for a
            fingertip and 'joint' for a joint.
        joint: a fingertip or joint to follow in place of ``tip``.
        onsets_s: times of the speech's onsets (`beats.speech_onsets`), for BeatAlign.

    Raises:
        ValueError: if there is no such fingertip or joint.
    """
    settings = _Settings(
        skeleton=skeleton,
        point=_known_point(joint or tip),
        tip_track=tip_track,
        window_advance=window_advance,
        window_overlap=window_overlap,
        onsets_s=onsets_s,
    )
    motions, reference, notes = _cut_alike(motions, reference)
    notes += [
        f"{name} has {motion.num_frames} {'frame' if motion.num_frames == 1 else 'frames'}; speed "
        "needs 2, acceleration 3 and jerk 4."
        for name, motion in motions.items()
        if motion.num_frames < JERK_FRAMES
    ]
    recorded = None if reference is None else dict(_versions(reference, settings))
    systems = {
        name: _measured(_versions(motion, settings), recorded, settings)
        for name, motion in motions.items()
    }
    measured_reference = (
        None if recorded is None else _measured(iter(recorded.items()), None, settings)
    )
    everything = systems | ({REFERENCE: measured_reference} if measured_reference else {})
    is_fingertip = settings.point in FINGERTIP_NAMES
    return {
        "fps": FPS,
        "tip": settings.point if is_fingertip else None,
        "joint": settings.point,
        "tip_source": tip_source or ("rigid" if is_fingertip else "joint"),
        "window_advance_frames": window_advance,
        "window_overlap_frames": window_overlap,
        "joint_names": list(JOINT_NAMES),
        "depth_of_joint": list(JOINT_DEPTH),
        "fingertip_names": list(FINGERTIP_NAMES),
        "num_frames": {name: motion.num_frames for name, motion in motions.items()},
        "notes": notes,
        "findings": {
            name: find_faults(versions["raw"], settings.point, window_advance)
            for name, versions in everything.items()
        },
        "reference": measured_reference,
        "systems": systems,
    }


@dataclass(frozen=True)
class _Settings:
    skeleton: RestSkeleton
    point: str
    tip_track: TipTrack | None
    window_advance: int
    window_overlap: int
    onsets_s: Float[np.ndarray, " onsets"] | None


class _Version(NamedTuple):
    tracks: Tracks
    point: Float[np.ndarray, "T 3"]


def _versions(motion: Motion, settings: _Settings) -> Iterator[tuple[str, _Version]]:
    """The motion as it is and filtered, one after the other: a long clip's tracks are large."""
    for name in ("raw", "savgol"):
        version = motion if name == "raw" else smooth_motion(motion)
        tracks = track_points(version, settings.skeleton)
        if settings.tip_track is None:
            point = tracks.point(settings.point)
        else:
            point = np.asarray(settings.tip_track(version, tracks), dtype=np.float64)
        yield name, _Version(tracks, point)
        del tracks, point


def _measured(
    versions: Iterator[tuple[str, _Version]],
    recorded: dict[str, _Version] | None,
    settings: _Settings,
) -> dict[str, Measures]:
    """Measures by version; like is compared with like, a filtered motion with the filtered
    reference."""
    found = {}
    usual_speed = None if recorded is None else _mean_speed(recorded["raw"].tracks)
    for name, version in versions:
        numbers = measures_of_tracks(
            version.tracks,
            version.point,
            settings.point,
            settings.skeleton,
            settings.window_advance,
            settings.window_overlap,
        )
        if recorded is not None:
            numbers |= measures_to_reference(version.tracks, recorded[name].tracks)
        if usual_speed is None:  # raw comes first
            usual_speed = _mean_speed(version.tracks)
        if settings.onsets_s is not None:
            numbers |= _beat_measures(version.tracks, usual_speed, settings.onsets_s)
        found[name] = numbers
        del version  # before the next one is made
    return found


def _beat_measures(
    tracks: Tracks,
    usual_speed: Float[np.ndarray, " joints"],
    onsets_s: Float[np.ndarray, " onsets"],
) -> Measures:
    """BeatAlign in EMAGE's direction and its chance level; None where no onset counts.

    Args:
        usual_speed: decides what is slow: the reference's mean, or else the motion's own.
    """
    duration_s = len(tracks.joints) / FPS
    if not np.any((onsets_s >= MARGIN_S) & (onsets_s < duration_s - MARGIN_S)):
        return {"beat_align": None, "beat_align_chance": None}
    scores = beat_scores(_rooted(tracks), onsets_s, usual_speed)
    return as_json(
        {
            "beat_align": scores["beat_align_audio_to_motion"],
            "beat_align_chance": scores["beat_align_audio_to_motion_chance"],
        }
    )


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
