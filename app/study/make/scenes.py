"""Videos of a clip of a study: generated, drawn under one camera, encoded alike, joined."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from app.run.ask import Ask
from app.run.models import get_body
from app.run.videos.videos import draw_videos, picture_of
from app.study.design.key import Stimulus
from app.study.design.plan import Clip, Plan
from app.study.make import media
from app.study.make.motions import read_source, shown_motions
from app.study.make.mp4 import fill_alike
from app.study.make.workspace import ExportOptions, Workspace

if TYPE_CHECKING:
    from conventions.views import View
    from renderer.body.body import BodyMotion

Draw = Callable[..., object]
"""`app.run.videos.videos.draw_videos`, or what a test puts in its place."""


def never() -> bool:
    return False


@dataclass(frozen=True)
class Maker:
    """What clips are made with, wherever that is."""

    plan: Plan
    workspace: Workspace
    names: Mapping[Stimulus, str]
    """Blind ids."""
    options: ExportOptions
    draw: Draw = draw_videos
    should_cancel: Callable[[], bool] = never
    tracks: Mapping[str, Path] = field(default_factory=dict)
    """Encoded speech by clip."""

    def make(
        self,
        clip: Clip,
        views: Sequence[View],
        note: Path,
        on_progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        """Make all videos of the clip from these views, and note their ids once they are there.

        Raises:
            CancelledRun: when ``should_cancel`` said so.
            RunError, BodyError, GLError, VideoError: each with one sentence.
        """
        source = read_source(self.plan, clip)
        weights, body = self.options.weights, self.options.body
        motions = shown_motions(self.plan, source, weights, body, self.should_cancel)
        made: list[str] = []
        for number, view in enumerate(views):

            def tell(part: float, number: int = number) -> None:
                on_progress((number + part) / len(views))

            made += self._make_scene(clip, view, motions, tell)
        self.workspace.write_json(note, made)

    def _make_scene(
        self,
        clip: Clip,
        view: View,
        motions: Mapping[str, BodyMotion],
        on_progress: Callable[[float], None],
    ) -> list[str]:
        """All videos of a clip from one view, of equal length in frames and bytes; their ids."""
        of_scene = {
            stimulus: blind
            for stimulus, blind in self.names.items()
            if (stimulus.clip, stimulus.view) == (clip.name, view)
        }
        firsts: dict[str, str] = {}
        for stimulus, blind in of_scene.items():
            firsts[stimulus.system] = min(blind, firsts.get(stimulus.system, blind))
        # The rest of the bit rate is filled up. Shares follow the blind names, which tell nothing:
        # what is filled up then tells nothing either.
        ranked = sorted(firsts, key=lambda system: firsts[system])
        shares = {system: 1 - media.RATE_STEP * rank for rank, system in enumerate(ranked)}
        streams = self._streams(self.plan.clips.index(clip), view, motions, shares, on_progress)
        for stimulus, blind in of_scene.items():
            track = self.tracks[stimulus.speech] if stimulus.speech else None
            media.join(streams[stimulus.system], track, self.workspace.video(blind))
        media.pad_alike([self.workspace.video(blind) for blind in of_scene.values()])
        for stream in streams.values():
            stream.unlink()
        return list(of_scene.values())

    def _streams(
        self,
        number: int,
        view: View,
        motions: Mapping[str, BodyMotion],
        shares: Mapping[str, float],
        on_progress: Callable[[float], None],
    ) -> dict[str, Path]:
        """The picture of each system as a stream; the n-th pictures have equally many bytes."""
        from renderer.scene.stage import set_stage
        from renderer.video.workers import RenderJob

        asked = Ask(out=Path(), size=self.plan.size, framing="whole", close_ups=())
        settings = picture_of(asked, view, crf=0)  # encoded once more
        stage = set_stage(
            get_body(self.options.body), list(motions.values()), view, settings.aspect
        )
        work = self.workspace.work / f"clip-{number}"  # its own, since several may be made at once
        work.mkdir(exist_ok=True)
        drawn = {name: work / f"drawn-{n}.mp4" for n, name in enumerate(motions)}
        streams = {name: path.with_suffix(".h264") for name, path in drawn.items()}

        def encode(name: str) -> None:
            media.encode_picture(drawn[name], streams[name], self.plan.size, shares[name])
            drawn[name].unlink()

        self.draw(
            {
                name: RenderJob(
                    motion=motion,
                    out=drawn[name],
                    settings=settings,
                    body_path=self.options.body,
                    stage=stage,
                )
                for name, motion in motions.items()
            },
            on_progress=on_progress,
            on_done=encode,
            should_cancel=self.should_cancel,
            parallel=self.options.parallel,
        )
        fill_alike(list(streams.values()))
        return streams
