"""Videos of anyone's motion files, as they are of generated motion: in register, with close-ups."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.run.body_motion import body_motion
from app.run.output.result_folder import ResultFolder
from app.run.requests.display import Display, displayed, marks_of
from app.run.requests.request import Artefact
from app.run.videos.export import render_settings
from app.run.videos.posters import POSTER_SUFFIX, write_poster
from app.run.videos.register import in_register
from app.run.videos.videos import draw_videos
from conventions.names import file_stem
from conventions.views import CLOSE_UPS, CloseUp, Framing

if TYPE_CHECKING:
    from app.run.followed_point import TipSource
    from model.motion.motion import Motion
    from renderer.body.body import Body

MAX_FRAMES = 10_800
"""Of all videos of a run together: six of one minute."""
OnFile = Callable[[Artefact], None]


@dataclass(frozen=True)
class VideoOptions:
    """How the motions are shown."""

    display: Display = field(default_factory=lambda: Display(has_trail=True))
    size: int = 640
    """Height of the body in pixels."""
    framing: Framing = "knees"
    close_ups: tuple[CloseUp, ...] = CLOSE_UPS
    has_posters: bool = False
    """Whether the first picture of each video is told of too."""


@dataclass(frozen=True)
class Pictured:
    """What is drawn, and what the person should know of it."""

    motions: Mapping[str, Motion]
    """As they stand in the videos, but for exaggeration."""
    notes: tuple[str, ...]

    def tell(self, folder: ResultFolder, on_file: OnFile) -> None:
        """Leave each motion for a player, and tell of it."""
        from model.motion.motion import save_motion

        shown = _beside(folder)
        for name, motion in self.motions.items():
            path = shown / f"{file_stem(name)}.npz"
            save_motion(motion, path)
            on_file(Artefact("motion", name, path))


def picture_motions(motions: Mapping[str, Motion]) -> Pictured:
    """The motions in register, cut to what can be drawn in reasonable time."""
    from conventions.rates import FPS
    from model.motion.motion import first_frames

    longest = max(MAX_FRAMES // max(len(motions), 1), 1)
    cut = [name for name, motion in motions.items() if motion.num_frames > longest]
    notes = ()
    if cut:
        notes = (f"Stage and videos show the first {longest / FPS:.0f} s of {', '.join(cut)}.",)
    return Pictured(
        {
            name: in_register(first_frames(motion, min(motion.num_frames, longest)))
            for name, motion in motions.items()
        },
        notes,
    )


def draw_own_videos(
    motions: Mapping[str, Motion],
    options: VideoOptions,
    body: Body,
    body_path: Path | None,
    tip: TipSource,
    speech: Path | None,
    folder: ResultFolder,
    on_share: Callable[[float], None],
    on_file: OnFile,
) -> None:
    """A video of each motion, under one camera; each file is told of as soon as it is whole.

    Args:
        motions: as `picture_motions` gives them.
        on_share: told the share of all frames done; what it raises ends the work.

    Raises:
        BodyError, GLError, VideoError: see `app.run.videos.videos.draw_videos`.
    """
    from renderer.video.frames import stage_for
    from renderer.video.pool import RenderJob

    settings = render_settings(
        "front", options.size, close_ups=options.close_ups, framing=options.framing
    )
    posed = [body_motion(motion) for motion in motions.values()]
    stage = stage_for(body, posed, settings)
    shown = _beside(folder)
    jobs: dict[str, Any] = {}
    for name, motion in motions.items():
        jobs[name] = RenderJob(
            motion=body_motion(displayed(motion, options.display)),
            out=folder.path(f"{file_stem(name)}.mp4"),
            speech_wav=speech,
            settings=settings,
            body_path=body_path,
            stage=stage,
            marks=marks_of(motion, options.display, tip, body),
        )

    def on_done(name: str) -> None:
        if options.has_posters:
            poster = shown / f"{file_stem(name)}{POSTER_SUFFIX}"
            write_poster(jobs[name].out, poster)
            on_file(Artefact("poster", name, poster))
        on_file(Artefact("video", name, jobs[name].out))

    draw_videos(
        jobs,
        on_progress=on_share,
        on_done=on_done,
        should_cancel=lambda: False,  # on_share ends it
    )


def _beside(folder: ResultFolder) -> Path:
    """Where that lies which a player shows and nobody downloads."""
    shown = folder.scratch("shown")
    shown.mkdir(exist_ok=True)
    return shown
