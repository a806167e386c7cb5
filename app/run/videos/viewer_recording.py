"""Video of the viewer, with its bodies, display options, camera, close-ups and sound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.errors import RunError
from app.run.bodies import MAX_FRAMES, align_average_to_origin, body_motion, make_point_tracker
from app.run.callbacks import RunCallbacks
from app.run.display import ViewerPanel, ViewerState
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.requests.parts import VideoOptions
from app.run.requests.requests import ViewerVideoRequest
from app.run.tasks import ViewerVideo
from app.run.videos.videos import Jobs, draw_videos
from conventions.rates import FPS
from conventions.views import BODY_LOOKS
from model.motion.motion import Motion, load_motion
from model.motion.transforms import smooth_motion
from renderer.body.body import Body, BodyMotion
from renderer.scene.camera import Orbit
from renderer.scene.camera_setup import Panel
from renderer.video import compose
from renderer.video.compose import MAX_HEIGHT_PX, MAX_WIDTH_PX, SuperposedPair
from renderer.video.workers import MotionRenderJob

NAME = "stage.mp4"
NO_LINES = "Skeletons and joint axes are shown only in the viewer, not in the video."
TOO_SMALL = (
    "The viewer cannot be recorded at this size. {why} Enlarge a body, or resize the browser "
    "window."
)
MAX_ENLARGED = 1.5
"""Maximum number of video pixels per pixel of the page."""
_DRAWN = 0.9
"""Fraction of the work that is done when all bodies are rendered."""
_FINE_CRF = 14
"""CRF of intermediate videos, which are encoded again."""


def draw_viewer_video(request: ViewerVideoRequest, callbacks: RunCallbacks) -> ViewerVideo:
    """Render a video of the viewer.

    Raises Cancelled, RunError, MotionError, BodyError, GLError or VideoError.
    """
    viewer = request.viewer
    callbacks.progress_callback("video")(0.0)
    motions = [align_average_to_origin(load_motion(path)) for path in request.motions]
    longest, notes = _longest(motions, viewer)
    motions = [motion.part(slice(longest)) for motion in motions]
    visible = {str(i): motions[number] for i, number in enumerate(viewer.visible)}
    bases = {i: smooth_motion(one) if viewer.is_smoothed else one for i, one in visible.items()}
    body = get_body(request.body)
    tracker = make_point_tracker(request.body, viewer.settings.tracked_point)
    room = _VideoLayout.of(viewer)
    with ResultFolder(request.out) as folder:
        parts = folder.scratch("parts")
        parts.mkdir()
        pictures = room.pictures if viewer.mode != "grid" else room.pictures * len(bases)
        raw = {i: body_motion(motion) for i, motion in visible.items()}
        try:
            draw_videos(
                bases,
                _video_options(request),
                body,
                tracker,
                lambda i, _: parts / f"{i}.mp4",
                callbacks.progress_callback("video", _DRAWN),
                camera_motions=motions,
                layouts=dict(zip(bases, pictures, strict=True)),
                move_cameras=lambda jobs: _move_cameras(jobs, raw, body, viewer),
                crf=_FINE_CRF,
            )
        except RunError as error:
            raise RunError(TOO_SMALL.format(why=error)) from error
        _compose(
            request,
            [parts / f"{i}.mp4" for i in bases],
            [viewer.bodies[number].label for number in viewer.visible],
            room,
            folder,
            callbacks.progress_callback("video", 1 - _DRAWN, _DRAWN),
        )
        (video,) = folder.publish()
    callbacks.report_progress("video", 1.0)
    return ViewerVideo(
        video,
        max(motion.num_frames for motion in visible.values()),
        (*notes, NO_LINES) if viewer.settings.has_bones or viewer.settings.has_axes else notes,
    )


def _longest(motions: Sequence[Motion], viewer: ViewerState) -> tuple[int, tuple[str, ...]]:
    """Return the number of frames that can be rendered in reasonable time, and notes on the cut."""
    limit = MAX_FRAMES // len(viewer.visible)
    if max(motions[i].num_frames for i in viewer.visible) <= limit:
        return max(motion.num_frames for motion in motions), ()
    return limit, (
        f"The video shows only the first {limit / FPS:.0f} s, because the total length of all "
        f"bodies' motions is limited to {MAX_FRAMES / FPS:.0f} s.",
    )


def _video_options(request: ViewerVideoRequest) -> VideoOptions:
    """Return the video options that match the viewer."""
    settings = request.viewer.settings
    return VideoOptions(
        body=request.body,
        display=settings.display,
        framing="whole" if settings.shows_whole_body else "knees",
        look=BODY_LOOKS[0] if request.body else f"{settings.build}-{settings.tone}",
    )


def _move_cameras(jobs: Jobs, raw: dict[str, BodyMotion], body: Body, viewer: ViewerState) -> Jobs:
    """Move the jobs to the viewer's camera, which follows the raw motions.

    The camera follows the first of the raw motions of a pair, with the second aligned to it.
    """
    keys = [*jobs]
    if viewer.mode != "grid" and viewer.settings.is_pair_aligned:
        jobs[keys[1]], raw["1"] = _laid_on(jobs[keys[0]], jobs[keys[1]], raw["1"])
    for key, job in jobs.items():
        assert job.stage is not None
        stage, (name, _) = job.stage.with_orbit(Orbit(*viewer.camera)), key
        ways = stage.followed_positions(body, raw[name])
        if viewer.mode != "grid":
            way, *_ = stage.followed_positions(body, raw["0"])
            ways[0] = way[np.minimum(np.arange(raw[name].num_frames), len(way) - 1)]
        if viewer.mode == "ghost" and job.overlays is not None and job.overlays.trail is not None:
            trail = replace(job.overlays.trail, is_in_body_panel=False)
            job = replace(job, overlays=replace(job.overlays, trail=trail))
        jobs[key] = replace(job, stage=stage.with_camera_paths(ways))
    return jobs


def _laid_on(
    first: MotionRenderJob, second: MotionRenderJob, raw: BodyMotion
) -> tuple[MotionRenderJob, BodyMotion]:
    """Move the second job of a pair and its raw motion horizontally to the pelvis of the first."""
    frames = np.minimum(np.arange(raw.num_frames), first.motion.num_frames - 1)
    shift = first.motion.trans[frames] - second.motion.trans
    shift *= np.array([1, 0, 1], np.float32)
    overlays = second.overlays
    if overlays is not None and overlays.trail is not None:
        overlays = replace(
            overlays, trail=replace(overlays.trail, points=overlays.trail.points + shift)
        )
    motion = replace(second.motion, trans=second.motion.trans + shift)
    return replace(second, motion=motion, overlays=overlays), replace(raw, trans=raw.trans + shift)


@dataclass(frozen=True)
class _VideoLayout:
    """Layout of the video, enlarged as far as a screen has room, with even edges for chroma."""

    width: int
    height: int
    pictures: tuple[tuple[Panel, ...], ...]
    """Panels of all bodies' pictures, or, for a pair, of each."""
    columns: int

    @classmethod
    def of(cls, viewer: ViewerState) -> _VideoLayout:
        width, height = viewer.picture_size
        columns = min(viewer.columns, len(viewer.visible)) if viewer.mode == "grid" else 1
        rows = -(-len(viewer.visible) // columns) if viewer.mode == "grid" else 1
        scale = min(MAX_WIDTH_PX / (columns * width), MAX_HEIGHT_PX / (rows * height), MAX_ENLARGED)
        band = compose.label_band_height(round(scale * min(width, height)))
        scale *= min(1.0, (MAX_HEIGHT_PX / rows - band) / (scale * height))

        def even(value: float) -> int:
            return max(0, 2 * round(scale * value / 2))

        def placed(panel: ViewerPanel) -> Panel:
            left, top, width, height = panel.rect
            at = even(left), even(top)
            size = even(left + width) - at[0], even(top + height) - at[1]
            return Panel(panel.view or "front", *at, *size)

        pictures = tuple(tuple(placed(panel) for panel in picture) for picture in viewer.panels)
        edges = [panel for picture in pictures for panel in picture]
        return cls(
            max(panel.left + panel.width for panel in edges),
            max(panel.top + panel.height for panel in edges),
            pictures,
            columns,
        )


def _compose(
    request: ViewerVideoRequest,
    videos: Sequence[Path],
    labels: Sequence[str],
    room: _VideoLayout,
    folder: ResultFolder,
    on_progress: Callable[[float], None],
) -> None:
    """Join the videos into one with their labels."""
    mode, pair = request.viewer.mode, None
    if mode != "grid":
        body, *beside = room.pictures[1]
        edge = round(request.viewer.wipe * body.width)
        inks = [request.viewer.bodies[number].color for number in request.viewer.visible]
        pair = SuperposedPair(mode, room.width, room.height, body, tuple(beside), edge, inks)
        labels = [
            f"{label}{caption}" for label, caption in zip(labels, _MODE_CAPTIONS[mode], strict=True)
        ]
    compose.compose_videos(
        videos,
        labels,
        folder.new_path(NAME),
        request.speech,
        on_progress=on_progress,
        num_columns=room.columns,
        pair=pair,
    )


_MODE_CAPTIONS = {
    "ghost": ("", ""),
    "wipe": (" (left)", " (right)"),
    "flicker": (" (first)", " (second)"),
}
