"""Runs from speech or motions to motions, metrics, videos and figures.

The page, the command line, the notebook and the benchmark all call `generate` and `diagnose`, which
do not depend on Gradio.
"""

from __future__ import annotations

import ctypes
import json
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from app import text
from app.errors import RunError
from app.findings.sentences import figure_sentences
from app.run.bodies import align_and_cap_lengths, body_motion, make_point_tracker
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.diagnostics import (
    check_figure6,
    make_figure6,
    make_jitter_sheet,
    measure_motions,
    write_diagnostics,
)
from app.run.generated_motions import generate_motions
from app.run.imported_motions import NO_SPEECH, adjusted_for_imports, import_motions
from app.run.models import get_body, rendering_unavailable_reason
from app.run.output.provenance import NONE, PROVENANCE, SPEECH, run_title, settings_summary
from app.run.output.run_folder import RunRecord, read_run, row_files, truncate
from app.run.requests.convert import public_fields
from app.run.requests.parts import FigureOptions, VideoOptions
from app.run.requests.requests import (
    AnyRun,
    DiagnoseRequest,
    Figure6Request,
    GenerateRequest,
    RunRequest,
)
from app.run.run_writer import RunMotions, RunWriter, open_run_writer
from app.run.tasks import RunResult
from app.run.timeline import TranscriptLoader, read_transcript_of_run, with_joint_snaps
from app.run.videos import videos
from conventions.names import REFERENCE_NAME, pluralise, printable
from model.diagnostics import Diagnostics
from model.metrics.protocols.table import PROTOCOL_CAPTION
from model.motion.motion import Motion, load_motion
from model.speech.transcript import Transcript
from model.storage.files import file_sha256
from renderer.figures.figure6.contents import choose_snapshot_frames
from renderer.figures.figure6.layout import draw_figure6
from renderer.figures.jitter import jitter_sheet_caption
from renderer.figures.style import save_figure

_M_MMAP_THRESHOLD = -3  # malloc.h
_LARGE_BYTES = 1 << 20
POSES_PX = 512
"""Size (pixels) of poses in figures if no videos are rendered."""
_POSES = 0.6
"""Share of the figures' progress bar for rendering the poses."""
Request = TypeVar("Request", bound=RunRequest)
MEASURED = "Measured {motions}."
OPENED = "Opened the saved run and measured {motions} again."


def generate(request: GenerateRequest, callbacks: RunCallbacks = NO_CALLBACKS) -> RunResult:
    """Generate motion for a speech with several systems, and write motions, metrics and figures.

    The results are published in the request's folder together or not at all. Raises Cancelled, or
    with one sentence for the user RunError, SpeechError, MotionError, TranscriptError, BodyError,
    UnknownNameError, CheckpointError, GLError, VideoError, FigureError or WriteError.
    """
    started = time.monotonic()
    request.check()
    with _open_run(request, request.speech.transcript, callbacks) as (run, transcript_loader):
        request = _without_unavailable_pictures(request, run)
        motions = generate_motions(request, transcript_loader, run)
        _show(motions, transcript_loader, run)
        diagnostics = _measure(motions, run)
        _publish_metrics(diagnostics, run)
        motions = _mark_snaps(motions, diagnostics, transcript_loader, run)
        run.detect_plans(motions.viewer_motions)
        _render_videos(request, motions, run)
        with _comparison(request, motions, run):
            poses = request.video if request.output.has_video else _small(request.video)
            _draw_figures(request, motions, diagnostics, poses, run)
        transcript = _wait_for_words(motions, transcript_loader, run)
        run.add_files(*write_diagnostics(diagnostics, run.folder, transcript))
        _write_provenance(motions, transcript, run)
        run.finish(_generated_sentence(request, motions, time.monotonic() - started))
        return RunResult(request.output.out, diagnostics, tuple(run.notes), transcript)


def diagnose(request: DiagnoseRequest, callbacks: RunCallbacks = NO_CALLBACKS) -> RunResult:
    """Measure imported motions, and write metrics, videos and figures; raises as `generate`."""
    request.check()
    source = request.motions.source_run
    transcript = read_transcript_of_run(source) if source else request.speech.transcript
    with _open_run(request, transcript, callbacks) as (run, transcript_loader):
        if transcript_loader.needs_speech and request.speech.path is None:
            raise RunError(NO_SPEECH)
        request = _without_unavailable_pictures(request, run)
        motions = import_motions(request, transcript_loader, run)
        _show(motions, transcript_loader, run)
        diagnostics = adjusted_for_imports(_measure(motions, run), motions)
        _publish_metrics(diagnostics, run)
        motions = _mark_snaps(motions, diagnostics, transcript_loader, run)
        run.detect_plans(motions.viewer_motions)
        _render_videos(request, motions, run)
        _draw_figures(request, motions, diagnostics, _small(request.video), run)
        transcript = _wait_for_words(motions, transcript_loader, run)
        run.add_files(*write_diagnostics(diagnostics, run.folder, transcript))
        run.finish(_measured_sentence(request, motions))
        return RunResult(request.output.out, diagnostics, tuple(run.notes), transcript)


def run(request: AnyRun, callbacks: RunCallbacks = NO_CALLBACKS) -> RunResult:
    """Run a request to generate or to measure; raises as `generate`."""
    if isinstance(request, GenerateRequest):
        return generate(request, callbacks)
    return diagnose(request, callbacks)


@contextmanager
def _open_run(
    request: RunRequest, transcript: Path | Transcript | None, callbacks: RunCallbacks
) -> Iterator[tuple[RunWriter, TranscriptLoader]]:
    _return_large_blocks()
    output = request.output
    with (
        TranscriptLoader(transcript, request.speech.word_source) as transcript_loader,
        open_run_writer(
            output.out, make_run_record(request), callbacks, is_incremental=output.is_incremental
        ) as run,
    ):
        yield run, transcript_loader


def make_run_record(request: RunRequest) -> RunRecord:
    """Make the record of a run before any input is read."""
    is_generated = isinstance(request, GenerateRequest)
    run = RunRecord(
        kind="generated" if is_generated else "imported",
        title=truncate(run_title(request)),
        request=public_fields(request),
        settings={key: truncate(value) for key, value in settings_summary(request).items()},
        tracked_point=request.tracked_point,
    )
    if isinstance(request, DiagnoseRequest) and request.motions.source_run is not None:
        before = read_run(request.motions.source_run)
        fields = ("title", "settings", "speech_sha256")
        return run.model_copy(update={key: getattr(before, key) for key in fields})
    speech = request.speech.path
    if not is_generated and speech is not None and speech.is_file():
        run.speech_sha256 = file_sha256(speech)
    return run


def _without_unavailable_pictures(request: Request, run: RunWriter) -> Request:
    """Disable videos and poses if OpenGL does not work; nothing else needs it."""
    output = request.output
    if output.has_video or (output.has_figure_poses and output.has_figures):
        reason = rendering_unavailable_reason()
        if reason:
            run.add_notes(reason)
            output = replace(output, has_video=False, has_figure_poses=False)
    run.report_progress("speech", 0.0)
    return replace(request, output=output)


def _show(motions: RunMotions, transcript_loader: TranscriptLoader, run: RunWriter) -> None:
    """Write the timeline for the viewer, and notes on what the body cannot show."""
    run.write_timeline(motions.timeline, transcript_loader.provided)
    run.add_notes(*motions.body.remarks)
    for name, motion in motions.viewer_motions.items():
        run.add_notes(
            *(f"{name}: {note}" for note in motions.body.unsupported_notes(body_motion(motion)))
        )


def _measure(motions: RunMotions, run: RunWriter) -> Diagnostics:
    on_share = run.progress_callback("numbers")
    on_share(0.0)
    return measure_motions(
        motions.motions,
        motions.tracker,
        motions.onsets_s,
        on_share,
        motions.windows,
        speech_log_mel=motions.speech_log_mel,
        protocol_inputs=motions.protocol_inputs,
    )


def _publish_metrics(diagnostics: Diagnostics, run: RunWriter) -> None:
    run.add_notes(*diagnostics.notes)
    run.report_progress("numbers", 1.0)
    run.record_metrics(diagnostics)


def _mark_snaps(
    motions: RunMotions,
    diagnostics: Diagnostics,
    transcript_loader: TranscriptLoader,
    run: RunWriter,
) -> RunMotions:
    """Mark in the timeline where motions snap."""
    timeline = with_joint_snaps(motions.timeline, diagnostics.findings)
    if timeline != motions.timeline:
        run.write_timeline(timeline, transcript_loader.provided)
    return replace(motions, timeline=timeline)


def _render_videos(request: RunRequest, motions: RunMotions, run: RunWriter) -> None:
    if not request.output.has_video:
        return
    on_share = run.progress_callback("video")
    on_share(0.0)
    videos.render_row_videos(
        {name: motions.align(motion) for name, motion in motions.viewer_motions.items()},
        request.video,
        motions.body,
        motions.tracker,
        on_share,
        run.folder,
        motions.audio_path,
        run.add_files,
    )


def _comparison(
    request: RunRequest, motions: RunMotions, run: RunWriter
) -> AbstractContextManager[None]:
    """Join the videos side by side while the block runs, if there are videos."""
    if not request.output.has_video:
        return nullcontext()
    names = list(motions.figure_motions)
    return videos.composing_comparison_video(
        names, motions.audio_path, run.folder, run, run.add_files
    )


def _small(video: VideoOptions) -> VideoOptions:
    """Return the render options for the poses in figures when no videos are rendered."""
    return replace(video, picture_height_px=POSES_PX, views=("front",))


def _draw_figures(
    request: RunRequest,
    motions: RunMotions,
    diagnostics: Diagnostics,
    poses: VideoOptions,
    run: RunWriter,
) -> None:
    """Draw Figure 6, with poses if they are rendered, and the jitter sheet."""
    if not request.output.has_figures:
        return
    snapshots = _draw_poses(request, motions, poses, run)
    on_share = run.progress_callback("figure")
    on_share(_POSES)
    drawn, tracker, speech = motions.figure_motions, motions.tracker, motions.speech_name
    post_filter = request.sampling.post_filter if isinstance(request, GenerateRequest) else None
    figures, formats = request.figures, request.figures.figure_formats
    contents = make_figure6(
        drawn, snapshots, tracker, figures, speech, run.raise_if_cancelled, post_filter
    )
    run.write_figure("figure6", contents, contents.caption, formats)
    on_share((_POSES + 1) / 2)
    systems = [name for name in drawn if name != REFERENCE_NAME]
    sheet = make_jitter_sheet(diagnostics, tracker, systems)
    sentences = figure_sentences(diagnostics)
    trajectory_text = f"{sentences['trajectory']} {sentences['depth']}"
    caption = jitter_sheet_caption(sheet, speech, trajectory_text)
    run.write_figure("jitter", sheet, caption, formats)
    run.report_progress("figure", 1.0)


def _draw_poses(
    request: RunRequest, motions: RunMotions, video: VideoOptions, run: RunCallbacks
) -> videos.Snapshots:
    """Render the poses of Figure 6; without poses, only the frames are chosen."""
    figures = request.figures
    frames = snapshot_frames(motions.figure_motions, figures)
    if not request.output.has_figure_poses or "b" not in figures.figure_panels:
        return videos.Snapshots(frames)
    placed = {name: motions.align(motion) for name, motion in motions.figure_motions.items()}
    on_share = run.progress_callback("figure", _POSES)
    return videos.draw_snapshots(placed, video, motions.body, on_share, frames)


def snapshot_frames(motions: Mapping[str, Motion], figures: FigureOptions) -> tuple[int, ...]:
    """Return the frames of the snapshots of Figure 6: the requested ones, or every 50."""
    shortest = min(motion.num_frames for motion in motions.values())
    return figures.figure_frames or choose_snapshot_frames(shortest, figures.start_frame)


def redraw_figure6(
    request: Figure6Request, callbacks: RunCallbacks = NO_CALLBACKS
) -> tuple[Path, ...]:
    """Draw Figure 6 of a finished run from the motions in its folder; return the files.

    Raises Cancelled, RunError, MotionError, BodyError, GLError or FigureError.
    """
    record, figures = read_run(request.run), request.figures
    files = row_files(request.run, "motion")
    names = videos.choose_compared_motions(
        [row.name for row in record.rows if row.name in files and not row.edit]
    )
    motions = {name: load_motion(files[name]) for name in names[0]}
    if not motions:
        raise RunError(f"The run in {printable(request.run.name)} has no motion to draw.")
    check_figure6(figures, min(each.num_frames for each in motions.values()), len(motions))
    snapshots = videos.Snapshots(snapshot_frames(motions, figures))
    if "b" in figures.figure_panels and not rendering_unavailable_reason():
        placed, video = align_and_cap_lengths(motions)[0], _small(VideoOptions(body=request.body))
        on_share = callbacks.progress_callback("figure", _POSES)
        snapshots = videos.draw_snapshots(
            placed, video, get_body(request.body), on_share, snapshots.frames
        )
    is_generated, is_raw = record.kind == "generated", record.settings.get("filter") == NONE
    contents = make_figure6(
        motions,
        snapshots,
        make_point_tracker(request.body, record.tracked_point),
        figures,
        record.settings.get(SPEECH, "") if is_generated else "",
        callbacks.raise_if_cancelled,
        ("none" if is_raw else "savgol") if is_generated else None,
    )
    caption = f"{contents.caption} {PROTOCOL_CAPTION}"
    draw = partial(draw_figure6, contents)
    return save_figure(draw, request.out, caption, figures.figure_formats)


def _wait_for_words(
    motions: RunMotions, transcript_loader: TranscriptLoader, run: RunWriter
) -> Transcript:
    """Return the transcript, with the recognised words added to the timeline."""
    transcript, notes = transcript_loader.wait(run.raise_if_cancelled)
    run.add_notes(*notes)
    if transcript.origin != transcript_loader.provided.origin:
        run.write_timeline(motions.timeline, transcript)
    return transcript


def _write_provenance(motions: RunMotions, transcript: Transcript, run: RunWriter) -> None:
    path = run.folder.new_path(PROVENANCE)
    count = len(transcript.words)
    words = {"origin": transcript.origin, "count": count} if count else None
    speech = {**motions.provenance["speech"], "words": words}
    record = {**motions.provenance, "speech": speech, "notes": run.notes}
    path.write_text(json.dumps(record, indent=1) + "\n")
    run.add_files(path)


def _generated_sentence(request: GenerateRequest, motions: RunMotions, seconds: float) -> str:
    """Return the final status message of a run that generated motion."""
    count = len(motions.motions)
    rows = pluralise(count, "motion")
    frames = max(motion.num_frames for motion in motions.viewer_motions.values())
    line = text.DONE.format(seconds=seconds, rows=rows, frames=frames)
    recording = request.live_recording
    return f"{line} {recording.truncation_note}".rstrip() if recording else line


def _measured_sentence(request: DiagnoseRequest, motions: RunMotions) -> str:
    """Return the final status message of a run that measured motions."""
    count = len(motions.motions) - (request.imports.reference is not None)
    line = OPENED if request.motions.source_run else MEASURED
    return line.format(motions=pluralise(count, "motion"))


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
