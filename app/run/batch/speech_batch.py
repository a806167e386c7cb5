"""Runs over several speeches, in parallel processes or on a cluster.

Each run has the folder of a single run; its `run.json` finally records the digest of its inputs.
The same command, run again, continues with incomplete ones.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import RunError, message_for_user
from app.findings.verdict import make_verdict
from app.run.batch.pairing import is_visible_with_suffix, shorten_list
from app.run.batch.table import write_tables
from app.run.callbacks import NO_CALLBACKS, RunCallbacks, RunEvent, RunStage, StageProgress
from app.run.output.result_folder import lock_folder
from app.run.output.run_folder import RUN, RunRecord, read_run
from app.run.requests.convert import flat_public_fields, map_paths, replace_fields
from app.run.requests.requests import AnyRun, GenerateRequest
from app.run.upload_check import SOUNDS
from conventions.names import REFERENCE_NAME, pluralise, safe_file_stem
from processes.job import Job
from processes.pool import JobPool

LIST_ENDING = ".txt"
ENDINGS = SOUNDS


@dataclass(frozen=True)
class BatchResult:
    """Result of runs over several clips."""

    finished_clips: tuple[str, ...]
    """Names of finished clips."""
    num_reused: int
    """Number of clips that had been finished before."""
    failed: dict[str, str]
    """Sentence by failed clip."""
    table_files: tuple[Path, ...]
    """Tables over all clips."""
    notes: tuple[str, ...] = ()
    """Verdict over all clips."""


def is_speech_folder_or_list(speech: Path) -> bool:
    """Check whether a path is a folder or list of several speeches."""
    return speech.is_dir() or speech.suffix.lower() == LIST_ENDING


def clip_requests(request: GenerateRequest) -> dict[str, GenerateRequest]:
    """Return a request for each speech, by its file name.

    The speech of ``request`` is a folder of audio files, or a text file with one path per line.
    Raises RunError if no run can be started.
    """
    request.check()
    if request.imports.reference is not None or request.speech.transcript is not None:
        raise RunError(
            "A reference or a transcript belongs to a single recording and cannot be used with "
            "several; remove it. To compare with recorded motion, use `python -m app diagnose`."
        )
    speeches = find_speech_files(request.speech.path)
    plans, request = _plans(request.planning.plan, speeches), map_paths(request, Path.absolute)
    return {
        clip: replace_fields(
            request, speech=speech, out=request.output.out / clip, plan=plans.get(clip)
        )
        for clip, speech in speeches.items()
    }


def run_batch(
    requests: Mapping[str, AnyRun],
    pool: JobPool,
    on_done: Callable[[Path, float], None] = lambda folder, share: None,
    callbacks: RunCallbacks = NO_CALLBACKS,
) -> BatchResult:
    """Run each clip in its own folder, and write the tables and the verdict over finished ones.

    Args:
        on_done: called with the folder of each finished run, and the fraction done.
        callbacks: get the mean progress of all clips; no news of those that a cluster runs.

    Raises:
        Cancelled: if the caller has cancelled.
        JobsError: if the workers are lost; finished clips are kept.
    """
    jobs, out = [], next(iter(requests.values())).output.out.parent
    for clip, request in requests.items():
        stamp = _stamp(request)
        done = partial(_is_done, request.output.out, stamp)
        jobs.append(Job(clip, done, partial(_do_clip, request, stamp), takes_callbacks=True))
    with lock_folder(out):
        num_reused, failed = run_jobs(
            jobs,
            pool,
            lambda clip, share: on_done(requests[clip].output.out, share),
            on_message=_mean_progress(callbacks, len(jobs)),
            should_cancel=callbacks.should_cancel,
        )
        clips = [clip for clip in requests if clip not in failed]
        files: tuple[Path, ...] = ()
        notes: list[str] = []
        if clips:
            runs = [read_run(requests[clip].output.out) for clip in clips]
            verdict = make_verdict(runs[0].tracked_point, [run.metrics for run in runs])
            notes += [] if verdict is None else [verdict.text]
            names = sorted(runs[0].metrics, key=lambda name: name == REFERENCE_NAME)
            numbers = dict(zip(clips, map(_clip_results, runs), strict=True))
            files, _ = write_tables(out, names, numbers, notes, failed)
    return BatchResult(tuple(clips), num_reused, failed, files, tuple(notes))


def _mean_progress(callbacks: RunCallbacks, num_clips: int) -> Callable[[str, RunEvent], None]:
    """Return a callback for the events of clips that may run at the same time."""
    fractions: dict[tuple[RunStage, str], float] = {}

    def on_event(clip: str, event: RunEvent) -> None:
        if isinstance(event, StageProgress):
            fractions[event.stage, clip] = event.fraction
            done = sum(each for (stage, _), each in fractions.items() if stage == event.stage)
            event = StageProgress(event.stage, done / num_clips, clips_text=f"{num_clips} clips")
        callbacks.on_event(event)

    return on_event


def run_jobs(
    jobs: Sequence[Job], pool: JobPool, on_done: Callable[[str, float], None], **further: Any
) -> tuple[int, dict[str, str]]:
    """Run jobs, and return how many had been done before, and the errors of failed ones.

    ``on_done`` is called with the name of each finished job, and the fraction done.
    """
    num_done = num_reused = sum(job.is_done() for job in jobs)

    def tell(name: str) -> None:
        nonlocal num_done
        num_done += 1
        on_done(name, num_done / len(jobs))

    failed = pool.run_all(jobs, tell, **further)
    return num_reused, {name: _sentence(error) for name, error in failed.items()}


def find_speech_files(source: Path) -> dict[str, Path]:
    """Return the speech files by name, without hidden ones such as macOS's ``._a.wav``.

    The source is a folder of audio files, or a text file with one path per line, relative to it.
    Raises RunError if there is no file, one is missing, or two have the same name.
    """
    if source.is_dir():
        inside = sorted(path for path in source.iterdir() if path.is_file())
        listed = [path for path in inside if is_visible_with_suffix(ENDINGS, Path(path.name))]
        if not listed:
            raise RunError(f"{source} contains no audio files ({', '.join(ENDINGS)}).")
    else:
        listed = _listed(source)
    speeches: dict[str, Path] = {}
    for path in listed:
        name = safe_file_stem(path.stem)
        if name in speeches:
            raise RunError(
                f"{speeches[name]} and {path} have the same clip name {name!r}; rename one."
            )
        speeches[name] = path.absolute()
    return speeches


def _listed(source: Path) -> list[Path]:
    try:
        lines = [line.strip() for line in source.read_text("utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"The list {source} cannot be read: {error}.") from error
    paths = [source.parent / line for line in lines if line and line[0] != "#"]
    if not paths:
        raise RunError(f"{source} lists no audio files; write one path per line.")
    missing = [path for path in paths if not path.is_file()]
    if missing:
        files = "a file that does not exist" if len(missing) == 1 else "files that do not exist"
        raise RunError(f"{source} lists {files}: {shorten_list(map(str, missing))}.")
    return paths


def _plans(folder: Path | None, clips: Iterable[str]) -> dict[str, Path]:
    """Return the plan file of each clip, by its name; raises RunError without folder or plan."""
    from model.plan.files import ENDINGS as PLAN_ENDINGS

    if folder is None:
        return {}
    if not folder.is_dir():
        raise RunError(
            f"{folder} is not a folder; for several speeches, give a folder of plans named "
            f"like the speech files ({', '.join(PLAN_ENDINGS)})."
        )
    endings = tuple(ending.lower() for ending in PLAN_ENDINGS)
    plans = {
        safe_file_stem(path.stem): path.absolute()
        for path in sorted(folder.iterdir())
        if is_visible_with_suffix(endings, Path(path.name))
    }
    missing = [clip for clip in clips if clip not in plans]
    if missing:
        raise RunError(
            f"{folder} has no plan for {pluralise(len(missing), 'clip')}: {shorten_list(missing)}."
        )
    return plans


def _stamp(request: AnyRun) -> str:
    """Return the digest of the settings and files that determine a run's results.

    Locations are left out; see `inputs_stamp`.
    """
    read = {"speech": request.speech.path}
    if isinstance(request, GenerateRequest):
        read |= {"plan": request.planning.plan, "style": request.planning.style}
        weights = sorted(request.sampling.weights.glob("*.safetensors"))
    else:
        weights = []
    files = {name: path for name, path in read.items() if path is not None}
    files |= {path.name: path for path in weights}
    body = request.video.body
    fields = flat_public_fields(request) | {name: None for name in read}
    return inputs_stamp(files if body is None else files | {"body": body}, fields)


def inputs_stamp(files: Mapping[str, Path], settings: object) -> str:
    """Return a digest of settings, and of the names, sizes and modification times of files.

    The content of the files is not read: one that changes without size and time is not noticed.
    """
    of_files = {}
    for name, path in files.items():
        stat = path.stat()
        of_files[name] = [path.name, stat.st_size, stat.st_mtime_ns]
    digest_input = json.dumps({"said": settings, "files": of_files}, default=str, sort_keys=True)
    return hashlib.sha256(digest_input.encode()).hexdigest()


def _do_clip(
    request: AnyRun,
    stamp: str,
    on_event: Callable[[RunEvent], None],
    should_cancel: Callable[[], bool],
) -> None:
    from app.run import pipeline

    (request.output.out / RUN).unlink(missing_ok=True)  # of earlier files, which will be replaced
    pipeline.run(request, RunCallbacks(on_event, should_cancel))
    record = read_run(request.output.out)
    record.inputs_stamp = stamp
    record.write(request.output.out / RUN)


def _is_done(folder: Path, stamp: str) -> bool:
    try:
        return read_run(folder).inputs_stamp == stamp
    except RunError:
        return False


def _clip_results(run: RunRecord) -> dict[str, Any]:
    """Return the metrics and findings of one clip for the tables."""
    return {
        "systems": {
            name: {
                "numbers": of["raw"],
                "findings": [each.kind for each in run.findings if each.motion_name == name],
            }
            for name, of in run.metrics.items()
        }
    }


def _sentence(error: Exception) -> str:
    sentence = message_for_user(error)
    if sentence is None:
        raise error
    return sentence
