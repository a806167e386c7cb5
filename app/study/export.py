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
from app.run.bodies import PointTracker
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.models import get_body, get_system
from app.run.output.result_folder import lock_folder, zip_folder
from app.run.requests.parts import VideoOptions
from app.run.videos.videos import Draw, PictureKey, draw_videos
from app.study.design.blinding import make_key, stimulus_ids
from app.study.design.key import Stimulus, StudyKey, read_key, write_key
from app.study.design.plan import StudyPlan, read_study_plan
from app.study.design.trials import Design, make_design
from app.study.leaks import find_leaks
from app.study.make import media
from app.study.make.bundle import finish_bundle, write_records
from app.study.make.export_folders import ExportFolders, ExportRequest
from app.study.make.motions import ClipInputs, make_clip_motions, read_all_clip_inputs
from conventions.views import View
from model.motion.motion import Motion
from model.storage.files import file_sha256
from renderer.video.workers import run_render_jobs


def export_from_request(request: ExportRequest, callbacks: RunCallbacks) -> ExportFolders:
    """Export the study of a plan file and zip both folders, see `export_study`."""
    options = request.out, request.weights, request.body
    return add_plan_and_zip(
        export_study(read_study_plan(request.plan), *options, callbacks), request
    )


def add_plan_and_zip(folders: ExportFolders, request: ExportRequest) -> ExportFolders:
    """Add the plan to the researcher's folder, and zip both folders."""
    shutil.copyfile(request.plan, folders.private / request.plan.name)
    for folder, out in zip((folders.bundle, folders.private), request.zips, strict=True):
        zip_folder(folder, out)
    return folders


def export_study(
    plan: StudyPlan,
    out: Path,
    weights: Path = BUNDLED_WEIGHTS,
    body: Path | None = None,
    callbacks: RunCallbacks = NO_CALLBACKS,
    draw: Draw = run_render_jobs,
) -> ExportFolders:
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
    sources = read_all_clip_inputs(plan)
    folders = ExportFolders(out)
    inputs_digest = _fingerprint(plan, sources, weights, body)
    with lock_folder(out):
        folders.prepare()
        key = _key(plan, design, folders, inputs_digest)
        maker = _VideoMaker(plan, folders, weights, body, draw, callbacks)
        key = maker.make_all(key, sources)
        finish_bundle(plan, design, key, folders)
        write_records(plan, design, key, sources, weights, body, folders)
        folders.remove_unfinished()
        leaks = find_leaks(out)
    if leaks:
        raise RunError(f"The export did not pass the blinding check: {leaks[0]}")
    return folders


def _key(plan: StudyPlan, design: Design, folders: ExportFolders, inputs_digest: str) -> StudyKey:
    """Return the key of an earlier run, or write a new one before anything uses it."""
    if folders.key.is_file():
        key = read_key(folders.key)
        if key.inputs_digest != inputs_digest:
            raise RunError(
                f"{folders.private.parent} contains the export of another plan, or the plan or "
                "one of its files was changed after that export. Export to a new folder."
            )
        return key
    key = replace(make_key(plan, design), inputs_digest=inputs_digest)
    write_key(key, folders.key)
    return key


@dataclass(frozen=True)
class _VideoMaker:
    """Maker of a study's videos: generated, drawn with one camera, encoded alike and muxed."""

    plan: StudyPlan
    folders: ExportFolders
    weights: Path
    body: Path | None
    draw: Draw
    callbacks: RunCallbacks

    def make_all(self, key: StudyKey, sources: tuple[ClipInputs, ...]) -> StudyKey:
        """Make all missing videos, scene by scene (a clip from one view); return the updated key.

        The key is written after each scene, so that an interrupted export can be resumed.
        """
        names, video = stimulus_ids(key), self.folders.video
        undone = {
            (stimulus.clip, stimulus.view)
            for stimulus, blind in names.items()
            if not video(blind).is_file() or file_sha256(video(blind)) != key.videos[blind].sha256
        }
        tracks = (
            self._tracks(sources, {stimulus.speech_clip for stimulus in names}) if undone else {}
        )
        frames = {source.clip.name: source.num_frames for source in sources}
        whole, done = sum(frames[clip] for clip, _ in undone), 0.0
        for source in sources:
            clip = source.clip.name
            views: list[View] = [view for view in self.plan.views if (clip, view) in undone]
            arguments = source, self.weights, self.body, self.callbacks.should_cancel
            motions = make_clip_motions(self.plan, *arguments) if views else {}
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
                write_key(key, self.folders.key)
                done += source.num_frames
        self.callbacks.report_progress("video", 1.0)
        return key

    def _tracks(self, sources: tuple[ClipInputs, ...], speech: set[str | None]) -> dict[str, Path]:
        """Encode one audio track for each speech in ``speech``; return the paths by clip."""
        tracks = {}
        for number, source in enumerate(sources):
            if source.clip.name in speech and source.speech is not None:
                track = self.folders.work / f"speech-{number}.m4a"
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
        shares = {
            system: 1 - media.RATE_STEP_BETWEEN_VIDEOS * rank for rank, system in enumerate(ranked)
        }
        streams = self._streams(view, motions, shares, on_progress)
        for stimulus, blind in scene.items():
            track = tracks[stimulus.speech_clip] if stimulus.speech_clip else None
            media.mux_mp4(streams[stimulus.system], track, self.folders.video(blind))
        media.pad_to_equal_bytes([self.folders.video(blind) for blind in scene.values()])
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
            body=self.body,
            views=(view,),
            picture_height_px=self.plan.video_size_px,
            framing="whole",
            close_ups=(),
        )
        work = self.folders.work
        drawn = {name: work / f"drawn-{n}.mp4" for n, name in enumerate(motions)}
        streams = {name: path.with_suffix(".h264") for name, path in drawn.items()}

        def encode(key: PictureKey) -> None:
            name, _ = key
            media.encode_video_stream(
                drawn[name], streams[name], self.plan.video_size_px, shares[name]
            )
            drawn[name].unlink()

        draw_videos(
            motions,
            video,
            get_body(self.body),
            PointTracker(),
            lambda name, _: drawn[name],
            on_progress,
            on_done=encode,
            draw=partial(self.draw, should_cancel=self.callbacks.should_cancel),
            crf=0,  # encoded again later
        )
        media.equalise_frame_bytes(list(streams.values()))
        return streams


def _fingerprint(
    plan: StudyPlan, sources: tuple[ClipInputs, ...], weights: Path, body: Path | None
) -> str:
    """Compute a digest of all that determines the study; raises UnknownNameError."""
    sha256s = {}
    for planned in plan.conditions:
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
