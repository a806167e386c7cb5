"""What is drawn under the bodies: speech with its words, given or looked for while a run goes on,
and motion over time, with the worst seconds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field

from app.run.bodies import TipSource
from app.run.diagnostics import onsets_of
from app.run.output.run_folder import Text, file_of, read_run
from app.run.requests.parts import NUM_WORST_SECONDS, WordSource
from conventions.names import REFERENCE_NAME, Version
from conventions.rates import FPS, SAMPLE_RATE
from model.measures.smoothness import derivative_magnitudes
from model.motion.altered import smooth_motion
from model.motion.motion import Motion
from model.networks.speech_codes import heard_accents
from model.plan.tier_files import Interval
from model.speech.audio import Speech
from model.speech.recognised import Hearing
from model.speech.transcript import (
    NOTHING_SAID,
    Accent,
    GivenWords,
    Origin,
    Transcript,
    Word,
    read_words,
)
from model.storage.checked import read_checked


def worst_seconds(
    tracks: Mapping[str, np.ndarray], count: int = NUM_WORST_SECONDS
) -> list[dict[str, Any]]:
    """At most ``count`` seconds without overlap, the worst of all motions first.

    Args:
        tracks: by the name of a motion its point (T, 3), metres, 30 frames per second.

    Returns:
        For each ``start_s`` and ``end_s``, the ``name`` of the motion that jerks most then, and its
        mean ``jerk_m_s3``; a shorter clip is one stretch, and one under 4 frames is none.
    """
    means = {name: _means(derivative_magnitudes(track, 3), FPS) for name, track in tracks.items()}
    lengths = {name: min(FPS, len(track)) for name, track in tracks.items()}
    found: list[dict[str, Any]] = []
    while len(found) < count:
        left = {name: mean for name, mean in means.items() if np.isfinite(mean).any()}
        if not left:
            break
        name = max(left, key=lambda each: np.nanmax(left[each]))
        start = int(np.nanargmax(means[name]))
        found.append(
            {
                "start_s": round(start / FPS, 4),
                "end_s": round((start + lengths[name]) / FPS, 4),
                "name": name,
                "jerk_m_s3": round(float(means[name][start]), 1),
            }
        )
        for mean in means.values():
            mean[max(0, start - FPS + 1) : start + FPS] = np.nan
    return found


def _means(jerk: np.ndarray, num_frames: int) -> np.ndarray:
    """Mean jerk of the stretch that begins at each frame, over what lies whole within it."""
    entries = min(num_frames - 3, len(jerk))
    if entries < 1:
        return np.empty(0)
    total = np.concatenate([[0.0], np.cumsum(jerk)])
    return (total[entries:] - total[:-entries]) / entries


MAX_POINTS = 1800
"""Of one curve: every frame of a minute; longer clips keep the highest of neighbouring frames."""
NUM_PEAKS = 1200
"""Bars of the waveform."""
CURVES: dict[str, tuple[int, int]] = {"jerk_m_s3": (3, 1), "speed_m_s": (1, 3)}
"""By name of a curve the order of the derivative and the decimals kept."""

Curve = dict[str, Any]


def make_timeline(
    speech: Speech | None,
    motions: Mapping[str, Motion],
    shown: Version,
    tip: TipSource,
    weights: Path | None = None,
) -> dict[str, Any]:
    """Everything that the time line shows.

    Args:
        speech: what is heard; None for motion without sound.
        motions: as shown in the videos; the recorded one, as `REFERENCE_NAME`, as it is.
        shown: what the others are: as generated, or filtered already.
        tip: the point whose curves are drawn, the same that Figure 6 and the numbers follow.
        weights: where the speech encoder is whose accents are told; None tells none.

    Returns:
        ``duration_s``, ``fps``, ``peaks`` (0 to 100), ``onsets_s``, ``point`` (its name for a
        person), and by the name of a motion ``curves``: for ``raw`` and ``savgol`` each of
        `CURVES`; of filtered motion nothing raw is known. ``worst`` is as `worst_seconds` has it,
        of those that were not recorded.
    """
    tracks = {name: tip.track(each) for name, each in motions.items() if name != REFERENCE_NAME}
    accents = heard_accents(speech, weights) if speech and weights else ()
    curves = {}
    for name, motion in motions.items():
        version: Version = "raw" if name == REFERENCE_NAME else shown
        versions: dict[Version, Motion] = {version: motion}
        if version == "raw":
            versions["savgol"] = smooth_motion(motion)
        curves[name] = {kind: point_curves(tip.track(each)) for kind, each in versions.items()}
    return {
        "duration_s": round(max(longest_s(motions), speech.duration_s if speech else 0.0), 4),
        "fps": FPS,
        "peaks": [] if speech is None else waveform_peaks(waveform_of(speech, motions)),
        "onsets_s": [] if speech is None else np.round(onsets_of(speech), 3).tolist(),
        "heard_accents": [(accent.time_s, accent.strength) for accent in accents],
        "point": tip.title,
        "curves": curves,
        "worst": worst_seconds(tracks),
    }


def tiers_of(said: Transcript) -> dict[str, Any]:
    """``words``, where they come from as ``words_origin``, their ``phones``, and, by the name of a
    tier, ``gestures``: of each (start_s, end_s, text). Of ``accents`` time and strength."""
    return {
        "words": [_times(word) for word in said.words],
        "words_origin": said.origin,
        "phones": [_times(phone) for phone in said.phones],
        "accents": [(accent.time_s, accent.strength) for accent in said.accents],
        "gestures": {name: [_times(each) for each in of] for name, of in said.gestures.items()},
    }


def _times(interval: Interval) -> tuple[float, float, str]:
    return interval.start_s, interval.end_s, interval.text


_MAX_LINE_BYTES, _LOOK_EVERY_S = 20_000_000, 0.1
Seconds = Annotated[float, Field(ge=0, le=1e5)]
Parts = Annotated[list[tuple[Seconds, Seconds, Text]], Field(max_length=50_000)]


class _Line(BaseModel):
    """What was said, of a time line."""

    words_origin: Origin = "given"
    words: Parts = []
    phones: Parts = []
    accents: Annotated[list[tuple[Seconds, Seconds]], Field(max_length=50_000)] = []
    gestures: Annotated[dict[Text, Parts], Field(max_length=20)] = {}

    @property
    def said(self) -> Transcript:
        return Transcript(
            tuple(Word(*part) for part in self.words),
            {name: tuple(Interval(*each) for each in of) for name, of in self.gestures.items()},
            self.words_origin,
            tuple(Interval(*part) for part in self.phones),
            tuple(Accent(*accent) for accent in self.accents),
        )


def said_in(folder: Path) -> Transcript:
    """What `tiers_of` left in the time line of a run's folder; nothing where that is damaged."""
    path = file_of(folder, read_run(folder).timeline)
    try:
        return NOTHING_SAID if path is None else read_checked(path, _Line, _MAX_LINE_BYTES).said
    except ValueError:
        return NOTHING_SAID


class SpokenWords:
    """Of one run: a TextGrid wins, then a plain text, then what is recognised, if that is asked
    for. Use it as a context: leaving it ends the looking for words."""

    def __init__(self, given: Path | Transcript | None, asked: WordSource) -> None:
        """
        Raises:
            TranscriptError: if the transcript cannot be used.
        """
        self._given: GivenWords | None = None
        if given is not None:
            is_file = isinstance(given, Path)
            self._given = read_words(given) if is_file else GivenWords(given)
        self._asked: WordSource = asked
        self._hearing: Hearing | None = None

    def __enter__(self) -> SpokenWords:
        return self

    def __exit__(self, *_: Any) -> None:
        if self._hearing is not None:
            self._hearing.__exit__()

    @property
    def given(self) -> Transcript:
        """What a transcript tells at once: nothing of a plain text, whose words are still to be
        found."""
        return NOTHING_SAID if self._given is None else self._given.transcript

    @property
    def need_speech(self) -> bool:
        """Whether words are to be looked for in the speech."""
        if self._given is None:
            return self._asked == "recognise"
        return self._given.text is not None

    def begin(self, waveform: np.ndarray) -> None:
        """Look for them in this speech, if they are to be looked for and are not yet, and return at
        once."""
        if self._given is not None:
            self._given = self._given.within(len(waveform) / SAMPLE_RATE)
        if self.need_speech and self._hearing is None:
            self._hearing = Hearing(waveform, self._given and self._given.text)

    def found(self, on_wait: Callable[[], None]) -> tuple[Transcript, tuple[str, ...]]:
        """What was said, with what a person should know of it.

        Args:
            on_wait: called again and again while they are still looked for; what it raises ends
                that.
        """
        notes = () if self._given is None else self._given.notes
        if self._hearing is None:
            return self.given, notes
        while not self._hearing.is_over(_LOOK_EVERY_S):
            on_wait()
        heard = self._hearing.heard()
        return heard.transcript, (*notes, *heard.notes)


def waveform_peaks(waveform: np.ndarray, num_peaks: int = NUM_PEAKS) -> list[int]:
    """The largest magnitude in each of at most ``num_peaks`` equal stretches, 0 to 100.

    100 is the loudest sample of the clip; silence is all zeros.
    """
    count = min(num_peaks, len(waveform))
    if count == 0:
        return []
    starts = np.arange(count) * len(waveform) // count
    peaks = np.maximum.reduceat(np.abs(waveform.astype(np.float64)), starts)
    loudest = peaks.max()
    return np.rint(100 * peaks / (loudest if loudest > 0 else 1.0)).astype(int).tolist()


def point_curves(track: np.ndarray) -> dict[str, Curve]:
    """Jerk and speed over time of a point (T, 3), metres."""
    return {
        name: derivative_curve(track, order, decimals) for name, (order, decimals) in CURVES.items()
    }


def derivative_curve(
    track: np.ndarray, order: int, decimals: int, max_points: int = MAX_POINTS
) -> Curve:
    """Magnitude of a point's derivative, each value at the middle of the frames it comes from.

    Args:
        track: (T, 3) metres, 30 per second.

    Returns:
        ``start_s`` and ``step_s`` of the ``values``; empty for clips too short to have one. A
        longer curve than ``max_points`` keeps the highest value of each stretch, so that no peak is
        lost.
    """
    values = derivative_magnitudes(track, order)
    stride = max(1, -(-len(values) // max_points))
    if len(values):
        values = np.maximum.reduceat(values, np.arange(0, len(values), stride))
    # Entry i comes from frames i to i + order; a frame is seen from its time to the next one's.
    middle = (order + 1) / 2 + (stride - 1) / 2
    return {
        "start_s": round(middle / FPS, 5),
        "step_s": round(stride / FPS, 5),
        "values": np.round(values, decimals).tolist(),
    }


def longest_s(motions: Mapping[str, Motion]) -> float:
    """As long as all that is shown."""
    return max(motion.duration_s for motion in motions.values())


def waveform_of(speech: Speech | None, motions: Mapping[str, Motion]) -> np.ndarray:
    """Speech, with silence as far as the longest motion goes; silence alone where there is none."""
    waveform = np.zeros(0, np.float32) if speech is None else speech.waveform
    missing = round(longest_s(motions) * SAMPLE_RATE) - len(waveform)
    return np.pad(waveform, (0, max(0, missing)))
