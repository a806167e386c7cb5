"""Rows of a run that come from imported motion files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from app.errors import RunError
from app.run import bodies
from app.run.diagnostics import cached_speech_onsets, check_figure6
from app.run.models import get_body
from app.run.output.provenance import motion_labels
from app.run.output.run_folder import SPEECH as HEARD
from app.run.output.run_folder import row_files, suffix_or_empty
from app.run.requests.parts import MAX_COMPARED
from app.run.requests.requests import DiagnoseRequest
from app.run.run_writer import RunMotions, RunWriter
from app.run.timeline import TranscriptLoader
from conventions.joints import JOINT_INDEX
from conventions.names import REFERENCE_NAME, printable
from model.diagnostics import Diagnostics
from model.faults.analysis import Finding
from model.faults.table import drop_findings_on_missing_parts
from model.formats.read import read_any_motion
from model.formats.reading import (
    MOTIONS,
    Assumption,
    ImportedMotion,
    assumption_difference_notes,
    length_notes,
)
from model.generation.base import Windowing
from model.metrics.beats import read_mean_speeds
from model.metrics.lag import speech_bands_by_frame
from model.metrics.posture import FEET
from model.metrics.protocols.clip import FaceVertices, ProtocolInputs
from model.metrics.protocols.semantics import read_semantics
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import track_points
from model.speech.audio import Speech, SpeechReadOptions, load_speech
from renderer.body.body import Body

NO_SPEECH = (
    "Recognising words, or aligning a transcript without word times, needs the speech; add it "
    "(--speech), or give a TextGrid with word times."
)


def import_motions(
    request: DiagnoseRequest, transcript_loader: TranscriptLoader, run: RunWriter
) -> RunMotions:
    """Read the imported motions, show them in the viewer, and return the rows of the run.

    Raises RunError, SpeechError, MotionError, BodyError, WriteError, each with one sentence.
    """
    if request.metrics.mean_speeds is not None and request.speech.path is None:
        raise RunError(
            "Mean joint speeds are used only for BeatAlign, which needs speech; also give --speech."
        )
    body = get_body(request.video.body)
    tracker = bodies.make_point_tracker(request.video.body, request.tracked_point)
    files = _files_of(request)
    readings = _read_motions(request, files, run)
    motions = {name: each.motion for name, each in readings.items()}
    windows = _windows(request, motions)
    shown = _visible_motions(request, motions)
    shortest = min(motion.num_frames for motion in motions.values())
    check_figure6(request.figures, shortest, len(shown), request.output.has_figures)
    options = SpeechReadOptions(channel=request.speech.channel)
    speech = None if request.speech.path is None else load_speech(request.speech.path, options)
    notes = assumption_difference_notes(readings) + [
        note for each in readings.values() for note in each.notes
    ]
    is_first_track = speech is None or (request.speech.channel is None and speech.track == 0)
    if speech is not None:
        transcript_loader.begin(speech.waveform)
        durations = {name: motion.duration_s for name, motion in motions.items()}
        rates = {name: each.source_fps for name, each in readings.items()}
        notes += [*speech.notes, *length_notes(speech.duration_s, durations, rates)]
    run.report_progress("speech", 1.0)
    staged, cut_notes = bodies.align_and_cap_lengths(shown)
    plans = (
        {}
        if request.motions.source_run is None
        else row_files(request.motions.source_run, "input_plan")
    )
    timeline = run.write_motions_and_make_timeline(
        staged, speech, tracker, request.metrics.weights, plans
    )
    run.add_notes(*cut_notes)
    for row in run.record.rows:
        row.source_suffix = suffix_or_empty(files[row.name])
    if len(shown) < len(motions) and not request.motions.visible:
        run.add_notes(
            f"The figures show only the first {MAX_COMPARED} motions; others can be chosen "
            "(--show)."
        )
    return RunMotions(
        motions=motions,
        viewer_motions=staged,
        figure_motions={name: _on_the_floor(motion) for name, motion in shown.items()},
        timeline=timeline,
        body=body,
        tracker=tracker,
        audio_path=request.speech.path if is_first_track else run.folder.current_path(HEARD),
        onsets_s=None if speech is None else cached_speech_onsets(speech),
        speech_log_mel=None if speech is None else speech_bands_by_frame(speech.waveform),
        protocol_inputs=protocol_inputs(
            request, speech, max(each.num_frames for each in motions.values())
        ),
        windows=windows,
        notes=tuple(notes),
        imported_files=readings,
    )


def protocol_inputs(
    request: DiagnoseRequest, speech: Speech | None, num_frames: int
) -> ProtocolInputs:
    """Read inputs of published protocols from a request's files; raises MotionError, BodyError."""
    metrics, path = request.metrics, request.video.body
    return ProtocolInputs(
        waveform=None if speech is None else speech.waveform,
        published_mean_speeds=None
        if metrics.mean_speeds is None
        else read_mean_speeds(metrics.mean_speeds),
        semantics=None
        if metrics.semantics is None
        else read_semantics(metrics.semantics, num_frames),
        make_face_vertices=None if path is None else partial(_face_vertices, get_body(path)),
    )


def _face_vertices(body: Body, motion: Motion) -> FaceVertices | None:
    """Return the posed vertices of a licensed body of which only jaw and expressions move.

    None if the body has other expressions than the motion, or is a visitor's character.
    """
    if motion.expression_basis != body.expression_basis or body.rig is not None:
        return None
    jaw = slice(3 * JOINT_INDEX["jaw"], 3 * JOINT_INDEX["jaw"] + 3)
    poses = np.zeros_like(motion.poses)
    poses[:, jaw] = motion.poses[:, jaw]
    still = replace(motion, poses=poses, trans=np.zeros_like(motion.trans))
    return lambda frames: np.concatenate(
        list(body.posed_vertices(bodies.body_motion(still.part(frames))))
    )


def _visible_motions(request: DiagnoseRequest, motions: Mapping[str, Motion]) -> dict[str, Motion]:
    """Return the motions in figures, as many as fit, with the reference; may raise RunError."""
    others = [name for name in motions if name != REFERENCE_NAME]
    limit = MAX_COMPARED - (REFERENCE_NAME in motions)
    visible = dict.fromkeys(map(printable, request.motions.visible))
    names = [name for name in visible if name != REFERENCE_NAME]
    unknown = [name for name in names if name not in others]
    if unknown:
        raise RunError(f"Unknown motion {unknown[0]}; choose from {', '.join(others)}.")
    if len(names) > limit:
        raise RunError(
            f"Figures can show at most {limit} of these motions; {len(names)} were chosen."
        )
    chosen = [*(names or others[:limit]), *(name for name in motions if name == REFERENCE_NAME)]
    return {name: motions[name] for name in chosen}


def _on_the_floor(motion: Motion) -> Motion:
    """Put a motion with constant translation on the floor, for pictures only.

    In pictures with other bodies, it would be sunk to the chest or float.
    """
    if np.ptp(motion.trans, axis=0).any():
        return motion
    feet = track_points(motion, open_body_skeleton()).joints[:, list(FEET), 1]
    trans = motion.trans.copy()
    trans[:, 1] += bodies.FOOT_JOINT_HEIGHT_M - float(np.median(feet.min(axis=1)))
    return replace(motion, trans=trans)


def _files_of(request: DiagnoseRequest) -> dict[str, Path]:
    """Return the motion files by name, the reference last."""
    names = motion_labels(request.motions)
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RunError(f"Two of the files have the name {twice!r}; rename one of them.")
    if REFERENCE_NAME in names:
        raise RunError(f"A motion may not be called {REFERENCE_NAME!r}; rename the file.")
    files = dict(zip(names, request.motions.motions, strict=True))
    return (
        files | {REFERENCE_NAME: request.imports.reference} if request.imports.reference else files
    )


def _read_motions(
    request: DiagnoseRequest, files: Mapping[str, Path], run: RunWriter
) -> dict[str, ImportedMotion]:
    request.imports.import_overrides.check_files_exist(
        list(files.values()), *(name for name in files if name != REFERENCE_NAME)
    )
    readings: dict[str, ImportedMotion] = {}
    for done, (name, path) in enumerate(files.items()):
        run.raise_if_cancelled()
        run.report_progress("speech", done / len(files), name)
        kind = REFERENCE_NAME if name == REFERENCE_NAME else MOTIONS
        readings[name] = read_any_motion(
            path, request.imports.import_overrides, request.video.body, kind, name
        )
        _check_frames(request, (each.motion for each in readings.values()))
    return readings


def _check_frames(request: DiagnoseRequest, motions: Iterable[Motion]) -> None:
    count, limit = sum(motion.num_frames for motion in motions), request.motions.max_total_frames
    if limit is not None and count > limit:
        raise RunError(
            f"Together, the files exceed the limit of {limit:,} frames ({limit / 1800:.0f} "
            "minutes); remove some."
        )


def adjusted_for_imports(measured: Diagnostics, run_motions: RunMotions) -> Diagnostics:
    """Add the assumptions of imported files, and remove findings on parts that the files lack."""
    readings = run_motions.imported_files
    return replace(
        measured,
        notes=[*run_motions.notes, *measured.notes],
        systems={
            name: each.without_protocols_of(readings[name].missing_parts)
            for name, each in measured.systems.items()
        },
        findings={
            name: drop_findings_on_missing_parts(findings, readings[name].missing_parts)
            for name, findings in measured.findings.items()
        },
        assumptions={
            name: [
                each.as_json()
                for each in (*reading.assumptions, *_in_step(measured.findings.get(name, ())))
            ]
            for name, reading in readings.items()
        },
        missing_parts={name: sorted(reading.missing_parts) for name, reading in readings.items()},
    )


def _in_step(findings: Iterable[Finding]) -> Iterator[Assumption]:
    """Yield the assumption that a motion has no lag, if a constant lag was detected."""
    for finding in findings:
        numbers = finding.numbers
        if finding.kind == "time_shift" and numbers.get("lag_drift_s") == 0.0:
            late = f"{numbers['lag_s']:.2f}"
            yield Assumption("lag", "0", f"the motion seems {late} s late", "unsure", (late,))


def _windows(request: DiagnoseRequest, motions: Iterable[str]) -> dict[str, Windowing]:
    """Return the windows that the user specified, by motion; raises RunError if impossible."""
    if request.motions.generation_window_frames is None:
        if request.motions.window_overlap_frames:
            raise RunError("An overlap needs a window length; also give --window.")
        return {}
    try:
        windows = Windowing(
            request.motions.generation_window_frames, request.motions.window_overlap_frames
        )
    except ValueError as error:
        raise RunError(str(error)) from error
    return dict.fromkeys(motions, windows)
