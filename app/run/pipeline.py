"""Runs from speech or motions to motions, metrics, videos and figures.

The page, the command line, the notebook and the benchmark all call `generate` and `diagnose`, which
do not depend on Gradio.
"""

from __future__ import annotations

import ctypes
import json
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from app import text
from app.errors import RunError
from app.findings.sentences import sentences_of
from app.run.bodies import align_to_origin, body_motion
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.diagnostics import (
    figure6_of,
    make_jitter_sheet,
    measure_motions,
    write_diagnostics,
)
from app.run.generated_motions import generate_motions
from app.run.imported_motions import NO_SPEECH, import_motions, with_import_notes
from app.run.models import rendering_unavailable_reason
from app.run.output.provenance import PROVENANCE, run_title, settings_summary
from app.run.output.run_folder import RunRecord, read_run, truncate
from app.run.requests.convert import request_json
from app.run.requests.parts import OutputOptions
from app.run.requests.requests import AnyRun, DiagnoseRequest, GenerateRequest, RunRequest
from app.run.run_writer import RunMotions, RunWriter, open_run_writer
from app.run.tasks import RunResult
from app.run.timeline import WordSearch, read_transcript_of_run, with_snaps
from app.run.videos.videos import Snapshots, comparison_video, draw_poses, draw_rows
from conventions.names import REFERENCE_NAME, printable
from model.diagnostics import Diagnostics
from model.motion.motion import Motion
from model.storage.files import file_sha256
from renderer.figures.figure6 import choose_snapshot_frames
from renderer.figures.jitter import sheet_caption

_M_MMAP_THRESHOLD = -3  # malloc.h
_LARGE_BYTES = 1 << 20
POSES_PX = 512
"""Size (pixels) of poses in figures if no videos are rendered."""
_POSES = 0.6
"""Fraction of the time of all figures that rendering the poses takes."""
Request = TypeVar("Request", bound=RunRequest)
MEASURED = "Measured {motions}."
OPENED = "Opened from its file; its {motions} were measured anew."


def generate(request: GenerateRequest, ear: RunCallbacks = NO_CALLBACKS) -> RunResult:
    """Generate motion for a speech with several systems, and write motions, metrics and figures.

    The results are published in the request's folder all together or not at all.

    Raises:
        Cancelled: if the caller has cancelled.
        RunError, SpeechError, MotionError, TranscriptError, BodyError, UnknownNameError,
            CheckpointError, GLError, VideoError, FigureError, WriteError: each with one sentence
            for the user.
    """
    return _run(request, ear, generate_motions)


def diagnose(request: DiagnoseRequest, ear: RunCallbacks = NO_CALLBACKS) -> RunResult:
    """Measure imported motions, and write metrics, videos and figures; raises as `generate`."""
    return _run(request, ear, import_motions)


def run(request: AnyRun, ear: RunCallbacks = NO_CALLBACKS) -> RunResult:
    """Run a request to generate or to measure; raises as `generate`."""
    return (
        generate(request, ear) if isinstance(request, GenerateRequest) else diagnose(request, ear)
    )


def _run(
    request: Request,
    ear: RunCallbacks,
    rows_of: Callable[[Request, WordSearch, RunWriter], RunMotions],
) -> RunResult:
    request.check()
    _return_large_blocks()
    started = time.monotonic()
    source = _source_run(request)
    transcript = read_transcript_of_run(source) if source else request.speech.transcript
    with (
        WordSearch(transcript, request.speech.words) as words,
        open_run_writer(
            request.output.out, record_of(request), ear, is_kept=request.output.is_kept
        ) as run,
    ):
        if words.need_speech and request.speech.path is None:
            raise RunError(NO_SPEECH)
        output = _as_far_as_anything_draws(request.output, run)
        request = replace(request, output=output)
        run.progress("speech", 0.0)
        rows = rows_of(request, words, run)
        run.timeline(rows.timeline, words.given)
        for name, motion in rows.staged.items():
            run.note(
                *(f"{name}: {note}" for note in rows.body.unsupported_notes(body_motion(motion)))
            )
        diagnostics = _measure(rows, run)
        timeline = with_snaps(rows.timeline, diagnostics.findings)
        if timeline != rows.timeline:
            run.timeline(timeline, words.given)
        run.find_plans(rows.staged)
        if output.has_video:
            _draw_videos(request, rows, run)
        beside = nullcontext()
        if output.has_video and rows.is_made:
            beside = comparison_video(list(rows.drawn), rows.sound, run.folder, run, run.file)
        with beside:
            if output.has_figures:
                _draw_figures(request, rows, diagnostics, run)
        said, notes = words.found(run.stop_if_asked)
        run.note(*notes)
        if said.origin != words.given.origin:
            run.timeline(timeline, said)
        run.file(*write_diagnostics(diagnostics, run.folder, said))
        if rows.is_made:
            path = run.folder.path(PROVENANCE)
            words_of = {"origin": said.origin, "count": len(said.words)} if said.words else None
            speech = {**rows.origin["speech"], "words": words_of}
            record = {**rows.origin, "speech": speech, "notes": run.notes}
            path.write_text(json.dumps(record, indent=1) + "\n")
            run.file(path)
        num_frames = max(motion.num_frames for motion in rows.staged.values())
        run.finish(_line(request, len(rows.measured), num_frames, time.monotonic() - started))
        return RunResult(output.out, diagnostics, tuple(run.notes), said)


def _source_run(request: RunRequest) -> Path | None:
    """Return the folder of the run that imported motions come from, or None."""
    return request.motions.source_run if isinstance(request, DiagnoseRequest) else None


def record_of(request: RunRequest) -> RunRecord:
    """Make the record of a run before any input is read."""
    is_generated = isinstance(request, GenerateRequest)
    run = RunRecord(
        kind="generated" if is_generated else "given",
        title=truncate(run_title(request)),
        request=request_json(request),
        settings={key: truncate(value) for key, value in settings_summary(request).items()},
        point=request.joint,
    )
    source = _source_run(request)
    if source is not None:
        before = read_run(source)
        known = ("title", "settings", "speech_sha256")
        return run.model_copy(update={key: getattr(before, key) for key in known})
    speech = request.speech.path
    if not is_generated and speech is not None and speech.is_file():
        run.speech_sha256 = file_sha256(speech)
    return run


def _as_far_as_anything_draws(output: OutputOptions, run: RunWriter) -> OutputOptions:
    """Disable videos and poses if OpenGL does not work; nothing else needs it."""
    if not (output.has_video or (output.has_poses and output.has_figures)):
        return output
    missing = rendering_unavailable_reason()
    run.note(*filter(None, [missing]))
    return replace(output, has_video=False, has_poses=False) if missing else output


def _measure(rows: RunMotions, run: RunWriter) -> Diagnostics:
    """Compute and publish the metrics."""
    on_share = run.share("numbers")
    on_share(0.0)
    diagnostics = measure_motions(
        rows.measured,
        rows.tip,
        rows.onsets_s,
        on_share,
        rows.windows,
        heard=rows.heard,
        inputs=rows.inputs,
    )
    if rows.readings:
        diagnostics = with_import_notes(diagnostics, rows)
    run.note(*diagnostics.notes)
    run.progress("numbers", 1.0)
    run.measured(diagnostics)
    return diagnostics


def _draw_videos(request: RunRequest, rows: RunMotions, run: RunWriter) -> None:
    on_share = run.share("video")
    on_share(0.0)
    placed = {name: _placed(motion, rows) for name, motion in rows.staged.items()}
    draw_rows(
        placed, request.video, rows.body, rows.tip, on_share, run.folder, rows.sound, run.file
    )


def _placed(motion: Motion, rows: RunMotions) -> Motion:
    """Align generated motion for pictures."""
    return align_to_origin(motion) if rows.is_made else motion


def _draw_figures(
    request: RunRequest, rows: RunMotions, diagnostics: Diagnostics, run: RunWriter
) -> None:
    """Draw Figure 6, with poses if they are rendered, and the jitter sheet."""
    snapshots, on_share = _draw_poses(request, rows, run), run.share("figure")
    on_share(_POSES)
    clip = printable(request.speech.path.stem) if rows.is_made and request.speech.path else ""
    contents = figure6_of(rows.drawn, snapshots, rows.tip, request, clip, run.stop_if_asked)
    run.figure("figure6", contents, contents.caption, request.figures.figure_forms)
    on_share((_POSES + 1) / 2)
    systems = [name for name in rows.drawn if name != REFERENCE_NAME]
    sheet, said = make_jitter_sheet(diagnostics, rows.tip, systems), sentences_of(diagnostics)
    told = f"{said['trajectory']} {said['depth']}"
    run.figure("jitter", sheet, sheet_caption(sheet, clip, told), request.figures.figure_forms)
    run.progress("figure", 1.0)


def _draw_poses(request: RunRequest, rows: RunMotions, run: RunWriter) -> Snapshots:
    """Render the poses of Figure 6; without poses, only the frames are chosen."""
    figures, video = request.figures, request.video
    shortest = min(motion.num_frames for motion in rows.drawn.values())
    frames = figures.figure_frames or choose_snapshot_frames(shortest, figures.start_frame)
    if not request.output.has_poses or "b" not in figures.figure_panels:
        return Snapshots(frames)
    if not (request.output.has_video and rows.is_made):  # otherwise the same as in videos
        video = replace(video, size=POSES_PX, views=("front",))
    placed = {name: _placed(motion, rows) for name, motion in rows.drawn.items()}
    on_share = run.share("figure", _POSES)
    return draw_poses(placed, video, rows.body, on_share, frames)


def _line(request: RunRequest, num_rows: int, num_frames: int, seconds: float) -> str:
    """Return the final status message of a run."""
    if not isinstance(request, GenerateRequest):
        count = num_rows - (request.imports.reference is not None)
        motions = f"{count} motion{'s' if count > 1 else ''}"
        return (OPENED if _source_run(request) else MEASURED).format(motions=motions)
    rows = f"{num_rows} {'motion' if num_rows == 1 else 'motions'}"
    line = text.DONE.format(seconds=seconds, rows=rows, frames=num_frames)
    recording = request.live_recording
    return f"{line} {recording.truncation_note}".rstrip() if recording else line


def _return_large_blocks() -> None:
    """Make glibc map blocks of a megabyte and more separately, and return them when they are freed.

    By default it raises that limit to 32 MB as a program goes on, and what a long clip needs for a
    moment then stays in the heap: the peak of a ten-minute clip grows by a tenth. With another C
    library this does nothing.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
    except (OSError, AttributeError):  # another C library
        return
