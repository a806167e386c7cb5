"""A video of what a stage shows: the same bodies, displays, camera, close-ups, with sound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from app.errors import RunError
from app.run.body_motion import MAX_FRAMES, body_motion, in_register
from app.run.followed_point import TIP, choose_tip_source
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.output.telling import share_teller
from app.run.requests.display import Display, check_display
from app.run.requests.request import OnEvent, ShouldCancel
from app.run.videos.videos import VideoOptions, draw_videos, jobs_of
from conventions.views import BUILDS, LOOKS, TONES
from renderer.scene.camera import Orbit

if TYPE_CHECKING:
    from model.motion.motion import Motion
    from renderer.body.body import Body, BodyMotion
    from renderer.scene.stage import Panel
    from renderer.video.workers import RenderJob

Mode = Literal["grid", "ghost", "wipe", "flicker"]
MODES: tuple[Mode, ...] = get_args(Mode)
MAX_SHOWN = 12
"""Bodies in one video."""
MAX_BODIES = 64
"""On a stage, whether they are shown or not: all of them say where the cameras stand."""
SIDES_PX = (64.0, 8192.0)
"""Of a picture on a screen."""
BODY = "body"


@dataclass(frozen=True)
class SeenPanel:
    """A rectangle of a picture on a screen, in its pixels, and what is seen in it."""

    view: str
    """`BODY`, or a view of a close-up."""
    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True)
class Seen:
    """Which bodies a stage shows, how, and from where."""

    shown: tuple[int, ...]
    """Numbers of the bodies from 0 on, in their order; the two of a pair."""
    size: tuple[float, float]
    """Width and height of one body's picture; of a pair, of the whole."""
    panels: tuple[tuple[SeenPanel, ...], ...]
    """Of all pictures alike; of a pair those of each. The body's comes first."""
    columns: int = 1
    """Pictures in a row."""
    mode: Mode = "grid"
    """How two lie over each other; ``grid`` is beside."""
    is_aligned: bool = True
    """Whether the second of a pair stands where the first does, pelvis on pelvis."""
    wipe: float = 0.5
    """Share of the body's picture that shows the first."""
    display: Display = field(default_factory=Display)
    point: str = TIP
    """Of the trail."""
    is_smoothed: bool = False
    """Behind the post-filter."""
    is_whole: bool = False
    """All of the body rather than from the knees up."""
    tone: str = "light"
    """One of `TONES`; of the open body alone."""
    build: str = "average"
    """One of `renderer.body.look.BUILDS`; of the open body alone."""
    has_lines: bool = False
    """Whether skeletons or axes lie over the bodies; a video has none, and says so."""
    camera: Orbit = field(default_factory=Orbit)

    def check(self, num_bodies: int) -> None:
        """Refuse what no stage shows.

        Raises:
            RunError: with one sentence.
        """
        if not num_bodies:
            raise RunError("There is no body on the stage yet; wait until one moves.")
        if num_bodies > MAX_BODIES:
            raise RunError(f"A stage has at most {MAX_BODIES} bodies; {num_bodies} were told of.")
        if self.mode not in MODES:
            raise RunError(
                f"There is no way {self.mode!r} to compare; choose one of {', '.join(MODES)}."
            )
        is_pair = self.mode != "grid"
        if is_pair and len(self.shown) != 2:
            raise RunError(f"A {self.mode} shows two bodies; {len(self.shown)} were told of.")
        if not 1 <= len(self.shown) <= MAX_SHOWN:
            raise RunError(
                f"A video shows 1 to {MAX_SHOWN} bodies; the stage shows {len(self.shown)}: "
                "enlarge one, or compare two."
            )
        if not all(0 <= number < num_bodies for number in self.shown):
            raise RunError(f"The stage has bodies 0 to {num_bodies - 1}; got {list(self.shown)}.")
        if not 1 <= self.columns <= MAX_SHOWN:
            raise RunError(f"A row holds 1 to {MAX_SHOWN} bodies; got {self.columns}.")
        if not 0 <= self.wipe <= 1:
            raise RunError(f"A wipe stands at 0 to 1 of the picture; got {self.wipe:g}.")
        for kind, name, known in (("tone", self.tone, TONES), ("build", self.build, BUILDS)):
            if name not in known:
                raise RunError(f"There is no {kind} {name!r}; choose one of {', '.join(known)}.")
        self._check_room(is_pair)
        check_display(self.display)
        try:
            self.camera.check()
        except ValueError as error:
            raise RunError(str(error)) from error

    def _check_room(self, is_pair: bool) -> None:
        from renderer.scene.stage import CLOSE_UP_VIEWS  # only now: it brings scipy

        known = {BODY, *(view for views in CLOSE_UP_VIEWS.values() for view in views)}
        least, most = SIDES_PX
        if not all(least <= side <= most for side in self.size):
            raise RunError(
                f"A picture has {least:g} to {most:g} pixels on each side; the stage has "
                f"{self.size[0]:g} x {self.size[1]:g}: make its window larger."
            )
        if len(self.panels) != (2 if is_pair else 1):
            raise RunError("The stage told of another number of pictures than it shows.")
        for picture in self.panels:
            views = [panel.view for panel in picture]
            if views[:1] != [BODY] or len(set(views)) != len(views) or not set(views) <= known:
                raise RunError(
                    "A picture holds a body, and face and hands at most once each beside it; "
                    f"got {', '.join(views) or 'nothing'}."
                )
            for panel in picture:
                inside = (
                    panel.left >= -1
                    and panel.top >= -1
                    and panel.left + panel.width <= self.size[0] + 1
                    and panel.top + panel.height <= self.size[1] + 1
                    and min(panel.width, panel.height) >= 8
                )
                if not inside:
                    raise RunError(
                        f"The {panel.view.replace('_', ' ')} has no room on the stage; make its "
                        "window larger, or leave out close-ups."
                    )


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
    color: str
    """Of its row, as #rrggbb."""


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


def draw_seen(request: SeenRequest, on_event: OnEvent, should_cancel: ShouldCancel) -> SeenVideo:
    """Draw the video.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError, MotionError, BodyError, GLError, VideoError: each with one sentence.
    """
    from model.motion.filtering import smooth_motion
    from model.motion.motion import load_motion

    seen = request.seen
    seen.check(len(request.bodies))
    on_share = share_teller("video", on_event, should_cancel)
    on_share(0.0)
    motions = [in_register(load_motion(each.motion)) for each in request.bodies]
    longest, notes = _longest(motions, seen)
    motions = [motion.part(slice(longest)) for motion in motions]
    shown = {str(i): motions[number] for i, number in enumerate(seen.shown)}
    bases = {
        i: smooth_motion(motion) if seen.is_smoothed else motion for i, motion in shown.items()
    }
    body = get_body(request.body)
    tip = choose_tip_source(body, request.body, seen.point)
    room = _Room.of(seen)
    with ResultFolder(request.out) as folder:
        parts = folder.scratch("parts")
        parts.mkdir()
        jobs: dict[str, RenderJob] = {}
        for i, base in bases.items():
            picture = room.pictures[int(i) if seen.mode != "grid" else 0]
            options = _options(seen, picture, LOOKS[0] if request.body else None)
            (job,) = jobs_of(
                *({i: base}, options, body, request.body, tip),
                lambda name, _: parts / f"{name}.mp4",
                staged=motions,
            ).values()
            jobs[i] = job
        jobs = _seen_from_there(jobs, {i: body_motion(raw) for i, raw in shown.items()}, body, seen)
        draw_videos(jobs, lambda share: on_share(_DRAWN * share))
        _compose(
            request,
            [parts / f"{i}.mp4" for i in jobs],
            [request.bodies[number].label for number in seen.shown],
            *(room, folder, on_share),
        )
        (video,) = folder.publish()
    on_share(1.0)
    return SeenVideo(
        video,
        max(motion.num_frames for motion in shown.values()),
        (*notes, NO_LINES) if seen.has_lines else notes,
    )


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


def _options(seen: Seen, layout: tuple[Panel, ...], look: str | None) -> VideoOptions:
    options = VideoOptions(
        seen.display,
        framing="whole" if seen.is_whole else "knees",
        look=look or f"{seen.build}-{seen.tone}",
        layout=layout,
        crf=_FINE_CRF,
    )
    try:
        options.settings("front")
    except RunError as error:
        raise RunError(
            f"Bodies are too small on the stage to be drawn ({error}); enlarge one, or make its "
            "window larger."
        ) from error
    return options


def _seen_from_there(
    jobs: dict[str, RenderJob], raw: dict[str, BodyMotion], body: Body, seen: Seen
) -> dict[str, RenderJob]:
    """The jobs before the camera of the stage, which follows the motions as they are; of a pair
    that of the first, with the second laid on it.

    Args:
        raw: by the keys of ``jobs``.
    """
    if seen.mode != "grid" and seen.is_aligned:
        jobs["1"], raw["1"] = _laid_on(jobs["0"], jobs["1"], raw["1"])
    for key, job in jobs.items():
        assert job.stage is not None
        stage = job.stage.seen_from(seen.camera)
        ways = stage.tracks(body, raw[key])
        if seen.mode != "grid":
            way, *_ = stage.tracks(body, raw["0"])
            ways[0] = way[np.minimum(np.arange(raw[key].num_frames), len(way) - 1)]
        if seen.mode == "ghost" and job.marks is not None and job.marks.trail is not None:
            trail = replace(job.marks.trail, is_on_body=False)
            job = replace(job, marks=replace(job.marks, trail=trail))
        jobs[key] = replace(job, stage=stage.going(ways))
    return jobs


def _laid_on(first: RenderJob, second: RenderJob, raw: BodyMotion) -> tuple[RenderJob, BodyMotion]:
    """The second of a pair with its pelvis over or under that of the first in every frame, and so
    the motion that it is drawn from."""
    frames = np.minimum(np.arange(raw.num_frames), first.motion.num_frames - 1)
    shift = first.motion.trans[frames] - second.motion.trans
    shift *= np.array([1, 0, 1], np.float32)
    marks = second.marks
    if marks is not None and marks.trail is not None:
        marks = replace(marks, trail=replace(marks.trail, points=marks.trail.points + shift))
    motion = replace(second.motion, trans=second.motion.trans + shift)
    return replace(second, motion=motion, marks=marks), replace(raw, trans=raw.trans + shift)


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
        from renderer.scene.stage import Panel
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


def _compose(
    request: SeenRequest,
    videos: Sequence[Path],
    labels: Sequence[str],
    room: _Room,
    folder: ResultFolder,
    on_share: Callable[[float], None],
) -> None:
    """All of them in one video, under their names."""
    from renderer.video.compose import PairLayout, compose_pair, compose_videos

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
        inks=[request.bodies[number].color for number in request.seen.shown],
    )


_SAID = {
    "ghost": ("", ""),
    "wipe": (" (left)", " (right)"),
    "flicker": (" (first)", " (second)"),
}
