"""Videos of the scenes of a study: generated, drawn under one camera, encoded alike, joined."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.run.models import get_body
from app.run.pictures.export import render_settings
from app.run.pictures.videos import draw_videos
from app.study.design.plan import Plan
from app.study.design.trials import Stimulus
from app.study.make import media
from app.study.make.motions import Source, shown_motions
from app.study.make.workspace import Workspace

if TYPE_CHECKING:
    from app.run.request import View
    from renderer.body.body import BodyMotion

Draw = Callable[..., object]
"""`app.run.pictures.videos.draw_videos`, or what a test puts in its place."""


@dataclass(frozen=True)
class Maker:
    """What all scenes are made with."""

    plan: Plan
    workspace: Workspace
    names: Mapping[Stimulus, str]
    """Blind ids."""
    weights: Path
    body_path: Path | None
    should_cancel: Callable[[], bool]
    draw: Draw = draw_videos
    parallel: int = 2

    def make_all(self, sources: Sequence[Source], on_progress: Callable[[float], None]) -> None:
        """Make every video that is not there yet, clip after clip.

        Raises:
            CancelledRun: when ``should_cancel`` said so; finished scenes stay.
            RunError, BodyError, GLError, VideoError: each with one sentence.
        """
        missing = [source for source in sources if self._unfinished_views(source.clip.name)]
        total = sum(source.num_frames for source in missing)
        tracks = self._encode_speeches(sources) if missing else {}
        done = 0
        for source in missing:

            def tell(part: float, done: int = done, frames: int = source.num_frames) -> None:
                on_progress((done + part * frames) / total)

            self._make_clip(source, tracks, tell)
            done += source.num_frames
        on_progress(1.0)

    def _unfinished_views(self, clip: str) -> list[View]:
        return [
            view
            for view in self.plan.views
            if not all(
                self.workspace.has_video(blind)
                for stimulus, blind in self.names.items()
                if (stimulus.clip, stimulus.view) == (clip, view)
            )
        ]

    def _encode_speeches(self, sources: Sequence[Source]) -> dict[str, Path]:
        """One track for each speech that is heard."""
        heard = {stimulus.speech for stimulus in self.names}
        tracks = {}
        for number, source in enumerate(sources):
            if source.clip.name in heard and source.speech is not None:
                track = self.workspace.work / f"speech-{number}.m4a"
                media.encode_speech(source.speech.waveform, track, source.clip.name)
                tracks[source.clip.name] = track
        return tracks

    def _make_clip(
        self, source: Source, tracks: Mapping[str, Path], on_progress: Callable[[float], None]
    ) -> None:
        motions = shown_motions(self.plan, source, self.weights, self.body_path, self.should_cancel)
        views = self._unfinished_views(source.clip.name)
        for number, view in enumerate(views):

            def tell(part: float, number: int = number) -> None:
                on_progress((number + part) / len(views))

            self._make_scene(source, view, motions, tracks, tell)

    def _make_scene(
        self,
        source: Source,
        view: View,
        motions: Mapping[str, BodyMotion],
        tracks: Mapping[str, Path],
        on_progress: Callable[[float], None],
    ) -> None:
        """All videos of a clip from one view, of equal length in frames and bytes."""
        streams = self._streams(view, motions, on_progress)
        videos = {
            stimulus: self.workspace.video(blind)
            for stimulus, blind in self.names.items()
            if (stimulus.clip, stimulus.view) == (source.clip.name, view)
        }
        for stimulus, video in videos.items():
            track = tracks[stimulus.speech] if stimulus.speech else None
            media.join(streams[stimulus.system], track, video)
        media.pad_alike(list(videos.values()))
        self.workspace.finish_videos([self.names[stimulus] for stimulus in videos])
        for stream in streams.values():
            stream.unlink()

    def _streams(
        self, view: View, motions: Mapping[str, BodyMotion], on_progress: Callable[[float], None]
    ) -> dict[str, Path]:
        """The picture of each system as a stream; all have the same number of bytes."""
        from renderer.stage.stage import set_stage
        from renderer.video.pool import RenderJob

        settings = replace(render_settings(view, self.plan.size), crf=0)  # encoded once more
        stage = set_stage(get_body(self.body_path), list(motions.values()), view, settings.aspect)
        work = self.workspace.work
        drawn = {name: work / f"drawn-{number}.mp4" for number, name in enumerate(motions)}
        jobs = {
            name: RenderJob(
                motion=motion,
                out=drawn[name],
                settings=settings,
                body_path=self.body_path,
                stage=stage,
            )
            for name, motion in motions.items()
        }
        streams = {name: path.with_suffix(".h264") for name, path in drawn.items()}

        def encode(name: str) -> None:
            media.encode_picture(drawn[name], streams[name], self.plan.size)
            drawn[name].unlink()

        self.draw(
            jobs,
            on_progress=on_progress,
            on_done=encode,
            should_cancel=self.should_cancel,
            parallel=self.parallel,
        )
        media.fill_alike(list(streams.values()))
        return streams
