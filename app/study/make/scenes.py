"""Videos of the scenes of a study: generated, drawn under one camera, encoded alike, joined."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from app.run.models import get_body
from app.run.videos.export import render_settings
from app.run.videos.videos import draw_videos
from app.study.design.plan import Clip, Plan
from app.study.design.trials import Stimulus
from app.study.make import media
from app.study.make.motions import Source, read_source, shown_motions
from app.study.make.mp4 import fill_alike
from app.study.make.workspace import Workspace
from processes.job import Job
from processes.pool import JobPool

if TYPE_CHECKING:
    from conventions.views import View
    from renderer.body.body import BodyMotion

Draw = Callable[..., object]
"""`app.run.videos.videos.draw_videos`, or what a test puts in its place."""


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

            self._make_clip(source, tracks, tell, self.workspace.finish_videos)
            done += source.num_frames
        on_progress(1.0)

    def make_shared(
        self, sources: Sequence[Source], pool: JobPool, on_progress: Callable[[float], None]
    ) -> None:
        """As `make_all`, with the clips shared out among those who work.

        Raises:
            JobsError: if they are lost.
            Exception: what a clip could not be made for, once all others are.
        """
        notes = self.workspace.notes
        notes.mkdir(exist_ok=True)
        for note in notes.glob("*.json"):  # by workers whose export was killed before it heard
            self._take_note(note)
        missing = [source for source in sources if self._unfinished_views(source.clip.name)]
        tracks = self._encode_speeches(sources) if missing else {}
        alone = replace(self, should_cancel=_never, parallel=1)
        jobs: list[Job] = []
        made: dict[str, Path] = {}
        for source in missing:
            clip = source.clip
            note = notes / f"{self.plan.clips.index(clip)}.json"
            made[clip.name] = note
            work = partial(_make_one, alone, clip, tracks, note)
            jobs.append(Job(clip.name, note.is_file, work))
        done = 0

        def on_done(clip: str) -> None:
            nonlocal done
            self._take_note(made[clip])
            done += 1
            on_progress(done / len(jobs))

        for error in pool.do_all(jobs, on_done).values():
            raise error

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

    def _take_note(self, note: Path) -> None:
        blinds = json.loads(note.read_text())
        if all(self.workspace.video(blind).is_file() for blind in blinds):
            self.workspace.finish_videos(blinds)
        note.unlink()

    def _make_clip(
        self,
        source: Source,
        tracks: Mapping[str, Path],
        on_progress: Callable[[float], None],
        on_made: Callable[[list[str]], None],
    ) -> None:
        """
        Args:
            on_made: told the blind ids of each scene that is there.
        """
        motions = shown_motions(self.plan, source, self.weights, self.body_path, self.should_cancel)
        views = self._unfinished_views(source.clip.name)
        for number, view in enumerate(views):

            def tell(part: float, number: int = number) -> None:
                on_progress((number + part) / len(views))

            on_made(self._make_scene(source, view, motions, tracks, tell))

    def _make_scene(
        self,
        source: Source,
        view: View,
        motions: Mapping[str, BodyMotion],
        tracks: Mapping[str, Path],
        on_progress: Callable[[float], None],
    ) -> list[str]:
        """All videos of a clip from one view, of equal length in frames and bytes; their ids."""
        streams = self._streams(source.clip.name, view, motions, on_progress)
        videos = {
            stimulus: self.workspace.video(blind)
            for stimulus, blind in self.names.items()
            if (stimulus.clip, stimulus.view) == (source.clip.name, view)
        }
        for stimulus, video in videos.items():
            track = tracks[stimulus.speech] if stimulus.speech else None
            media.join(streams[stimulus.system], track, video)
        media.pad_alike(list(videos.values()))
        for stream in streams.values():
            stream.unlink()
        return [self.names[stimulus] for stimulus in videos]

    def _scratch(self, clip: str) -> Path:
        """A folder of the clip's own, since several may be made at once."""
        number = next(i for i, each in enumerate(self.plan.clips) if each.name == clip)
        folder = self.workspace.work / f"clip-{number}"
        folder.mkdir(exist_ok=True)
        return folder

    def _shares(self, clip: str, view: str) -> dict[str, float]:
        """Of the bit rate, by system; the rest is filled up. They follow the blind names, which
        tell nothing: what is filled up then tells nothing either."""
        firsts: dict[str, str] = {}
        for stimulus, blind in self.names.items():
            if (stimulus.clip, stimulus.view) == (clip, view):
                firsts[stimulus.system] = min(blind, firsts.get(stimulus.system, blind))
        ranked = sorted(firsts, key=lambda system: firsts[system])
        return {system: 1 - media.RATE_STEP * rank for rank, system in enumerate(ranked)}

    def _streams(
        self,
        clip: str,
        view: View,
        motions: Mapping[str, BodyMotion],
        on_progress: Callable[[float], None],
    ) -> dict[str, Path]:
        """The picture of each system as a stream; the n-th pictures have equally many bytes."""
        from renderer.scene.stage import set_stage
        from renderer.video.worker_process import RenderJob

        settings = replace(render_settings(view, self.plan.size), crf=0)  # encoded once more
        stage = set_stage(get_body(self.body_path), list(motions.values()), view, settings.aspect)
        work = self._scratch(clip)
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

        shares = self._shares(clip, view)

        def encode(name: str) -> None:
            media.encode_picture(drawn[name], streams[name], self.plan.size, shares[name])
            drawn[name].unlink()

        self.draw(
            jobs,
            on_progress=on_progress,
            on_done=encode,
            should_cancel=self.should_cancel,
            parallel=self.parallel,
        )
        fill_alike(list(streams.values()))
        return streams


def _make_one(maker: Maker, clip: Clip, tracks: Mapping[str, Path], note: Path) -> None:
    """Make all videos of a clip that are not there, wherever this is, and note their ids: the
    export alone writes down what is finished."""
    made: list[str] = []
    maker._make_clip(read_source(maker.plan, clip), tracks, lambda share: None, made.extend)
    maker.workspace.write_json(note, made)


def _never() -> bool:
    return False
