"""The standard videos of a run that has ended: drawn behind the stage, from what it left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from app.run.followed_point import TIP, choose_tip_source
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.output.telling import Reporter, share_teller
from app.run.requests.request import MAX_COMPARED, OnEvent, ShouldCancel
from app.run.videos.comparison import joined_side_by_side
from app.run.videos.own_videos import VideoOptions, draw_own_videos, picture_motions
from conventions.names import REFERENCE_NAME


@dataclass(frozen=True)
class VideosRequest:
    """Videos of some motions, all alike, and one of them side by side."""

    motions: Mapping[str, Path]
    """Motion files by row, in the order of the page; a reference comes last."""
    out: Path
    speech: Path | None = None
    """A wav; None leaves the videos silent."""
    joint: str = TIP
    """What the trail follows."""
    body: Path | None = None
    options: VideoOptions = field(default_factory=VideoOptions)

    def within(self, folder: Path) -> VideosRequest:
        """The same in a folder of its own."""
        return replace(self, out=folder / "results")


def draw_behind(
    request: VideosRequest, on_event: OnEvent, should_cancel: ShouldCancel
) -> tuple[Path, ...]:
    """Draw the videos and ``comparison.mp4``; each is told of as soon as it is whole.

    Returns:
        The files, none of them where the work was ended.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        MotionError, BodyError, GLError, VideoError: each with one sentence.
    """
    from model.motion.motion import load_motion

    reporter = Reporter(on_event, should_cancel)
    motions = {name: load_motion(path) for name, path in request.motions.items()}
    body = get_body(request.body)
    tip = choose_tip_source(body, request.body, request.joint)
    with ResultFolder(request.out) as folder:
        draw_own_videos(
            *(picture_motions(motions).motions, request.options, body, request.body, tip),
            *(request.speech, folder),
            share_teller("video", on_event, should_cancel),
            on_event,
        )
        if len(motions) > 1:
            names = names_that_fit(list(motions))
            with joined_side_by_side(names, request.speech, folder, reporter):
                pass
        return folder.publish()


def names_that_fit(names: list[str]) -> list[str]:
    """As many as stand side by side, the reference among them."""
    reference = [name for name in names if name == REFERENCE_NAME]
    systems = [name for name in names if name != REFERENCE_NAME]
    return [*systems[: MAX_COMPARED - len(reference)], *reference]
