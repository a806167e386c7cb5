"""A video of what a stage shows: the same bodies, displays, camera and close-ups, with sound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.errors import RunError
from app.run.body_motion import body_motion
from app.run.followed_point import TipSource, choose_tip_source
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.output.telling import share_teller
from app.run.requests.display import displayed, marks_of
from app.run.requests.request import OnEvent, ShouldCancel
from app.run.videos.own_videos import MAX_FRAMES
from app.run.videos.register import in_register
from app.run.videos.seen import BODY, Seen, SeenPanel
from app.run.videos.videos import draw_videos

if TYPE_CHECKING:
    from model.motion.motion import Motion
    from renderer.body.body import Body
    from renderer.scene.panels import Panel
    from renderer.scene.stage import Stage
    from renderer.video.job import RenderJob
    from renderer.video.marks import Marks
    from renderer.video.settings import RenderSettings

NAME = "stage.mp4"
NO_LINES = "Skeletons and axes of joints are of the stage alone, and not in the video."
MAX_ENLARGED = 1.5
"""Pixels of a video for one of the page, at most."""
_DRAWN = 0.9
"""Share of the work that is done when all bodies are drawn."""
_FINE_CRF = 14
"""Of the pictures that are encoded once more."""


@dataclass(frozen=True)
class SeenBody:
    """One of a stage's bodies."""

    label: str
    motion: Path


@dataclass(frozen=True)
class SeenRequest:
    """A video of a stage."""

    bodies: tuple[SeenBody, ...]
    """All that are on it."""
    seen: Seen
    out: Path
    speech: Path | None = None
    """A wav; None leaves the video silent."""
    body: Path | None = None

    def within(self, folder: Path) -> SeenRequest:
        """The same in a folder of its own."""
        return replace(self, out=folder / "results")


@dataclass(frozen=True)
class SeenVideo:
    """What came of it."""

    path: Path
    num_frames: int
    notes: tuple[str, ...] = ()
    """What the person should know of it."""


@dataclass(frozen=True)
class _Drawn:
    """One body of the video."""

    label: str
    raw: Motion
    """What cameras follow."""
    shown: Motion
    """As it is drawn."""
    marks: Marks | None


def draw_seen(request: SeenRequest, on_event: OnEvent, should_cancel: ShouldCancel) -> SeenVideo:
    """Draw the video.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError, MotionError, BodyError, GLError, VideoError: each with one sentence.
    """
    from model.motion.motion import load_motion

    seen = request.seen
    seen.check(len(request.bodies))
    on_share = share_teller("video", on_event, should_cancel)
    on_share(0.0)
    motions = [in_register(load_motion(each.motion)) for each in request.bodies]
    longest, notes = _longest(motions, seen)
    if seen.has_lines:
        notes = (*notes, NO_LINES)
    motions = [motion.part(slice(longest)) for motion in motions]
    body = get_body(request.body)
    tip = choose_tip_source(body, request.body, seen.point)
    drawn = [_drawn(request.bodies[i].label, motions[i], seen, tip, body) for i in seen.shown]
    is_pair = seen.mode != "grid"
    if is_pair and seen.is_aligned:
        drawn[1] = _laid_on(drawn[0], drawn[1])
    room = _Room.of(seen)
    with ResultFolder(request.out) as folder:
        parts = folder.scratch("parts")
        parts.mkdir()
        jobs: dict[str, RenderJob] = {}
        for number, each in enumerate(drawn):
            settings = _settings(seen, room.pictures[number if is_pair else 0])
            stage = _stage(body, motions, settings, seen)
            stage = stage.following(body, body_motion(each.raw))
            if is_pair:
                stage = _along(stage, body, drawn[0].raw, each.raw.num_frames)
            job = _job(each, parts / f"{number}.mp4", settings, stage, request.body)
            if request.body is None:
                job = replace(job, look=f"{seen.build}-{seen.tone}")
            jobs[str(number)] = job
        draw_videos(
            jobs,
            on_progress=lambda share: on_share(_DRAWN * share),
            on_done=lambda name: None,
            should_cancel=lambda: False,  # on_share ends it
        )
        videos = [parts / f"{number}.mp4" for number in range(len(drawn))]
        _compose(request, videos, [each.label for each in drawn], room, folder, on_share)
        (video,) = folder.publish()
    on_share(1.0)
    return SeenVideo(video, max(each.shown.num_frames for each in drawn), notes)


def _longest(motions: Sequence[Motion], seen: Seen) -> tuple[int, tuple[str, ...]]:
    """Frames that can be drawn in reasonable time, and what is to be said of it."""
    from conventions.rates import FPS

    limit = MAX_FRAMES // len(seen.shown)
    if max(motions[i].num_frames for i in seen.shown) <= limit:
        return max(motion.num_frames for motion in motions), ()
    return limit, (
        f"The video shows the first {limit / FPS:.0f} s: all its bodies together may have "
        f"{MAX_FRAMES / FPS:.0f} s.",
    )


def _drawn(label: str, raw: Motion, seen: Seen, tip: TipSource, body: Body) -> _Drawn:
    from model.motion.filtering import smooth_motion

    base = smooth_motion(raw) if seen.is_smoothed else raw
    marks = marks_of(base, seen.display, tip, body)
    if seen.mode == "ghost" and marks is not None and marks.trail is not None:
        marks = replace(marks, trail=replace(marks.trail, is_on_body=False))
    return _Drawn(label, raw, displayed(base, seen.display), marks)


def _laid_on(first: _Drawn, second: _Drawn) -> _Drawn:
    """The second of a pair with its pelvis over or under that of the first in every frame."""
    frames = np.minimum(np.arange(second.shown.num_frames), first.shown.num_frames - 1)
    shift = (first.shown.trans[frames] - second.shown.trans) * np.array([1, 0, 1], np.float32)
    marks = second.marks
    if marks is not None and marks.trail is not None:
        trail = replace(marks.trail, points=marks.trail.points + shift)
        marks = replace(marks, trail=trail)
    shown = replace(second.shown, trans=second.shown.trans + shift)
    raw = replace(second.raw, trans=second.raw.trans + shift)
    return replace(second, raw=raw, shown=shown, marks=marks)


@dataclass(frozen=True)
class _Room:
    """The picture of a page as it is in the video: sharper, as far as a screen has room for it, and
    with even edges, as colours have half as many pixels as light."""

    width: int
    height: int
    pictures: tuple[tuple[Panel, ...], ...]
    """Of all bodies alike, or of each of a pair."""
    columns: int

    @classmethod
    def of(cls, seen: Seen) -> _Room:
        from renderer.scene.panels import Panel
        from renderer.video.compose import MAX_HEIGHT_PX, MAX_WIDTH_PX, band_height

        width, height = seen.size
        columns = min(seen.columns, len(seen.shown)) if seen.mode == "grid" else 1
        rows = -(-len(seen.shown) // columns) if seen.mode == "grid" else 1
        scale = min(MAX_WIDTH_PX / (columns * width), MAX_HEIGHT_PX / (rows * height), MAX_ENLARGED)
        band = band_height(round(scale * min(width, height)))
        scale *= min(1.0, (MAX_HEIGHT_PX / rows - band) / (scale * height))

        def even(value: float) -> int:
            return max(0, 2 * round(scale * value / 2))

        def placed(panel: SeenPanel) -> Panel:
            left, top = even(panel.left), even(panel.top)
            size = even(panel.left + panel.width) - left, even(panel.top + panel.height) - top
            return Panel("front" if panel.view == BODY else panel.view, left, top, *size)

        pictures = tuple(tuple(placed(panel) for panel in picture) for picture in seen.panels)
        edges = [panel for picture in pictures for panel in picture]
        return cls(
            max(panel.left + panel.width for panel in edges),
            max(panel.top + panel.height for panel in edges),
            pictures,
            columns,
        )


def _settings(seen: Seen, layout: tuple[Panel, ...]) -> RenderSettings:
    from renderer.video.settings import RenderSettings

    try:
        return RenderSettings(
            width=layout[0].width,
            height=layout[0].height,
            framing="whole" if seen.is_whole else "knees",
            layout=layout,
            crf=_FINE_CRF,
        )
    except ValueError as error:
        raise RunError(
            f"Bodies are too small on the stage to be drawn ({error}); enlarge one, or make its "
            "window larger."
        ) from error


def _stage(body: Body, motions: Sequence[Motion], settings: RenderSettings, seen: Seen) -> Stage:
    from renderer.video.frames import stage_for

    everything = [body_motion(motion) for motion in motions]
    return stage_for(body, everything, settings).seen_from(seen.camera)


def _along(stage: Stage, body: Body, first: Motion, num_frames: int) -> Stage:
    """The stage whose camera goes with the first of a pair, for as long as the other moves."""
    from renderer.scene.stage import camera_track

    way = camera_track(body, body_motion(first), "front", replace(stage, way=None))
    frames = np.minimum(np.arange(num_frames), len(way) - 1)
    return replace(stage, way=way[frames])


def _job(
    each: _Drawn, out: Path, settings: RenderSettings, stage: Stage, body_path: Path | None
) -> RenderJob:
    from renderer.video.job import RenderJob

    return RenderJob(
        motion=body_motion(each.shown),
        out=out,
        settings=settings,
        body_path=body_path,
        stage=stage,
        marks=each.marks,
    )


def _compose(
    request: SeenRequest,
    videos: Sequence[Path],
    labels: Sequence[str],
    room: _Room,
    folder: ResultFolder,
    on_share: Callable[[float], None],
) -> None:
    """All of them in one video, under their names."""
    from renderer.video.compose import compose_videos
    from renderer.video.pair import PairLayout, compose_pair

    def on_progress(share: float) -> None:
        on_share(_DRAWN + (1 - _DRAWN) * share)  # what it raises ends ffmpeg too

    out, mode = folder.path(NAME), request.seen.mode
    if mode == "grid":
        compose_videos(
            *(videos, labels, out, request.speech),
            on_progress=on_progress,
            num_columns=room.columns,
        )
        return
    body, *beside = room.pictures[1]
    layout = PairLayout(
        *(room.width, room.height, body, tuple(beside)), edge=round(request.seen.wipe * body.width)
    )
    compose_pair(
        *(videos, [f"{label}{said}" for label, said in zip(labels, _SAID[mode], strict=True)]),
        *(mode, layout, out, request.speech),
        on_progress=on_progress,
    )


_SAID = {
    "ghost": (" (cyan)", " (red)"),
    "wipe": (" (left)", " (right)"),
    "flicker": (" (first)", " (second)"),
}
