"""Folders of motion files beside each other: each measure with an interval over clips.

Files at any depth are paired by name, without ``res_`` or ``gt_`` before it. Each clip is measured
by one process, as it is, and its numbers are kept in ``clips``, so that a run that was stopped goes
on where it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.run.held_folder import held_folder
from app.run.many.record import is_kept, keep, read_records, stamp_of
from app.run.many.table import numbers_of, write_tables
from app.run.request import REFERENCE_NAME
from model.jobs.crew import Crew, Job
from model.storage.harmless import printable

ENDINGS = (".npz", ".npy", ".bvh")
GENERATED, RECORDED = "res_", "gt_"
"""How EMAGE's code and those after it begin the names of results, and of the recordings beside."""


@dataclass(frozen=True)
class ManyRequest:
    """Which folders to measure, beside what."""

    folders: tuple[Path, ...]
    out: Path
    reference: Path | None = None
    fps: float | None = None
    rotations: Any = None
    crew: Crew = field(default_factory=Crew)


@dataclass(frozen=True)
class ManyResult:
    """What was written, and must be said."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]
    clips: tuple[str, ...]


def diagnose_folders(
    request: ManyRequest, on_progress: Callable[[float], None] = lambda share: None
) -> ManyResult:
    """Measure all clips that every folder has, and leave what `write_tables` writes in
    ``request.out``.

    Raises:
        RunError: where folders have no clip in common, or a folder is none.
        MotionError: for a file that cannot be read, once all others are measured; these are kept.
        JobsError: if those who measure are lost.
    """
    folders = _named_folders(request)
    files = {
        name: _files(folder, RECORDED if name == REFERENCE_NAME else GENERATED)
        for name, folder in folders.items()
    }
    clips = sorted(set.intersection(*(set(found) for found in files.values())))
    if not clips:
        raise RunError(f"No file name is in all of {', '.join(files)}; clips are paired by name.")
    notes = [
        f"{name}: {len(found) - len(clips)} of {len(found)} files have no partner of that name."
        for name, found in files.items()
        if len(found) > len(clips)
    ]
    with held_folder(request.out):
        return _diagnose_clips(request, files, clips, notes, on_progress)


def _diagnose_clips(
    request: ManyRequest,
    files: dict[str, dict[str, Path]],
    clips: list[str],
    notes: list[str],
    on_progress: Callable[[float], None],
) -> ManyResult:
    kept = request.out / "clips"
    kept.mkdir(parents=True, exist_ok=True)
    records = {clip: (kept / f"{clip}.json").absolute() for clip in clips}
    jobs = []
    for clip in clips:
        of_clip = {name: found[clip].absolute() for name, found in files.items()}
        stamp = stamp_of(of_clip, [request.fps, request.rotations])
        said = request.fps, request.rotations
        jobs.append(
            Job(
                clip,
                partial(is_kept, records[clip], stamp),
                partial(_measure_clip, of_clip, *said, records[clip], stamp),
            )
        )
    known = sum(job.is_done() for job in jobs)
    if known:
        notes.append(f"{known} clips had been measured before and were kept.")
    done = known

    def on_done(clip: str) -> None:
        nonlocal done
        done += 1
        on_progress(done / len(jobs))

    for error in request.crew.do_all(jobs, on_done).values():
        raise error
    numbers = list(read_records(records).values())
    written = write_tables(request.out, list(files), clips, numbers)
    return ManyResult(written, tuple(notes), tuple(clips))


def _named_folders(request: ManyRequest) -> dict[str, Path]:
    folders = {printable(folder.resolve().name): folder for folder in request.folders}
    if len(folders) < len(request.folders) or REFERENCE_NAME in folders:
        raise RunError("Two folders have the same name, or one is called 'reference'; rename one.")
    if request.reference is not None:
        folders[REFERENCE_NAME] = request.reference
    wrong = next((folder for folder in folders.values() if not folder.is_dir()), None)
    if wrong is not None:
        raise RunError(f"{wrong} is no folder; give folders only, or files only.")
    return folders


def _files(folder: Path, kind: str) -> dict[str, Path]:
    """By clip; where results and recordings lie side by side, those of the kind that is asked."""
    paths = sorted(path for path in folder.rglob("*") if _is_motion(path.relative_to(folder)))
    if any(path.name.startswith(kind) for path in paths):
        paths = [path for path in paths if path.name.startswith(kind)]
    found: dict[str, Path] = {}
    for path in paths:
        name = printable(path.stem.removeprefix(GENERATED).removeprefix(RECORDED))
        other = found.get(name, path)
        if (other.parent, other.stem) != (path.parent, path.stem):
            raise RunError(
                f"Two files in {folder} would both be called {name!r}: {other.relative_to(folder)} "
                f"and {path.relative_to(folder)}. Rename one."
            )
        found[name] = path
    return found


def _is_motion(path: Path) -> bool:
    is_hidden = any(part.startswith((".", "__MACOSX")) for part in path.parts)
    return path.suffix in ENDINGS and not is_hidden


def _measure_clip(
    files: dict[str, Path], fps: float | None, rotations: Any, out: Path, stamp: dict[str, Any]
) -> None:
    """All systems of one clip beside its reference, over the frames that all have."""
    from model.formats.numbers import ReadOptions
    from model.formats.read import read_any_motion
    from model.measures.diagnostics import raw_evidence
    from model.measures.faults.table import find_faults
    from model.motion.motion import first_frames
    from model.motion.skeleton import open_body_skeleton

    said = ReadOptions(fps, rotations)
    motions = {name: read_any_motion(path, said).motion for name, path in files.items()}
    shortest = min(motion.num_frames for motion in motions.values())
    reference = None
    systems: dict[str, Any] = {}
    for name in sorted(motions, key=lambda name: name != REFERENCE_NAME):  # the reference first
        motion = first_frames(motions[name], shortest)
        evidence = raw_evidence(motion, open_body_skeleton(), reference)
        systems[name] = numbers_of(evidence.raw, find_faults(evidence))
        if name == REFERENCE_NAME:
            reference = evidence
    keep(out, stamp, {"frames": shortest, "systems": systems})
