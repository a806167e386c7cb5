"""Metrics and faults of a set of motions, and the content of ``diagnostics.json``.

Its keys are a public format, documented in ``docs/formats.md``. Jitter is always measured without a
filter, and once more after the filter of the official GlobalDiff inference
(`model.motion.transforms`), here applied to the stitched sequence.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from conventions.joints import FINGERTIP_NAMES, JOINT_DEPTH, JOINT_NAMES
from conventions.names import FILTER_VERSIONS, REFERENCE_NAME, FilterVersion
from conventions.rates import FPS
from model.faults.analysis import AnalysedMotion, Finding
from model.faults.table import find_faults
from model.formats.reading import with_current_keys
from model.generation.base import Windowing
from model.metrics.beats import (
    BEAT_JOINTS,
    beat_align_audio_to_motion,
    joint_speeds,
    onsets_between_margins,
    score_and_shifted_scores,
    upper_body_beats,
)
from model.metrics.joints import (
    fingertip_metrics,
    joint_limit_metrics,
    position_metrics,
    rotation_metrics,
)
from model.metrics.lag import find_lag
from model.metrics.posture import posture_metrics
from model.metrics.protocols.clip import ProtocolInputs
from model.metrics.protocols.formulas import protocol_sums, protocol_values
from model.metrics.protocols.table import measurable_without, protocol_of
from model.metrics.reference_error import diversity, error_to_reference
from model.metrics.results import (
    BeatMetrics,
    BeatSpeedSource,
    MotionMetrics,
    PublishedProtocolMetrics,
)
from model.metrics.seams import find_jerk_period, seam_metrics
from model.metrics.tracked_point import tracked_point_metrics
from model.motion.kinematics import RestSkeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import POINT_NAMES, TipTrack, Tracks, kinematic_chain, track_points
from model.motion.transforms import smooth_motion
from model.storage.json_validation import rename_keys

GLOBALDIFF_WINDOWS = Windowing(frames=60, overlap=8)
"""Windows of GlobalDiff's systems: 60 frames, of which two windows share 8."""
TIP = "right_middle"
"""Fingertip of the paper's Figure 6."""
JERK_FRAMES = 4
DIAGNOSTICS_FORMAT = 2
_FORMER_KEYS = {
    "tip": "fingertip",
    "joint": "tracked_point",
    "tip_source": "tracked_point_source",
    "assumed": "assumptions",
    "lacks": "missing_parts",
}
_FORMER_METRIC_KEYS = {
    "folded_on_frames": "fold_period_frames",
    "beat_speeds_of": "beat_speed_source",
    "beat_onsets": "num_speech_onsets",
    "fingertips_path_m_s": "fingertips_speed_m_s",
    "hand_speed_symmetry": "hand_speed_correlation",
    "jerk_by_window_phase_m_s3": "jerk_by_frame_in_period_m_s3",
    "phase_frame": "frame_in_period",
    "tip_path_m_s": "tip_speed_m_s",
    "tip_velocity_power_above_5hz": "tip_velocity_power_share_above_5hz",
    "lag_rate": "lag_corrected_fps",
    "lag_ground": "lag_source",
    "lag_stands_out": "lag_z_score",
    "peak_over_usual": "peak_over_median",
    "peak_over_least": "peak_over_minimum",
    "chance": "p_value",
}
_FORMER_FINDING_KEYS = {
    **_FORMER_METRIC_KEYS,
    "gravity": "severity",
    "excess": "limit_ratio",
    "worst_s": "worst_time_s",
}
"""Keys of format 1 of ``diagnostics.json``, which had no ``format``."""


@dataclass(frozen=True)
class RawAndFiltered:
    """Metrics of one motion, unfiltered and filtered."""

    raw: MotionMetrics
    savgol: MotionMetrics

    def version(self, kind: FilterVersion) -> MotionMetrics:
        return self.raw if kind == "raw" else self.savgol

    def without_protocols_of(self, missing_parts: Collection[str]) -> "RawAndFiltered":
        """Leave out published protocols that need a part which the motion lacks."""
        if self.raw.published is None or not missing_parts:
            return self
        published = PublishedProtocolMetrics(
            measurable_without(self.raw.published.protocols, missing_parts)
        )
        return replace(self, raw=replace(self.raw, published=published))

    def as_json(self) -> dict[str, Any]:
        return {"raw": self.raw.as_json(), "savgol": self.savgol.as_json()}


@dataclass(frozen=True)
class Diagnostics:
    """Metrics and findings of each motion and the reference, unfiltered and filtered."""

    tracked_point: str
    """Fingertip or joint that the ``tip_`` metrics track."""
    tracked_point_source: str
    """Source of its positions: ``rigid``, ``joint`` or a vertex such as ``vertex 7794``."""
    windows: Windowing | None
    """Windows of all motions, if they are known and the same."""
    num_frames: dict[str, int]
    notes: list[str]
    findings: dict[str, list[Finding]]
    reference: RawAndFiltered | None
    systems: dict[str, RawAndFiltered]
    assumptions: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    """Assumptions in reading motions from files, by name (`formats.read`)."""
    missing_parts: dict[str, list[str]] = field(default_factory=dict)
    """Parts that a file does not contain, by name; they have no findings."""

    @property
    def metrics_by_name(self) -> dict[str, RawAndFiltered]:
        """Metrics by name, the reference last."""
        reference = {} if self.reference is None else {REFERENCE_NAME: self.reference}
        return {**self.systems, **reference}

    @property
    def protocol_by_metric(self) -> dict[str, str]:
        """Ids of the protocols of all metrics but the published ones, which are listed by id."""
        if not self.metrics_by_name:
            return {}
        keys = next(iter(self.metrics_by_name.values())).raw.as_json().keys() - {"protocols"}
        return {key: protocol_of(key, self.beat_speed_source) for key in sorted(keys)}

    @property
    def beat_speed_source(self) -> BeatSpeedSource:
        """Source of the mean speeds of BeatAlign."""
        beats = next((each.raw.beats for each in self.metrics_by_name.values()), None)
        return beats.beat_speed_source if beats else "own"

    def as_json(self) -> dict[str, Any]:
        """Return the content of ``diagnostics.json``."""
        return {
            "format": DIAGNOSTICS_FORMAT,
            "fps": FPS,
            "fingertip": self.tracked_point if self.tracked_point in FINGERTIP_NAMES else None,
            "tracked_point": self.tracked_point,
            "tracked_point_source": self.tracked_point_source,
            "window_advance_frames": self.windows and self.windows.advance,
            "window_overlap_frames": self.windows and self.windows.overlap,
            "joint_names": list(JOINT_NAMES),
            "depth_of_joint": list(JOINT_DEPTH),
            "fingertip_names": list(FINGERTIP_NAMES),
            "num_frames": self.num_frames,
            "notes": self.notes,
            "assumptions": self.assumptions,
            "missing_parts": self.missing_parts,
            "findings": {
                name: [finding.as_json() for finding in findings]
                for name, findings in self.findings.items()
            },
            "protocol_of": self.protocol_by_metric,
            "reference": None if self.reference is None else self.reference.as_json(),
            "systems": {name: versions.as_json() for name, versions in self.systems.items()},
        }


def diagnose(
    motions: Mapping[str, Motion],
    skeleton: RestSkeleton,
    reference: Motion | None = None,
    windows: Mapping[str, Windowing] | None = None,
    point: str = TIP,
    tip_track: TipTrack | None = None,
    tracked_point_source: str | None = None,
    onsets_s: Float[np.ndarray, " onsets"] | None = None,
    speech_log_mel: Float[np.ndarray, "frames bands"] | None = None,
    protocol_inputs: ProtocolInputs | None = None,
) -> Diagnostics:
    """Measure motions and the reference, unfiltered and filtered.

    With a reference everything is measured over the same frames: all are cut to the shortest, and
    ``notes`` says so. Without one each motion is measured whole.

    Args:
        motions: by their names in the file.
        windows: windows of motions by name (also of `REFERENCE_NAME`), if known. The seam metrics
            of another motion are folded on its detected period.
        point: the fingertip or joint that the ``tip_`` metrics track.
        tip_track: returns the point's positions in place of the rigid fingertip, for a motion and
            its tracks.
        tracked_point_source: name of what ``tip_track`` tracks, such as 'vertex 7794'; without it
            'rigid' for a fingertip and 'joint' for a joint.
        onsets_s: times of the speech's onsets (`beats.speech_onsets`), for BeatAlign.
        speech_log_mel: log-mel bands of the speech by frame (`lag.speech_bands_by_frame`), for the
            lag of the motion.
        protocol_inputs: mean speeds for BeatAlign (`beats.read_mean_speeds`), and what published
            protocols take besides motion and reference.

    Raises:
        ValueError: if there is no such fingertip or joint.
    """
    if point not in POINT_NAMES:
        raise ValueError(
            f"{point} is neither a fingertip nor a joint; choose one of {', '.join(POINT_NAMES)}."
        )
    protocol_inputs = protocol_inputs or ProtocolInputs()
    ways = _MeasureOptions(
        skeleton, point, tip_track, onsets_s, speech_log_mel, protocol_inputs, True
    )
    windows = windows or {}
    motions, reference, notes = _cut_to_shortest(motions, reference)
    notes += [
        f"{name} has {motion.num_frames} {'frame' if motion.num_frames == 1 else 'frames'}; speed "
        "needs 2, acceleration 3 and jerk 4."
        for name, motion in motions.items()
        if motion.num_frames < JERK_FRAMES
    ]
    recorded: tuple[AnalysedMotion, ...] = ()
    if reference is not None:
        recorded = tuple(_versions(reference, ways, windows.get(REFERENCE_NAME)))
    measured = {
        name: _measured(_versions(motion, ways, windows.get(name), recorded))
        for name, motion in motions.items()
    }
    lag = None
    if recorded:
        lag = measured[REFERENCE_NAME] = _measured(iter(recorded))
    of_all = {windows.get(name) for name in measured}
    return Diagnostics(
        tracked_point=point,
        tracked_point_source=tracked_point_source
        or ("rigid" if point in FINGERTIP_NAMES else "joint"),
        windows=of_all.pop() if len(of_all) == 1 else None,
        num_frames={name: motion.num_frames for name, motion in motions.items()},
        notes=notes,
        findings={name: faults for name, (_, faults) in measured.items()},
        reference=lag and lag[0],
        systems={name: measured[name][0] for name in motions},
    )


def analyse_raw(
    motion: Motion,
    skeleton: RestSkeleton,
    reference: AnalysedMotion | None = None,
    windows: Windowing | None = None,
    point: str = TIP,
    onsets_s: Float[np.ndarray, " onsets"] | None = None,
    speech_log_mel: Float[np.ndarray, "frames bands"] | None = None,
    protocol_inputs: ProtocolInputs | None = None,
) -> AnalysedMotion:
    """Measure one motion without the filter, as the input of fault detectors.

    A reference must be as long. The last three arguments are those of `diagnose`; no published
    protocols are measured.
    """
    protocol_inputs = protocol_inputs or ProtocolInputs()
    ways = _MeasureOptions(skeleton, point, None, onsets_s, speech_log_mel, protocol_inputs, False)
    return next(_versions(motion, ways, windows, () if reference is None else (reference,)))


@dataclass(frozen=True)
class _MeasureOptions:
    """Options of the measurement, the same for all motions; see `diagnose`."""

    skeleton: RestSkeleton
    point: str
    tip_track: TipTrack | None
    onsets_s: Float[np.ndarray, " onsets"] | None
    speech_log_mel: Float[np.ndarray, "frames bands"] | None
    protocol_inputs: ProtocolInputs
    with_published_protocols: bool
    """True to measure published protocols."""


def _versions(
    motion: Motion,
    ways: _MeasureOptions,
    windows: Windowing | None,
    recorded: Sequence[AnalysedMotion] = (),
) -> Iterator[AnalysedMotion]:
    """Yield the unfiltered motion, then the filtered one, each with the reference's same version.

    Periods, lag and mean speeds are those of the unfiltered motion.
    """
    tracks = track_points(motion, ways.skeleton)
    period = find_jerk_period(tracks)
    lag = None if ways.speech_log_mel is None else find_lag(motion, ways.speech_log_mel)
    usual_speed = _usual_speed(
        ways.protocol_inputs.published_mean_speeds, recorded[0].tracks if recorded else None, tracks
    )
    for k in range(len(FILTER_VERSIONS)):
        if k > 0:
            motion = smooth_motion(motion)
            tracks = track_points(motion, ways.skeleton)
        if ways.tip_track is None:
            point = tracks.point(ways.point)
        else:
            point = np.asarray(ways.tip_track(motion, tracks), dtype=np.float64)
        onsets_s = ways.onsets_s
        numbers = MotionMetrics(
            tracked_point_metrics(point, tracks, kinematic_chain(ways.point)),
            fingertip_metrics(tracks),
            position_metrics(tracks),
            rotation_metrics(tracks),
            seam_metrics(tracks, windows, period),
            posture_metrics(tracks),
            joint_limit_metrics(tracks, ways.skeleton),
            diversity(tracks.joints),
            error_to_reference(tracks, recorded[k].tracks) if recorded else None,
            None if onsets_s is None else _measure_beats(tracks, *usual_speed, onsets_s),
            lag,
            _measure_published(motion, tracks, ways.protocol_inputs, recorded)
            if ways.with_published_protocols and k == 0
            else None,
        )
        yield AnalysedMotion(motion, tracks, numbers, ways.point, recorded[k] if recorded else None)
        del tracks, point  # a long clip's are large


def _measure_published(
    motion: Motion,
    tracks: Tracks,
    protocol_inputs: ProtocolInputs,
    recorded: Sequence[AnalysedMotion],
) -> PublishedProtocolMetrics:
    reference = (
        protocol_inputs.make_clip(recorded[0].motion, recorded[0].tracks) if recorded else None
    )
    sums = protocol_sums(protocol_inputs.make_clip(motion, tracks, reference))
    return PublishedProtocolMetrics(protocol_values(sums))


def _measured(versions: Iterator[AnalysedMotion]) -> tuple[RawAndFiltered, list[Finding]]:
    """Return metrics by version, and the faults of the unfiltered motion."""
    analysed = next(versions)
    raw, faults = analysed.metrics, find_faults(analysed)
    del analysed  # before the next one is made
    return RawAndFiltered(raw, next(versions).metrics), faults


def _measure_beats(
    tracks: Tracks,
    usual_speed: Float[np.ndarray, " joints"],
    speeds_of: BeatSpeedSource,
    onsets_s: Float[np.ndarray, " onsets"],
) -> BeatMetrics:
    duration_s = len(tracks.joints) / FPS
    num_onsets = len(onsets_between_margins(onsets_s, duration_s))
    score = mean = highest = rate = math.nan
    if len(tracks.joints) > 1:
        beats = upper_body_beats(_pelvis_centred(tracks), usual_speed)
        rate = sum(map(len, beats)) / len(beats) / duration_s
        if num_onsets:
            score, chance = score_and_shifted_scores(
                beat_align_audio_to_motion, onsets_s, beats, duration_s
            )
            mean, highest = float(chance.mean()), float(chance.max())
    return BeatMetrics(score, mean, highest, rate, num_onsets, speeds_of)


def _usual_speed(
    published: Float[np.ndarray, " joints"] | None, recorded: Tracks | None, own: Tracks
) -> tuple[Float[np.ndarray, " joints"], BeatSpeedSource]:
    """Return mean speeds (m/s) of the joints with beats, published ones first, and their source."""
    if published is not None:
        return published, "emage"
    joints = _pelvis_centred(own if recorded is None else recorded)[:, BEAT_JOINTS]
    speeds = joint_speeds(joints).mean(axis=0) if len(joints) > 1 else np.zeros(len(BEAT_JOINTS))
    return speeds, "own" if recorded is None else "reference"


def _pelvis_centred(tracks: Tracks) -> Float[np.ndarray, "T 55 3"]:
    return tracks.joints - tracks.joints[:, :1]


def _cut_to_shortest(
    motions: Mapping[str, Motion], reference: Motion | None
) -> tuple[dict[str, Motion], Motion | None, list[str]]:
    if reference is None or not motions:
        return dict(motions), reference, []
    named = {**motions, "The reference": reference}
    shortest = min(motion.num_frames for motion in named.values())
    notes = [
        f"{name} has {motion.num_frames} frames; only the first {shortest} were measured, the "
        "length of the shortest motion."
        for name, motion in named.items()
        if motion.num_frames > shortest
    ]
    return (
        {name: first_frames(motion, shortest) for name, motion in motions.items()},
        first_frames(reference, shortest),
        notes,
    )


def with_current_format(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a ``diagnostics.json`` with the keys of this version's format.

    Raises ValueError if a later version wrote it; LookupError, TypeError or AttributeError if it is
    not the content of such a file.
    """
    number = content.get("format", 1)
    if number == DIAGNOSTICS_FORMAT:
        return dict(content)
    if number != 1:
        raise ValueError(
            f"diagnostics.json has format {number}; this version of the program reads up to "
            f"{DIAGNOSTICS_FORMAT}."
        )

    def metrics(versions: Mapping[str, Any]) -> dict[str, Any]:
        return {
            version: {
                key: rename_keys(value, _FORMER_METRIC_KEYS) if isinstance(value, dict) else value
                for key, value in rename_keys(values, _FORMER_METRIC_KEYS).items()
            }
            for version, values in versions.items()
        }

    converted: dict[str, Any] = {"format": DIAGNOSTICS_FORMAT} | rename_keys(content, _FORMER_KEYS)
    for key, convert in (
        ("findings", lambda each: rename_keys(each, _FORMER_FINDING_KEYS)),
        ("assumptions", with_current_keys),
    ):
        of_all = converted.get(key, {}).items()
        converted[key] = {name: [convert(each) for each in rows] for name, rows in of_all}
    converted["protocol_of"] = rename_keys(converted.get("protocol_of", {}), _FORMER_METRIC_KEYS)
    converted["reference"] = converted.get("reference") and metrics(converted["reference"])
    return converted | {"systems": {name: metrics(of) for name, of in converted["systems"].items()}}
