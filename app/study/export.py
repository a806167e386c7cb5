"""Export of a study: from a plan to the participants' bundle and the researcher's folder."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from app.config import BUNDLED_WEIGHTS
from app.errors import RunError
from app.run.bodies import TrackedPoint
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.models import get_body, get_system
from app.run.output.result_folder import lock_folder, zip_folder
from app.run.requests.parts import VideoOptions
from app.run.videos.videos import Draw, PictureKey, draw_videos
from app.study.design.blinding import make_key, stimulus_ids
from app.study.design.key import Stimulus, StudyKey, read_key, write_key
from app.study.design.plan import Plan, read_plan
from app.study.design.trials import Design, make_design
from app.study.leaks import check_study
from app.study.make import media
from app.study.make.bundle import write_bundle, write_records
from app.study.make.motions import ClipInputs, read_clip_inputs, stimulus_motions
from app.study.make.workspace import ExportRequest, Workspace
from conventions.views import View
from model.motion.motion import Motion
from model.storage.files import file_sha256
from renderer.video.workers import run_render_jobs


def export_from_request(request: ExportRequest, callbacks: RunCallbacks) -> Workspace:
    """Export the study of a plan file and zip both folders, see `export_study`."""
    options = request.out, request.weights, request.body
    return zip_export(export_study(read_plan(request.plan), *options, callbacks), request)


def zip_export(workspace: Workspace, request: ExportRequest) -> Workspace:
    """Add the plan to the researcher's folder, and zip both folders."""
    shutil.copyfile(request.plan, workspace.private / request.plan.name)
    for folder, out in zip((workspace.bundle, workspace.private), request.zips, strict=True):
        zip_folder(folder, out)
    return workspace


def export_study(
    plan: Plan,
    out: Path,
    weights: Path = BUNDLED_WEIGHTS,
    body: Path | None = None,
    callbacks: RunCallbacks = NO_CALLBACKS,
    draw: Draw = run_render_jobs,
) -> Workspace:
    """Make ``out/participant_bundle`` and ``out/researcher_only``, or finish an interrupted export.

    The key is written before anything else and records which videos are finished. An export that is
    interrupted and started again with the same plan keeps both, and ends with the same bytes as an
    uninterrupted one.

    Args:
        body: a licensed SMPL-X npz; None is the open body.

    Raises:
        Cancelled: if the caller cancels; finished videos stay for the next run.
        RunError, SpeechError, MotionError, UnknownNameError, CheckpointError, BodyError, GLError,
        VideoError, WriteError: each with one sentence.
    """
    design = make_design(plan)
    sources = read_clip_inputs(plan)
    workspace = Workspace(out)
    inputs_digest = _fingerprint(plan, sources, weights, body)
    with lock_folder(out):
        workspace.open()
        key = _key(plan, design, workspace, inputs_digest)
        maker = _VideoMaker(plan, workspace, weights, body, draw, callbacks)
        key = maker.make_all(key, sources)
        write_bundle(plan, design, key, workspace)
        write_records(plan, design, key, sources, weights, body, workspace)
        workspace.remove_unfinished()
        leaks = check_study(out)
    if leaks:
        raise RunError(f"The export reveals which system a video shows: {leaks[0]}")
    return workspace


def _key(plan: Plan, design: Design, workspace: Workspace, inputs_digest: str) -> StudyKey:
    """Return the key of an earlier run, or write a new one before anything uses it."""
    if workspace.key.is_file():
        key = read_key(workspace.key)
        if key.inputs_digest != inputs_digest:
            raise RunError(
                f"{workspace.private.parent} contains the export of another plan, or the plan or "
                "one of its files was changed after that export. Export to a new folder."
            )
        return key
    key = replace(make_key(plan, design), inputs_digest=inputs_digest)
    write_key(key, workspace.key)
    return key


@dataclass(frozen=True)
class _VideoMaker:
    """Maker of a study's videos: generated, drawn with one camera, encoded alike and muxed."""

    plan: Plan
    workspace: Workspace
    weights: Path
    body: Path | None
    draw: Draw
    callbacks: RunCallbacks

    def make_all(self, key: StudyKey, sources: tuple[ClipInputs, ...]) -> StudyKey:
        """Make all missing videos, scene by scene (a clip from one view); return the updated key.

        The key is written after each scene, so that an interrupted export can be resumed.
        """
        names, video = stimulus_ids(key), self.workspace.video
        undone = {
            (stimulus.clip, stimulus.view)
            for stimulus, blind in names.items()
            if not video(blind).is_file() or file_sha256(video(blind)) != key.videos[blind].sha256
        }
        tracks = self._tracks(sources, {stimulus.speech for stimulus in names}) if undone else {}
        frames = {source.clip.name: source.num_frames for source in sources}
        whole, done = sum(frames[clip] for clip, _ in undone), 0.0
        for source in sources:
            clip = source.clip.name
            views: list[View] = [view for view in self.plan.views if (clip, view) in undone]
            arguments = source, self.weights, self.body, self.callbacks.should_cancel
            motions = stimulus_motions(self.plan, *arguments) if views else {}
            for view in views:
                tell = self.callbacks.progress_callback(
                    "video", source.num_frames / whole, done / whole
                )
                here = clip, view
                scene = {each: b for each, b in names.items() if (each.clip, each.view) == here}
                self._make_scene(view, scene, motions, tracks, tell)
                made = {
                    b: replace(key.videos[b], sha256=file_sha256(video(b))) for b in scene.values()
                }
                key = replace(key, videos={**key.videos, **made})
                write_key(key, self.workspace.key)
                done += source.num_frames
        self.callbacks.report_progress("video", 1.0)
        return key

    def _tracks(self, sources: tuple[ClipInputs, ...], speech: set[str | None]) -> dict[str, Path]:
        """Encode one audio track for each speech in ``speech``; return the paths by clip."""
        tracks = {}
        for number, source in enumerate(sources):
            if source.clip.name in speech and source.speech is not None:
                track = self.workspace.work / f"speech-{number}.m4a"
                media.encode_speech(source.speech.waveform, track, source.clip.name)
                tracks[source.clip.name] = track
        return tracks

    def _make_scene(
        self,
        view: View,
        scene: Mapping[Stimulus, str],
        motions: Mapping[str, Motion],
        tracks: Mapping[str, Path],
        on_progress: Callable[[float], None],
    ) -> None:
        """Make all videos of a clip from one view, with equal numbers of frames and bytes."""
        firsts: dict[str, str] = {}
        for stimulus, blind in scene.items():
            firsts[stimulus.system] = min(blind, firsts.get(stimulus.system, blind))
        # The rest of the bit rate is padding. Shares follow the blind names, which reveal nothing,
        # so that the padding reveals nothing either.
        ranked = sorted(firsts, key=lambda system: firsts[system])
        shares = {system: 1 - media.RATE_STEP * rank for rank, system in enumerate(ranked)}
        streams = self._streams(view, motions, shares, on_progress)
        for stimulus, blind in scene.items():
            track = tracks[stimulus.speech] if stimulus.speech else None
            media.mux_mp4(streams[stimulus.system], track, self.workspace.video(blind))
        media.pad_to_equal_size([self.workspace.video(blind) for blind in scene.values()])
        for stream in streams.values():
            stream.unlink()

    def _streams(
        self,
        view: View,
        motions: Mapping[str, Motion],
        shares: Mapping[str, float],
        on_progress: Callable[[float], None],
    ) -> dict[str, Path]:
        """Encode each system's picture as a stream; the n-th frames have equally many bytes."""
        video = VideoOptions(
            body=self.body, views=(view,), size=self.plan.size, framing="whole", close_ups=()
        )
        work = self.workspace.work
        drawn = {name: work / f"drawn-{n}.mp4" for n, name in enumerate(motions)}
        streams = {name: path.with_suffix(".h264") for name, path in drawn.items()}

        def encode(key: PictureKey) -> None:
            name, _ = key
            media.encode_video_stream(drawn[name], streams[name], self.plan.size, shares[name])
            drawn[name].unlink()

        draw_videos(
            motions,
            video,
            get_body(self.body),
            TrackedPoint(),
            lambda name, _: drawn[name],
            on_progress,
            on_done=encode,
            draw=partial(self.draw, should_cancel=self.callbacks.should_cancel),
            crf=0,  # encoded again later
        )
        media.equalise_frame_sizes(list(streams.values()))
        return streams


def _fingerprint(
    plan: Plan, sources: tuple[ClipInputs, ...], weights: Path, body: Path | None
) -> str:
    """Compute a digest of everything that determines the study.

    Raises:
        UnknownNameError: if a system or its speaker does not exist.
    """
    sha256s = {}
    for planned in plan.systems:
        if planned.system is not None:
            system = get_system(planned.system, weights)
            if planned.speaker is not None:
                system.speaker_index(planned.speaker)
            sha256s[system.name] = list(system.sha256s.values())
    facts = {
        "plan": asdict(plan),
        "files": {source.clip.name: dict(source.file_sha256s) for source in sources},
        "weights": sha256s,
        "body": file_sha256(body) if body else None,
    }
    # Paths may change from run to run; the contents of files are in the facts as digests.
    text = json.dumps(facts, sort_keys=True, default=lambda path: path.name)
    return hashlib.sha256(text.encode()).hexdigest()
