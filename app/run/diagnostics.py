"""Metrics and figures of the motions of a run, generated or imported."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float

from app.errors import RunError
from app.run.bodies import PointTracker
from app.run.output.result_folder import ResultFolder
from app.run.requests.parts import FigureOptions
from app.run.videos.videos import Snapshots
from conventions.joints import FACE, HANDS, JOINT_INDEX, LOWER_BODY, UPPER_BODY
from conventions.names import (
    FILTER_VERSIONS,
    REFERENCE_NAME,
    FilterVersion,
    PostFilter,
    short_names,
)
from model.diagnostics import Diagnostics, RawAndFiltered, diagnose
from model.generation.base import Windowing
from model.metrics.beats import speech_onsets
from model.metrics.protocols.clip import ProtocolInputs
from model.metrics.results import MotionMetrics
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import Tracks
from model.speech.audio import Speech
from model.speech.transcript import EMPTY_TRANSCRIPT, Transcript
from model.storage.escaping import csv_text
from renderer.figures.figure6.contents import ONE_SEED_CAVEAT, WINDOW_FRAMES, Figure6
from renderer.figures.figure6.layout import column_figure_fits_page
from renderer.figures.jitter import Jitter, JitterSheet

_ABOVE_HIPS = (*UPPER_BODY, *HANDS, *FACE)
"""Joints of snapshots in figures, cropped so that hands are large; whole if a leg is tracked."""
CSV_HEADER = ("name", "post_filter", "measure", "index", "value", "protocol")
_ONSETS: WeakKeyDictionary[Speech, np.ndarray] = WeakKeyDictionary()


def measure_motions(
    motions: Mapping[str, Motion],
    tracker: PointTracker,
    onsets_s: Float[np.ndarray, " onsets"] | None = None,
    on_share: Callable[[float], None] = lambda share: None,
    windows: Mapping[str, Windowing] | None = None,
    speech_log_mel: Float[np.ndarray, "T bands"] | None = None,
    protocol_inputs: ProtocolInputs | None = None,
) -> Diagnostics:
    """Compute all metrics and findings of the motions.

    Args:
        motions: motions by name; a recorded one has the name `REFERENCE_NAME`.
        onsets_s: onset times of the speech, for BeatAlign.
        on_share: called with the fraction done, 0 to 1, for each motion raw and filtered, more than
            once for a long one; an exception from it stops the work.
        speech_log_mel: log-mel bands of the speech per motion frame, for the lag of motions.
        protocol_inputs: published mean speeds for BeatAlign, and inputs of published protocols.
    """
    done, count = 0, 2 * len(motions)

    def follow(version: Motion, tracks: Tracks) -> np.ndarray:
        """Return the tracked point of a motion about to be measured, and report progress."""
        nonlocal done
        share = done / count
        done += 1
        return tracker.track(version, on_piece=lambda: on_share(share), tracks=tracks)

    return diagnose(
        {name: motion for name, motion in motions.items() if name != REFERENCE_NAME},
        open_body_skeleton(),
        reference=motions.get(REFERENCE_NAME),
        windows=windows,
        speech_log_mel=speech_log_mel,
        protocol_inputs=protocol_inputs,
        tip_track=follow,
        tracked_point_source=tracker.position_kind,
        point=tracker.name,
        onsets_s=onsets_s,
    )


def cached_speech_onsets(speech: Speech) -> np.ndarray:
    """Return the onset times of a speech in seconds; they are computed once."""
    if speech not in _ONSETS:
        _ONSETS[speech] = speech_onsets(speech.waveform)
    return _ONSETS[speech]


def write_diagnostics(
    diagnostics: Diagnostics, folder: ResultFolder, transcript: Transcript = EMPTY_TRANSCRIPT
) -> tuple[Path, Path]:
    """Write diagnostics.json, with words and phones, and diagnostics.csv, one row per number."""
    content = diagnostics.as_json()
    if transcript.words:
        content["words_origin"] = transcript.origin
        content["words"] = [asdict(word) for word in transcript.words]
    if transcript.phones:
        content["phones"] = [asdict(phone) for phone in transcript.phones]
    json_path, csv_path = folder.new_path("diagnostics.json"), folder.new_path("diagnostics.csv")
    json_path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n")
    csv_path.write_text(csv_text([CSV_HEADER, *_rows(diagnostics)]), "utf-8", newline="")
    return json_path, csv_path


def _rows(diagnostics: Diagnostics) -> Iterator[tuple[str, str, str, str, float, str]]:
    protocol_by_metric = diagnostics.protocol_by_metric
    for name, versions in diagnostics.metrics_by_name.items():
        for post_filter, values in versions.as_json().items():
            published = values.pop("protocols", {})
            for measure, value in values.items():
                for index, number in _numbers(value):
                    yield name, post_filter, measure, index, number, protocol_by_metric[measure]
            for protocol, by_name in published.items():
                for measure, number in by_name.items():
                    yield name, post_filter, measure, "", number, protocol


def _numbers(value: Any, index: str = "") -> Iterator[tuple[str, float]]:
    """Yield all numbers in nested lists and mappings, with their paths as ``a/b``."""
    if isinstance(value, Mapping):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        return
    else:
        yield index, value
        return
    for key, inner in items:
        yield from _numbers(inner, f"{index}/{key}" if index else str(key))


def check_figure6(
    figures: FigureOptions, num_frames: int, num_motions: int, is_drawn: bool = True
) -> None:
    """Check that Figure 6 fits the motions and, if drawn, the page; raises RunError."""
    last = num_frames - 1
    frames, panels = figures.figure_frames, figures.figure_panels
    if (
        is_drawn
        and figures.figure_width == "85mm"
        and not column_figure_fits_page(num_motions, panels)
    ):
        raise RunError(
            f"Figure 6 of {num_motions} motions with the panels {','.join(panels)} is taller than "
            "a page if it is 85mm wide; choose 174mm or fewer panels."
        )
    if not 0 <= figures.start_frame <= last:
        raise RunError(
            f"The start frame of Figure 6 must be from 0 to {last}; got {figures.start_frame}."
        )
    if frames and frames[-1] > last:
        raise RunError(f"Snapshot frames of Figure 6 must be from 0 to {last}; got {frames[-1]}.")


def make_figure6(
    motions: Mapping[str, Motion],
    snapshots: Snapshots,
    tracker: PointTracker,
    figures: FigureOptions,
    speech_name: str,
    on_piece: Callable[[], None],
    post_filter: PostFilter | None = None,
) -> Figure6:
    """Make the content of Figure 6: trajectories of the tracked point, and poses if there are any.

    The motions are as they are shown; a recorded one has the name `REFERENCE_NAME`. ``on_piece`` is
    called at least once for each; an exception from it stops the work. The filter is that of
    generated motions; None for imported ones.
    """
    end, labels, marks = figures.start_frame + WINDOW_FRAMES, short_names(motions), snapshots.marks
    if marks is not None:
        pixels, joint_jerk = _labelled(marks.pixels, labels), _labelled(marks.joint_jerk, labels)
        crop_joints = None if JOINT_INDEX.get(tracker.name) in LOWER_BODY else _ABOVE_HIPS
        marks = replace(marks, pixels=pixels, joint_jerk=joint_jerk, crop_joints=crop_joints)
    return Figure6(
        {labels[name]: tracker.track(motion, end, on_piece) for name, motion in motions.items()},
        _labelled(snapshots.pictures, labels),
        snapshots.frames,
        marks=marks,
        reference=REFERENCE_NAME if REFERENCE_NAME in motions else None,
        start_frame=figures.start_frame,
        tracked_point=tracker.title,
        tracked_point_source=tracker.position_kind,
        post_filter=post_filter or "none",
        clip=speech_name,
        caveat="" if post_filter is None else ONE_SEED_CAVEAT,
        requested_panels=figures.figure_panels,
        width_mm=float(figures.figure_width.removesuffix("mm")),
    )


def _labelled(by_name: Mapping[str, Any], labels: Mapping[str, str]) -> dict[str, Any]:
    return {labels[name]: each for name, each in by_name.items()}


def make_jitter_sheet(
    diagnostics: Diagnostics, tracker: PointTracker, names: Sequence[str]
) -> JitterSheet:
    """Make the content of the jitter sheet of some systems."""
    of_all = diagnostics.metrics_by_name
    shown = {name: of_all[name] for name in (REFERENCE_NAME, *names) if name in of_all}
    windows = diagnostics.windows
    return JitterSheet(
        {label: _jitter_of(shown[name]) for name, label in short_names(shown).items()},
        tracked_point=tracker.title.lower(),
        window_advance=windows.advance if windows else 0,
        window_overlap=windows.overlap if windows else 0,
    )


def _jitter_of(versions: RawAndFiltered) -> dict[FilterVersion, Jitter]:
    def of(measures: MotionMetrics) -> Jitter:
        spectrum, period = measures.point.tip_spectrum, measures.seams.period
        return Jitter(
            jerk_by_depth=measures.positions.jerk_by_depth_m_s3,
            jerk_by_joint=measures.positions.joint_jerk_m_s3,
            spectrum=spectrum and (spectrum.frequency_hz, spectrum.velocity_power),
            chain=measures.point.tip_jerk_attribution.joints,
            jerk_drop_by_joint=measures.point.tip_jerk_attribution.share,
            jerk_by_frame_in_period=measures.seams.jerk_by_frame_in_period_m_s3,
            period_and_part=period and (period.frames, period.part),
        )

    return {kind: of(versions.version(kind)) for kind in FILTER_VERSIONS}
