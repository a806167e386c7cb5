"""Timeline of a run: speech with its words, curves of the motion, and its worst seconds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float, Float32
from pydantic import BaseModel, Field

from app.run.bodies import PointTracker
from app.run.diagnostics import cached_speech_onsets
from app.run.output.run_folder import Text, existing_file, read_run
from app.run.output.viewer_files import MAX_POINTS, NUM_PEAKS, Curve
from app.run.requests.parts import NUM_WORST_SECONDS, WordSource
from conventions.names import REFERENCE_NAME, FilterVersion
from conventions.rates import FPS, SAMPLE_RATE
from model.faults.analysis import Finding
from model.faults.table import SNAP
from model.metrics.smoothness import derivative_magnitudes
from model.motion.motion import Motion
from model.motion.tracks import point_label
from model.motion.transforms import smooth_motion
from model.networks.speech_codes import detect_pitch_accents
from model.plan.annotation_files import Interval
from model.speech.audio import Speech
from model.speech.transcript import (
    EMPTY_TRANSCRIPT,
    Accent,
    Transcript,
    TranscriptSource,
    Word,
    WordsFile,
    read_words_file,
)
from model.speech.word_recognition import WordRecognition
from model.storage.json_validation import read_json


def worst_seconds(
    tracks: Mapping[str, Float[np.ndarray, "T 3"]], count: int = NUM_WORST_SECONDS
) -> list[dict[str, Any]]:
    """Return at most ``count`` seconds with the highest jerk, without overlap, the worst first.

    Each has ``start_s`` and ``end_s``, the ``name`` of the motion with the highest jerk in it, and
    its mean ``jerk_m_s3``. A shorter clip counts whole, and one under 4 frames not at all.
    """
    means = {name: _means(derivative_magnitudes(track, 3), FPS) for name, track in tracks.items()}
    lengths = {name: min(FPS, len(track)) for name, track in tracks.items()}
    worst: list[dict[str, Any]] = []
    while len(worst) < count:
        left = {name: mean for name, mean in means.items() if np.isfinite(mean).any()}
        if not left:
            break
        name = max(left, key=lambda each: np.nanmax(left[each]))
        start = int(np.nanargmax(means[name]))
        worst.append(
            {
                "start_s": round(start / FPS, 4),
                "end_s": round((start + lengths[name]) / FPS, 4),
                "name": name,
                "jerk_m_s3": round(float(means[name][start]), 1),
            }
        )
        for mean in means.values():
            mean[max(0, start - FPS + 1) : start + FPS] = np.nan
    return worst


def with_joint_snaps(
    timeline: Mapping[str, Any],
    findings: Mapping[str, Sequence[Finding]],
    count: int = NUM_WORST_SECONDS,
) -> dict[str, Any]:
    """Return the timeline with joints that snap among its worst seconds.

    The jerk of the tracked point misses snaps of other joints. A snap that is the most severe
    finding of its motion comes before all seconds of jerk; the worst other snap comes last.

    Args:
        timeline: as returned by `make_timeline`.
        findings: by name of a motion, the most severe first.

    Returns:
        The timeline; snaps have ``joint``, ``snap_deg`` and ``is_gravest``, and no ``jerk_m_s3``.
    """
    snaps = [
        (each.deviation, _second_of(name, each, of_motion[0], timeline["duration_s"]))
        for name, of_motion in findings.items()
        for each in of_motion
        if each.kind == SNAP and name != REFERENCE_NAME and name in timeline["curves"]
    ]
    seconds = [second for _, second in sorted(snaps, key=lambda snap: -snap[0])]
    first = [second for second in seconds if second["is_gravest"]]
    last = [second for second in seconds if not second["is_gravest"]][:1]
    worst = _without_overlap([*first, *timeline["worst"]])[:count]
    if len(_without_overlap([*worst, *last])) > len(worst):
        worst = [*worst[: count - 1], *last]
    return {**timeline, "worst": worst}


def _second_of(name: str, snap: Finding, gravest: Finding, duration_s: float) -> dict[str, Any]:
    """Return the second around the worst frame of a finding."""
    start_s = max(0.0, min((snap.worst_time_s or 0.0) - 0.5, duration_s - 1.0))
    return {
        "start_s": round(start_s, 4),
        "end_s": round(min(start_s + 1.0, duration_s), 4),
        "name": name,
        "joint": point_label(snap.numbers["joint"]),
        "snap_deg": round(snap.numbers["snap_deg"], 1),
        "is_gravest": snap is gravest,
    }


def _without_overlap(seconds: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the seconds that overlap none before them."""
    chosen: list[dict[str, Any]] = []
    for each in seconds:
        if all(each["start_s"] >= k["end_s"] or each["end_s"] <= k["start_s"] for k in chosen):
            chosen.append(dict(each))
    return chosen


def _means(jerk: Float[np.ndarray, " N"], num_frames: int) -> np.ndarray:
    """Compute the mean jerk of the stretch from each frame, over entries entirely inside it."""
    entries = min(num_frames - 3, len(jerk))
    if entries < 1:
        return np.empty(0)
    total = np.concatenate([[0.0], np.cumsum(jerk)])
    return (total[entries:] - total[:-entries]) / entries


CURVE_DERIVATIVES: dict[str, tuple[int, int]] = {"jerk_m_s3": (3, 1), "speed_m_s": (1, 3)}
"""Order of the derivative and number of decimals, by name of the curve."""


def make_timeline(
    speech: Speech | None,
    motions: Mapping[str, Motion],
    filter_version: FilterVersion,
    tracker: PointTracker,
    accent_weights: Path | None = None,
) -> dict[str, Any]:
    """Make the timeline of a run as JSON.

    Args:
        motions: motions as shown in the videos; a recorded one, `REFERENCE_NAME`, is unfiltered.
        filter_version: version of the other motions: as generated, or filtered.
        tracker: tracker of the point of the curves, the same as in Figure 6 and the metrics.
        accent_weights: folder of the accent network; None omits accents.

    Returns:
        ``duration_s``, ``fps``, ``peaks`` (0 to 100), ``onsets_s``, ``point`` (its title), and
            ``curves`` by motion: each of `CURVE_DERIVATIVES` for ``savgol`` and, unless filtered,
            ``raw``. ``worst`` are the `worst_seconds` of all motions but the reference.
    """
    tracks = {name: tracker.track(each) for name, each in motions.items() if name != REFERENCE_NAME}
    accents = detect_pitch_accents(speech, accent_weights) if speech and accent_weights else ()
    curves = {
        name: motion_curves(motion, "raw" if name == REFERENCE_NAME else filter_version, tracker)
        for name, motion in motions.items()
    }
    return {
        "duration_s": round(max(max_duration_s(motions), speech.duration_s if speech else 0.0), 4),
        "fps": FPS,
        "peaks": [] if speech is None else waveform_peaks(padded_waveform(speech, motions)),
        "onsets_s": [] if speech is None else np.round(cached_speech_onsets(speech), 3).tolist(),
        "heard_accents": [(accent.time_s, accent.strength) for accent in accents],
        "point": tracker.title,
        "curves": curves,
        "worst": worst_seconds(tracks),
    }


def motion_curves(
    motion: Motion, version: FilterVersion, tracker: PointTracker
) -> dict[FilterVersion, dict[str, Curve]]:
    """Return the curves of one motion for ``raw`` and ``savgol``, see `make_timeline`."""
    versions: dict[FilterVersion, Motion] = {version: motion}
    if version == "raw":
        versions["savgol"] = smooth_motion(motion)
    return {kind: point_curves(tracker.track(each)) for kind, each in versions.items()}


def transcript_tiers(transcript: Transcript) -> dict[str, Any]:
    """Return the tiers of a transcript as JSON.

    ``words``, their source ``words_origin``, and ``phones``; ``gestures`` by name of the tier, with
    (start_s, end_s, text) of each interval; ``accents`` with time and strength.
    """
    return {
        "words": [_times(word) for word in transcript.words],
        "words_origin": transcript.origin,
        "phones": [_times(phone) for phone in transcript.phones],
        "accents": [(accent.time_s, accent.strength) for accent in transcript.accents],
        "gestures": {
            name: [_times(each) for each in of] for name, of in transcript.gestures.items()
        },
    }


def _times(interval: Interval) -> tuple[float, float, str]:
    return interval.start_s, interval.end_s, interval.text


_MAX_TIMELINE_BYTES, _LOOK_EVERY_S = 20_000_000, 0.1
Seconds = Annotated[float, Field(ge=0, le=1e5)]
Strength = Annotated[float, Field(ge=0, le=1e5)]
Parts = Annotated[list[tuple[Seconds, Seconds, Text]], Field(max_length=50_000)]


class _StoredTranscript(BaseModel):
    """Transcript part of a stored timeline."""

    words_origin: TranscriptSource = "given"
    words: Parts = []
    phones: Parts = []
    accents: Annotated[list[tuple[Seconds, Strength]], Field(max_length=50_000)] = []
    gestures: Annotated[dict[Text, Parts], Field(max_length=20)] = {}

    @property
    def transcript(self) -> Transcript:
        return Transcript(
            tuple(Word(*part) for part in self.words),
            {name: tuple(Interval(*each) for each in of) for name, of in self.gestures.items()},
            self.words_origin,
            tuple(Interval(*part) for part in self.phones),
            tuple(Accent(*accent) for accent in self.accents),
        )


def read_transcript_of_run(folder: Path) -> Transcript:
    """Return the transcript in a run's timeline; empty if it is damaged."""
    path = existing_file(folder, read_run(folder).timeline)
    try:
        return (
            EMPTY_TRANSCRIPT
            if path is None
            else read_json(path, _StoredTranscript, _MAX_TIMELINE_BYTES).transcript
        )
    except ValueError:
        return EMPTY_TRANSCRIPT


class TranscriptLoader:
    """Words of a run's speech, from a TextGrid, else aligned text, else recognised on request.

    As a context manager, it stops the recognition at the end of the block.
    """

    def __init__(self, transcript: Path | Transcript | None, source: WordSource) -> None:
        """Read the transcript, if there is one; raises TranscriptError if it cannot be used."""
        self._words_file: WordsFile | None = None
        if transcript is not None:
            is_file = isinstance(transcript, Path)
            self._words_file = read_words_file(transcript) if is_file else WordsFile(transcript)
        self._source: WordSource = source
        self._recognition: WordRecognition | None = None

    def __enter__(self) -> TranscriptLoader:
        return self

    def __exit__(self, *_: Any) -> None:
        if self._recognition is not None:
            self._recognition.__exit__()

    @property
    def provided(self) -> Transcript:
        """Words that are known at once; empty for a plain text, which has yet to be aligned."""
        return EMPTY_TRANSCRIPT if self._words_file is None else self._words_file.transcript

    @property
    def needs_speech(self) -> bool:
        """True if words are to be recognised in, or aligned with, the speech."""
        if self._words_file is None:
            return self._source == "recognise"
        return self._words_file.text is not None

    def begin(self, waveform: Float32[np.ndarray, " N"]) -> None:
        """Start to recognise or align words in the background, if needed and not yet started."""
        if self._words_file is not None:
            self._words_file = self._words_file.within(len(waveform) / SAMPLE_RATE)
        if self.needs_speech and self._recognition is None:
            self._recognition = WordRecognition(
                waveform, self._words_file and self._words_file.text
            )

    def wait(self, on_wait: Callable[[], None]) -> tuple[Transcript, tuple[str, ...]]:
        """Wait for the words, and return them with notes for the user.

        ``on_wait`` is called repeatedly meanwhile; an exception from it stops the wait.
        """
        notes = () if self._words_file is None else self._words_file.notes
        if self._recognition is None:
            return self.provided, notes
        while not self._recognition.is_over(_LOOK_EVERY_S):
            on_wait()
        transcript = self._recognition.result()
        return transcript.transcript, (*notes, *transcript.notes)


def waveform_peaks(waveform: Float[np.ndarray, " N"], num_peaks: int = NUM_PEAKS) -> list[int]:
    """Return the largest magnitude in each of at most ``num_peaks`` equal stretches, 0 to 100.

    100 is the loudest sample of the clip; silence is all zeros.
    """
    count = min(num_peaks, len(waveform))
    if count == 0:
        return []
    starts = np.arange(count) * len(waveform) // count
    peaks = np.maximum.reduceat(np.abs(waveform.astype(np.float64)), starts)
    loudest = peaks.max()
    return np.rint(100 * peaks / (loudest if loudest > 0 else 1.0)).astype(int).tolist()


def point_curves(track: Float[np.ndarray, "T 3"]) -> dict[str, Curve]:
    """Compute the jerk and speed curves of a point (T, 3) in metres."""
    return {
        name: derivative_curve(track, order, decimals)
        for name, (order, decimals) in CURVE_DERIVATIVES.items()
    }


def derivative_curve(
    track: Float[np.ndarray, "T 3"], order: int, decimals: int, max_points: int = MAX_POINTS
) -> Curve:
    """Compute the magnitude of a derivative over time of a point's positions (m) at 30 frames/s.

    Returns ``start_s`` and ``step_s`` of the ``values``, each at the middle of the frames it comes
    from; empty for clips that are too short. A curve longer than ``max_points`` keeps the maximum
    of each stretch, so that no peak is lost.
    """
    values = derivative_magnitudes(track, order)
    stride = max(1, -(-len(values) // max_points))
    if len(values):
        values = np.maximum.reduceat(values, np.arange(0, len(values), stride))
    # Entry i comes from frames i to i + order; a frame is shown until the next one.
    middle = (order + 1) / 2 + (stride - 1) / 2
    return {
        "start_s": round(middle / FPS, 5),
        "step_s": round(stride / FPS, 5),
        "values": np.round(values, decimals).tolist(),
    }


def max_duration_s(motions: Mapping[str, Motion]) -> float:
    """Return the duration of the longest motion (s)."""
    return max(motion.duration_s for motion in motions.values())


def padded_waveform(speech: Speech | None, motions: Mapping[str, Motion]) -> np.ndarray:
    """Return the speech, or silence without one, padded with zeros to the longest motion."""
    waveform = np.zeros(0, np.float32) if speech is None else speech.waveform
    missing = round(max_duration_s(motions) * SAMPLE_RATE) - len(waveform)
    return np.pad(waveform, (0, max(0, missing)))
