"""The pictures of a run: a video for each motion, all of them side by side, and the figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.errors import RunError
from app.findings.sentences import sentences_of
from app.run.export import body_motion, render_settings
from app.run.followed_point import TipSource
from app.run.jerk_marks import jerk_marks
from app.run.request import MAX_COMPARED, REFERENCE_NAME, GenerateRequest, file_stem
from app.run.result_folder import ResultFolder
from app.run.telling import Reporter
from app.run.videos import draw_videos

if TYPE_CHECKING:
    import numpy as np

    from app.run.inputs import Inputs
    from model.motion.motion import Motion
    from renderer.figures.write import JointMarks


@dataclass(frozen=True)
class Row:
    """One motion of the comparison, as generated or as recorded."""

    name: str
    raw: Motion
    shown: Motion
    """After the post-filter, if one was asked for: what files and pictures hold."""
    is_first_sample: bool = True


@dataclass(frozen=True)
class Snapshots:
    """Poses for Figure 6: the frames, and by row the pictures (N, H, W, 3); none without video."""

    frames: tuple[int, ...]
    pictures: dict[str, np.ndarray]
    marks: JointMarks
    """How much each joint jerks around each of the frames."""


def show_preview(row: Row, inputs: Inputs, folder: ResultFolder, reporter: Reporter) -> None:
    """The motion as a GLB that a browser plays at once; it is no result of the run."""
    from renderer.files.glb import write_glb

    previews = folder.scratch("previews")
    previews.mkdir(exist_ok=True)
    path = previews / f"{file_stem(row.name)}.glb"
    write_glb(inputs.body, body_motion(row.shown), path)
    reporter.file("preview", row.name, path)


def draw_all(
    request: GenerateRequest,
    inputs: Inputs,
    rows: Sequence[Row],
    folder: ResultFolder,
    reporter: Reporter,
) -> Snapshots:
    """A video for each row and view; the poses for Figure 6 are taken on the way, with the first
    view's camera.

    Raises:
        CancelledRun, BodyError, GLError, VideoError: see `app.run.videos.draw_videos`.
    """
    from renderer.figures.write import choose_snapshot_frames
    from renderer.stage.stage import set_stage
    from renderer.video.pool import RenderJob

    reporter.progress("video", 0.0)
    motions = {row.name: body_motion(row.shown) for row in rows}
    shortest = min(motion.num_frames for motion in motions.values())
    frames = choose_snapshot_frames(shortest, request.start_frame)
    marks = None
    jobs: dict[str, RenderJob] = {}
    drawn: dict[str, str] = {}
    for view in request.views:
        settings = render_settings(view, request.size)
        stage = set_stage(inputs.body, list(motions.values()), view, settings.aspect)
        marks = marks or jerk_marks(inputs.body, motions, frames, settings, stage)
        for name, motion in motions.items():
            is_main = view == request.views[0]
            file_name = file_stem(name) + ("" if is_main else f".{view}") + ".mp4"
            drawn[file_name] = name
            jobs[file_name] = RenderJob(
                motion=motion,
                out=folder.path(file_name),
                speech_wav=inputs.wav,
                settings=settings,
                body_path=request.body,
                look=request.look,
                stage=stage,
                still_frames=frames if is_main else (),
            )
    results = draw_videos(
        jobs,
        on_progress=lambda part: reporter.progress("video", part),
        on_done=lambda file: reporter.file("video", drawn[file], folder.path(file)),
        should_cancel=reporter.should_cancel,
    )
    reporter.progress("video", 1.0)
    pictures = {row.name: results[f"{file_stem(row.name)}.mp4"].stills for row in rows}
    assert marks is not None  # a request has a view
    return Snapshots(frames, pictures, marks)


def join_side_by_side(
    rows: Sequence[Row], inputs: Inputs, folder: ResultFolder, reporter: Reporter
) -> None:
    """All videos in lock-step under one sound track.

    Raises:
        Cancelled, VideoError: see `renderer.video.compose.compose_videos`.
    """
    from renderer.video.compose import compose_videos

    reporter.progress("comparison", 0.0)
    names = [row.name for row in rows_that_fit(rows, reporter)]
    out = folder.path("comparison.mp4")
    compose_videos(
        [folder.path(f"{file_stem(name)}.mp4") for name in names],
        names,
        out,
        inputs.wav,
        on_progress=lambda part: reporter.progress("comparison", part),
        should_cancel=reporter.should_cancel,
    )
    reporter.file("comparison", "comparison", out)
    reporter.progress("comparison", 1.0)


def check_start(start_frame: int, num_frames: int) -> None:
    """Refuse a start of Figure 6 behind the end of the shortest motion, before anything is made.

    Raises:
        RunError: naming the last frame.
    """
    if not 0 <= start_frame < num_frames:
        raise RunError(f"Figure 6 must start at frame 0 to {num_frames - 1}; got {start_frame}.")


def draw_figures(
    request: GenerateRequest,
    rows: Sequence[Row],
    snapshots: Snapshots | None,
    tip: TipSource,
    diagnostics: Mapping[str, Any],
    folder: ResultFolder,
    reporter: Reporter,
) -> None:
    """Figure 6 and the jitter sheet, each as PNG, SVG and PDF.

    Without snapshots Figure 6 has the trajectories only.
    """
    reporter.progress("figure", 0.0)
    reporter.stop_if_asked()
    shown = rows_that_fit(rows, reporter)
    for path in _figure6(request, shown, snapshots, tip, folder):
        reporter.file("figure", "figure6", path)
    reporter.progress("figure", 0.5)
    reporter.stop_if_asked()
    for path in draw_jitter(diagnostics, tip, folder, _systems(shown), request.speech.stem):
        reporter.file("figure", "jitter", path)
    reporter.progress("figure", 1.0)


def _figure6(
    request: GenerateRequest,
    shown: Sequence[Row],
    snapshots: Snapshots | None,
    tip: TipSource,
    folder: ResultFolder,
) -> list[Path]:
    from model.measures.diagnostics import first_frames
    from renderer.figures.write import WINDOW_FRAMES, figure6

    names = [row.name for row in shown]
    end = request.start_frame + WINDOW_FRAMES
    files = figure6(
        {row.name: tip.track(first_frames(row.shown, end)) for row in shown},
        {name: snapshots.pictures[name] for name in names} if snapshots else {},
        snapshots.frames if snapshots else (),
        30.0,
        folder.path("figure6.png").with_suffix(""),
        reference=REFERENCE_NAME if REFERENCE_NAME in names else None,
        start_frame=request.start_frame,
        point=tip.title,
        tip_source=tip.name,
        post_filter=request.post_filter,
        clip=request.speech.stem,
        marks=snapshots.marks.of(names) if snapshots else None,
    )
    return [folder.path(path.name) for path in files]


def draw_jitter(
    diagnostics: Mapping[str, Any],
    tip: TipSource,
    folder: ResultFolder,
    names: Sequence[str],
    clip: str = "",
) -> list[Path]:
    """The jitter sheet of some systems, with what its numbers say, in all three formats."""
    from renderer.figures.jitter.sheet import jitter_sheet

    sentences = sentences_of(diagnostics)
    files = jitter_sheet(
        diagnostics,
        folder.path("jitter.png").with_suffix(""),
        names=names,
        point=tip.title.lower(),
        clip=clip,
        sentence=f"{sentences['trajectory']} {sentences['depth']}",
    )
    return [folder.path(path.name) for path in files]


def draw_error_growth(
    growth: Mapping[str, Any], names: Sequence[str], folder: ResultFolder
) -> list[Path]:
    """The experiment on the recorded motion, or on the first where there is none.

    Args:
        growth: the content of ``error_growth.json``.
        names: of the motions in it.
    """
    from renderer.figures.error_growth import error_growth_figure

    name = REFERENCE_NAME if REFERENCE_NAME in names else names[0]
    measured = growth["motions"][name]
    files = error_growth_figure(
        measured,
        folder.path("error_growth.png").with_suffix(""),
        sentence=f"{name}: {measured['sentence']}",
    )
    return [folder.path(path.name) for path in files]


def _systems(rows: Sequence[Row]) -> list[str]:
    return [row.name for row in rows if row.name != REFERENCE_NAME]


def rows_that_fit(rows: Sequence[Row], reporter: Reporter) -> list[Row]:
    """All rows, or where they are too many the first sample of each system and the reference."""
    if len(rows) <= MAX_COMPARED:
        return list(rows)
    first = [row for row in rows if row.is_first_sample and row.name != REFERENCE_NAME]
    reference = [row for row in rows if row.name == REFERENCE_NAME]
    fitting = [*first[: MAX_COMPARED - len(reference)], *reference]
    reporter.note(
        f"Comparison and figure hold at most {MAX_COMPARED} motions; they show "
        f"{', '.join(row.name for row in fitting)}."
    )
    return fitting
