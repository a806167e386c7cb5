"""The pictures of a run: a video for each motion, all of them side by side, and Figure 6."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.outputs import ResultFolder
from app.rendering import body_motion, render_settings
from app.request import MAX_COMPARED, REFERENCE_NAME, GenerateRequest, file_stem
from app.telling import Reporter
from app.tips import TIP_TITLE, TipSource
from app.videos import draw_videos

if TYPE_CHECKING:
    import numpy as np

    from app.inputs import Inputs
    from model.motion import Motion


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


def show_preview(row: Row, inputs: Inputs, folder: ResultFolder, reporter: Reporter) -> None:
    """The motion as a GLB that a browser plays at once; it is no result of the run."""
    from renderer.glb import write_glb

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
    """A video for each row and view; the poses for Figure 6 are taken on the way.

    Raises:
        CancelledRun, BodyError, GLError, VideoError: see `app.videos.draw_videos`.
    """
    from renderer.figures import choose_snapshot_frames
    from renderer.stage import set_stage
    from renderer.worker import RenderJob

    reporter.progress("video", 0.0)
    motions = {row.name: body_motion(row.shown) for row in rows}
    frames = choose_snapshot_frames(min(motion.num_frames for motion in motions.values()))
    jobs: dict[str, RenderJob] = {}
    drawn: dict[str, str] = {}
    for view in request.views:
        settings = render_settings(view, request.size)
        stage = set_stage(inputs.body, list(motions.values()), view, settings.aspect)
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
    return Snapshots(frames, pictures)


def join_side_by_side(
    rows: Sequence[Row], inputs: Inputs, folder: ResultFolder, reporter: Reporter
) -> None:
    """All videos in lock-step under one sound track.

    Raises:
        Cancelled, VideoError: see `renderer.compose.compose_videos`.
    """
    from renderer.compose import compose_videos

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


def draw_figure(
    request: GenerateRequest,
    rows: Sequence[Row],
    snapshots: Snapshots | None,
    tip: TipSource,
    folder: ResultFolder,
    reporter: Reporter,
) -> None:
    """Figure 6 as PNG, SVG and PDF; without snapshots it has the trajectories only."""
    from model.diagnostics import first_frames
    from renderer.figures import WINDOW_FRAMES, figure6

    reporter.progress("figure", 0.0)
    reporter.stop_if_asked()
    shown = rows_that_fit(rows, reporter)
    has_reference = any(row.name == REFERENCE_NAME for row in shown)
    files = figure6(
        {row.name: tip.track(first_frames(row.shown, WINDOW_FRAMES)) for row in shown},
        {row.name: snapshots.pictures[row.name] for row in shown} if snapshots else {},
        snapshots.frames if snapshots else (),
        30.0,
        folder.path("figure6.png").with_suffix(""),
        reference=REFERENCE_NAME if has_reference else None,
        point=TIP_TITLE,
        tip_source=tip.name,
        post_filter=request.post_filter,
        clip=request.speech.stem,
    )
    for path in files:
        reporter.file("figure", "figure6", folder.path(path.name))
    reporter.progress("figure", 1.0)


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
