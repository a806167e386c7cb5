"""Runs opened from another run's folder or zip, which are always measured again."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from app.errors import RunError
from app.run.batch.archives import UnpackBudget, is_archive, unpack_archive
from app.run.batch.speech_batch import clip_requests, run_batch
from app.run.callbacks import RunCallbacks
from app.run.output.run_folder import (
    MAX_RUN_BYTES,
    NO_RUN,
    READABLE_BATCH_TABLES,
    RUN,
    existing_file,
    files_of_run,
    find_runs,
    is_run_zip,
    read_run,
    row_files,
)
from app.run.output.viewer_files import check_and_normalise_viewer_files
from app.run.requests.convert import replace_fields
from app.run.requests.parts import MAX_COMPARED, MAX_PAGE_CLIPS
from app.run.requests.requests import AnyRun, DiagnoseRequest, requested_systems
from app.run.upload_check import checked_total_s
from conventions.names import REFERENCE_NAME, printable
from processes.pool import JobPool

LIMITS = UnpackBudget(max_files=2_000, max_total_bytes=10**9, min_free_bytes=10**9)
"""Limits of a visitor's archive."""
ENDINGS = (".json", ".npz", ".wav")
ALL_ENDINGS = (*ENDINGS, ".frames", ".csv", ".md", ".tex", ".png", ".svg", ".pdf", ".mp4", ".jpg")
"""Suffixes of all files of a run, including those that are only viewed."""
UNPACKED_ZIP_FOLDER = "opened"
"""Folder next to the results in which a visitor's archive is unpacked during the run."""
RUN_ENDING = Path(RUN).suffix
SPEECH_FOLDER = "form"
"""Folder next to the results with the speech files of several clips."""


def run_page_request(request: AnyRun, callbacks: RunCallbacks) -> None:
    """Run a request, also one for a run's zip, or for several clips in the folder of the form.

    The motions in a zip are measured again. No list of paths is read, as it might name any file.
    Raises also if every clip has failed.
    """
    from app.run.models import make_job_pool
    from app.run.pipeline import run

    requests: dict[str, AnyRun] = {"": request}
    out, speech = request.output.out, request.speech.path
    pool = JobPool(1)
    if isinstance(request, DiagnoseRequest):
        if is_saved_run_zip(request.motions.motions):
            requests = {**reopen_requests(request, out.with_name(UNPACKED_ZIP_FOLDER))}
    elif speech == out.with_name(SPEECH_FOLDER):
        requests = {**clip_requests(request)}
        paths = [each.speech.path for each in requests.values() if each.speech.path]
        seconds = checked_total_s(paths, request.speech.max_speech_s)
        pool = make_job_pool(seconds * len(requested_systems(request)) * request.sampling.samples)
    if "" in requests:
        run(requests[""], callbacks)
        return
    done = run_batch(requests, pool, callbacks=callbacks)
    if not done.finished_clips:
        raise RunError(next(iter(done.failed.values())))


def is_saved_run_zip(motions: Sequence[Path]) -> bool:
    """Check whether the motions are a single zip of a run, or of those of several clips."""
    return len(motions) == 1 and is_run_zip(motions[0])


def reopen_requests(request: DiagnoseRequest, into: Path) -> dict[str, DiagnoseRequest]:
    """Return requests for the motions of a run's zip, by clip, or under "" for a single run.

    The zip is unpacked into ``into``, which must not exist.
    """
    runs = find_runs(open_run_folder(request.motions.motions[0], into))
    limit = request.motions.max_total_frames
    share = replace_fields(request, max_total_frames=limit and limit // len(runs))
    return {
        clip: replace_fields(_of_run(share, run), out=request.output.out / clip)
        for clip, run in runs.items()
    }


def _of_run(request: DiagnoseRequest, folder: Path) -> DiagnoseRequest:
    """Return the request for as many motions of a run as fit, with its speech, words and plans."""
    record, name = read_run(folder), printable(request.motions.motions[0].name)
    motions = row_files(folder, "motion")
    others = [each for each in motions if each != REFERENCE_NAME]
    if not others:
        raise RunError(NO_RUN.format(name=name, why="it has no motion"))
    shown = others[: MAX_COMPARED - (REFERENCE_NAME in motions)]
    speech = existing_file(folder, record.audio) if record.speech_sha256 else None
    return replace_fields(
        request,
        motions=tuple(motions[each] for each in shown),
        names=tuple(shown),
        reference=motions.get(REFERENCE_NAME),
        speech=speech,
        tracked_point=record.tracked_point,
        source_run=folder,
    )


def open_run_folder(
    path: Path, into: Path, endings: Sequence[str] = ENDINGS, limits: UnpackBudget = LIMITS
) -> Path:
    """Return the folder of a run, or the parent of several, unzipped; raises RunError."""
    folders = [path]
    if is_archive(path):
        into.mkdir(parents=True)
        _unpack_runs(path, into, endings, limits)
        folders = [into, *into.iterdir()]
    runs = next(filter(None, map(find_runs, folders)), {})
    if not runs:
        raise RunError(NO_RUN.format(name=printable(path.name), why=f"{RUN} is missing"))
    first = next(iter(runs.values()))
    return first if len(runs) == 1 else first.parent


def _unpack_runs(path: Path, into: Path, endings: Sequence[str], limits: UnpackBudget) -> None:
    """Unpack each ``run.json`` of a zip, and then the files that they name."""
    most = min(limits.max_total_bytes, MAX_PAGE_CLIPS * MAX_RUN_BYTES)
    unpack_archive(path, into, (RUN_ENDING,), replace(limits, max_total_bytes=most), _is_run)
    names: set[str] = set()
    for run in into.rglob(RUN):
        below, record = run.parent.relative_to(into), read_run(run.parent)
        of_rows = [name for row in record.rows for name in row.files.values()]
        own = filter(None, (*record.all_files, *of_rows, record.audio, record.timeline))
        names.update((below / name).as_posix() for name in own if name != RUN)
        names.update(
            (below.parent / name).as_posix() for name in READABLE_BATCH_TABLES if below.parts
        )
    unpack_archive(path, into, endings, replace(limits), names.__contains__)


def _is_run(path: str) -> bool:
    """Check whether a path in a zip is a possible ``run.json``."""
    parts = path.split("/")
    return parts[-1] == RUN and len(parts) <= 3


def copy_run(path: Path, into: Path) -> Path:
    """Copy a run of the page's owner, or its zip, to a new folder; raises RunError if damaged."""
    folder = open_run_folder(path, into / "unpacked", ALL_ENDINGS, UnpackBudget())
    for file in files_of_run(folder):
        copy = into / "results" / file.relative_to(folder)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    for run in find_runs(into / "results").values():
        check_and_normalise_viewer_files(run)
    return into / "results"
