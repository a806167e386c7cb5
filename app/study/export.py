"""From a plan to the bundle for participants and the folder for the researcher."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from app.errors import RunError
from app.run.ask import OnEvent, ShouldCancel
from app.run.models import get_system
from app.run.output.result_folder import held_folder, zip_folder
from app.run.output.telling import Reporter
from app.run.videos.videos import draw_videos
from app.study.design.blinding import make_key, stimuli_of
from app.study.design.key import Key, read_key, write_key
from app.study.design.plan import Plan, read_plan
from app.study.design.trials import Design, make_design
from app.study.leaks import check_study
from app.study.make import media
from app.study.make.bundle import write_bundle, write_records
from app.study.make.motions import Source, read_sources
from app.study.make.scenes import Draw, Maker, never
from app.study.make.workspace import ExportOptions, Workspace, sha256
from conventions.views import View
from processes.job import Job
from processes.pool import JobPool


@dataclass(frozen=True)
class ExportRequest:
    """A study that is to be made of the plan in a file."""

    plan: Path
    out: Path
    options: ExportOptions
    zips: tuple[Path, Path] | None = None
    """Where the participants' part goes as a zip, and the researcher's with the plan."""


def export_planned(
    request: ExportRequest, on_event: OnEvent, should_cancel: ShouldCancel, draw: Draw = draw_videos
) -> Workspace:
    """As `export_study`."""
    made = export_study(
        read_plan(request.plan),
        request.out,
        request.options,
        on_progress=Reporter(on_event, should_cancel).share("video"),
        should_cancel=should_cancel,
        draw=draw,
    )
    return zipped(made, request)


def zipped(made: Workspace, request: ExportRequest) -> Workspace:
    """With the zips that were asked for."""
    if request.zips is not None:
        shutil.copyfile(request.plan, made.private / request.plan.name)
        for folder, out in zip((made.bundle, made.private), request.zips, strict=True):
            zip_folder(folder, out)
    return made


def export_study(
    plan: Plan,
    out: Path,
    options: ExportOptions | None = None,
    *,
    on_progress: Callable[[float], None] = lambda fraction: None,
    should_cancel: Callable[[], bool] = lambda: False,
    draw: Draw = draw_videos,
) -> Workspace:
    """Make ``out/participant_bundle`` and ``out/researcher_only``, or finish making them.

    The key is written before anything else, and knows which videos are finished. A run that is
    stopped and started again with the same plan keeps both, and ends with the same bytes as one
    that was not.

    Args:
        on_progress: called with the share done, 0 to 1.

    Raises:
        CancelledRun: when ``should_cancel`` said so; what is finished stays for the next run.
        RunError, SpeechError, MotionError, UnknownNameError, CheckpointError, BodyError, GLError,
        VideoError, WriteError: each with one sentence.
    """
    options = options or ExportOptions()
    design = make_design(plan)
    sources = read_sources(plan)
    workspace = Workspace(out.absolute() if options.pool else out)
    made_of = _fingerprint(plan, sources, options)
    with held_folder(out):
        workspace.open()
        key = _key(plan, design, workspace, made_of)
        maker = Maker(plan, workspace, stimuli_of(key), options, draw, should_cancel)
        key = _make_videos(maker, key, sources, on_progress)
        write_bundle(plan, design, key, workspace)
        write_records(plan, design, key, sources, options, workspace)
        workspace.clean()
        leaks = check_study(out)
    if leaks:
        raise RunError(f"The export is not blind: {leaks[0]}")
    return workspace


def _key(plan: Plan, design: Design, workspace: Workspace, made_of: str) -> Key:
    """That of an earlier run, or a new one, which is kept before anything uses it."""
    if workspace.key.is_file():
        key = read_key(workspace.key)
        if key.made_of != made_of:
            raise RunError(
                f"{workspace.private.parent} holds the export of another plan, or the plan or a "
                "file that it names has changed; export to a new folder."
            )
        return key
    key = replace(make_key(plan, design), made_of=made_of)
    write_key(key, workspace.key)
    return key


def _make_videos(
    maker: Maker, key: Key, sources: tuple[Source, ...], on_progress: Callable[[float], None]
) -> Key:
    """Make every video that is not there yet, clip after clip or shared out among those who work;
    the key that knows them."""
    plan, workspace = maker.plan, maker.workspace

    def take(note: Path) -> None:
        nonlocal key
        videos = dict(key.videos)
        for blind in json.loads(note.read_text()):
            if workspace.video(blind).is_file():
                videos[blind] = replace(videos[blind], sha256=sha256(workspace.video(blind)))
        key = replace(key, videos=videos)
        write_key(key, workspace.key)
        note.unlink()

    for note in workspace.notes.glob("*.json"):  # of an export that was killed before it heard
        take(note)
    undone = {
        (stimulus.clip, stimulus.view)
        for stimulus, blind in maker.names.items()
        if not (path := workspace.video(blind)).is_file()
        or sha256(path) != key.videos[blind].sha256
    }
    missing: dict[Source, tuple[View, ...]] = {
        source: tuple(view for view in plan.views if (source.clip.name, view) in undone)
        for source in sources
        if source.clip.name in {clip for clip, _ in undone}
    }
    if missing:
        maker = replace(maker, tracks=_tracks(maker, sources))
    notes = {source.clip.name: workspace.notes / f"{n}.json" for n, source in enumerate(sources)}
    frames = {source.clip.name: source.num_frames for source in missing}
    done = 0.0

    def tell(clip: str, share: float) -> None:
        on_progress((done + share * frames[clip]) / sum(frames.values()))

    def on_done(clip: str) -> None:
        nonlocal done
        take(notes[clip])
        tell(clip, 1.0)
        done += frames[clip]

    is_here, make = maker.options.pool is None, maker.make
    if not is_here:  # where nobody hears or cancels
        alone = replace(maker.options, parallel=1, pool=None)
        make = replace(maker, options=alone, should_cancel=never).make
    jobs = []
    for source, views in missing.items():
        name = source.clip.name
        heard = {"on_progress": partial(tell, name)} if is_here else {}
        work = partial(make, source.clip, views, notes[name], **heard)
        jobs.append(Job(name, notes[name].is_file, work))
    pool = maker.options.pool or JobPool(1, is_patient=False)
    for error in pool.do_all(jobs, on_done).values():
        raise error
    if not missing:
        on_progress(1.0)
    return key


def _tracks(maker: Maker, sources: tuple[Source, ...]) -> dict[str, Path]:
    """One track for each speech that is heard."""
    heard = {stimulus.speech for stimulus in maker.names}
    tracks = {}
    for number, source in enumerate(sources):
        if source.clip.name in heard and source.speech is not None:
            track = maker.workspace.work / f"speech-{number}.m4a"
            media.encode_speech(source.speech.waveform, track, source.clip.name)
            tracks[source.clip.name] = track
    return tracks


def _fingerprint(plan: Plan, sources: tuple[Source, ...], options: ExportOptions) -> str:
    """Of everything that decides what the study is.

    Raises:
        UnknownNameError: if a system or its speaker does not exist.
    """
    weights = {}
    for planned in plan.systems:
        if planned.system is not None:
            system = get_system(planned.system, options.weights)
            if planned.speaker is not None:
                system.speaker_index(planned.speaker)
            weights[system.name] = list(system.sha256s.values())
    facts = {
        "plan": asdict(plan),
        "files": {source.clip.name: dict(source.files) for source in sources},
        "weights": weights,
        "body": sha256(options.body) if options.body else None,
    }
    # Where files lie may change from run to run; what they hold is among the facts.
    text = json.dumps(facts, sort_keys=True, default=lambda path: path.name)
    return hashlib.sha256(text.encode()).hexdigest()
