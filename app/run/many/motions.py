"""Folders, or zips, of motion files beside each other: each measure with an interval over clips.

Files at any depth are paired by name, without ``res_`` or ``gt_`` before it and ``_output`` behind.
Each clip is measured by one process, as it is, and its numbers are kept in ``clips``, so that a run
that was stopped goes on where it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import RunError, sentence_of
from app.run.diagnostics import onsets_of
from app.run.many.distances import (
    EmageDistances,
    check_weights,
    codes_path,
    emage_distances,
    keep_codes,
    moments_of,
    why_left_out,
)
from app.run.many.record import file_sha256, is_kept, keep, origin_of, read_records, stamp_of
from app.run.many.speeches import ENDINGS as SOUND_ENDINGS
from app.run.many.table import draw_spread, numbers_of, write_tables
from app.run.many.unpacked import unpacked_sets
from app.run.output.result_folder import held_folder, remove_unfinished
from conventions.names import REFERENCE_NAME, printable
from processes.job import Job
from processes.pool import JobPool

FORMAT = 3
"""Of a clip's record; another one is measured anew."""
ENDINGS = (".npz", ".npy", ".bvh")
GENERATED, RECORDED = "res_", "gt_"
"""How EMAGE's code and those after it begin the names of results, and of the recordings beside."""
OUTPUT = "_output"
"""How the results of its newer code end."""


@dataclass(frozen=True)
class ManyRequest:
    """Which folders to measure, beside what."""

    folders: tuple[Path, ...]
    out: Path
    reference: Path | None = None
    speech: Path | None = None
    """Folder of the clips' sound, for BeatAlign."""
    mean_speeds: Path | None = None
    """Published ones (`model.measures.beats.read_mean_speeds`)."""
    emage_weights: Path | None = None
    """Of EMAGE's encoder (`model.systems.autoencoders.emage`), for FGD as papers tell it."""
    fps: float | None = None
    rotations: Any = None
    names: tuple[str, ...] = ()
    """What to call the folders; by default as they are called."""
    leaves_out: bool = False
    """Whether a clip that cannot be read is left out and told of, rather than an error."""
    pool: JobPool = field(default_factory=JobPool)


@dataclass(frozen=True)
class ManyResult:
    """What was written, and must be said."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]
    clips: tuple[str, ...]
    measured: dict[str, dict[str, Path]]
    """By system, and the reference, the motion file of each of these clips."""
    sounds: dict[str, Path]
    """Of those clips that have one."""


def diagnose_folders(
    request: ManyRequest, on_progress: Callable[[float], None] = lambda share: None
) -> ManyResult:
    """Measure all clips that every folder has, and leave what `write_tables` writes in
    ``request.out``.

    Raises:
        RunError: where folders have no clip in common, a folder is none, or a zip is hostile.
        MotionError: for a file that cannot be read, once all others are measured; these are kept.
        CheckpointError: for weights that are not EMAGE's.
        JobsError: if those who measure are lost.
    """
    check_weights(request.emage_weights, request.reference)
    sets = [(path, ENDINGS) for path in (*request.folders, request.reference) if path is not None]
    sets += [(request.speech, SOUND_ENDINGS)] if request.speech is not None else []
    remove_unfinished(request.out)
    with held_folder(request.out), unpacked_sets(sets, request.out) as folders:
        return _diagnose_sets(_with_folders(request, folders), on_progress)


def _with_folders(request: ManyRequest, folders: dict[Path, Path]) -> ManyRequest:
    """What is asked, of what was unpacked."""

    def opened(path: Path | None) -> Path | None:
        return None if path is None else folders.get(path, path)

    return replace(
        request,
        folders=tuple(folders.get(path, path) for path in request.folders),
        reference=opened(request.reference),
        speech=opened(request.speech),
    )


def _diagnose_sets(request: ManyRequest, on_progress: Callable[[float], None]) -> ManyResult:
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
    sounds = _sounds(request)
    silent = [clip for clip in clips if clip not in sounds]
    if request.speech is not None and silent:
        notes.append(f"{len(silent)} of {len(clips)} clips have no sound of their name.")
    return _diagnose_clips(request, files, sounds, clips, notes, on_progress)


def _diagnose_clips(
    request: ManyRequest,
    files: dict[str, dict[str, Path]],
    sounds: dict[str, Path],
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
        beside = _Beside(
            *(
                path and path.absolute()
                for path in (sounds.get(clip), request.mean_speeds, request.emage_weights)
            )
        )
        said = request.fps, request.rotations
        stamp = stamp_of(of_clip | beside.files, [FORMAT, *said])
        jobs.append(
            Job(
                clip,
                partial(_is_measured, records[clip], stamp, beside),
                partial(_measure_clip, of_clip, beside, *said, records[clip], stamp),
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

    failed = request.pool.do_all(jobs, on_done)
    for error in failed.values():
        if not request.leaves_out or len(failed) == len(jobs) or sentence_of(error) is None:
            raise error
        notes.append(f"Left out: {sentence_of(error)}")
    clips = [clip for clip in clips if clip not in failed]
    records = {clip: records[clip] for clip in clips}
    numbers = list(read_records(records).values())
    by_emage = EmageDistances()
    if request.emage_weights is not None:
        frames = [each["frames"] for each in numbers]
        by_emage = emage_distances(list(files), dict(zip(records.values(), frames, strict=True)))
    origin = origin_of(list(files), clips, numbers, FORMAT, request.mean_speeds)
    written = write_tables(request.out, list(files), clips, numbers, origin, by_emage.rows)
    notes += filter(None, (why_left_out(numbers), by_emage.note))
    drawn, said = draw_spread(request.out, list(files), numbers)
    measured = {name: {clip: found[clip] for clip in clips} for name, found in files.items()}
    heard = {clip: sounds[clip] for clip in clips if clip in sounds}
    return ManyResult((*written, *drawn), (*notes, *said), tuple(clips), measured, heard)


def _named_folders(request: ManyRequest) -> dict[str, Path]:
    names = request.names or [folder.resolve().name for folder in request.folders]
    folders = dict(zip(map(printable, names), request.folders, strict=True))
    if len(folders) < len(request.folders) or REFERENCE_NAME in folders:
        raise RunError("Two folders have the same name, or one is called 'reference'; rename one.")
    if request.reference is not None:
        folders[REFERENCE_NAME] = request.reference
    wrong = next((folder for folder in folders.values() if not folder.is_dir()), None)
    if wrong is not None:
        raise RunError(f"{wrong} is no folder or zip; give sets only, or files only.")
    return folders


def _sounds(request: ManyRequest) -> dict[str, Path]:
    """By clip."""
    if request.mean_speeds is not None and request.speech is None:
        raise RunError("Mean speeds are of use with sound only; give both (--speech FOLDER).")
    if request.speech is None:
        return {}
    if not request.speech.is_dir():
        raise RunError(
            f"{request.speech} is no folder or zip; sets of motion go with a set of sound, "
            "whose files have the clips' names."
        )
    return _files(request.speech, RECORDED, SOUND_ENDINGS)


def _files(folder: Path, kind: str, endings: tuple[str, ...] = ENDINGS) -> dict[str, Path]:
    """By clip; where results and recordings lie side by side, those of the kind that is asked."""
    paths = sorted(
        path for path in folder.rglob("*") if _ends_in(endings, path.relative_to(folder))
    )
    if any(path.name.startswith(kind) for path in paths):
        paths = [path for path in paths if path.name.startswith(kind)]
    found: dict[str, Path] = {}
    for path in paths:
        stem = path.stem.removeprefix(GENERATED).removeprefix(RECORDED)
        name = printable(stem.removesuffix(OUTPUT) or stem)
        other = found.get(name, path)
        if (other.parent, other.stem) != (path.parent, path.stem):
            raise RunError(
                f"Two files in {folder} would both be called {name!r}: {other.relative_to(folder)} "
                f"and {path.relative_to(folder)}. Rename one."
            )
        found[name] = path
    return found


def _ends_in(endings: tuple[str, ...], path: Path) -> bool:
    is_hidden = any(part.startswith((".", "__MACOSX")) for part in path.parts)
    return path.suffix in endings and not is_hidden


@dataclass(frozen=True)
class _Beside:
    """What one clip's motions are measured with."""

    speech: Path | None
    mean_speeds: Path | None
    emage_weights: Path | None

    @property
    def files(self) -> dict[str, Path]:
        """By what they are."""
        named = {
            "its sound": self.speech,
            "mean speeds": self.mean_speeds,
            "EMAGE's encoder": self.emage_weights,
        }
        return {name: path for name, path in named.items() if path is not None}

    def heard(self) -> dict[str, Any]:
        """What `raw_evidence` is told of it."""
        from model.faults.timing import loudness_of
        from model.measures.beats import read_mean_speeds
        from model.speech.audio import load_speech

        if self.speech is None:
            return {}
        speech = load_speech(self.speech)
        return {
            "onsets_s": onsets_of(speech),
            "loudness": loudness_of(speech.waveform),
            "mean_speeds": self.mean_speeds and read_mean_speeds(self.mean_speeds),
        }


def _is_measured(record: Path, stamp: dict[str, Any], beside: _Beside) -> bool:
    has_codes = beside.emage_weights is None or codes_path(record).is_file()
    return has_codes and is_kept(record, stamp)


def _measure_clip(
    files: dict[str, Path],
    beside: _Beside,
    fps: float | None,
    rotations: Any,
    out: Path,
    stamp: dict[str, Any],
) -> None:
    """All systems of one clip beside its reference, over the frames that all have."""
    from model.diagnostics import raw_evidence
    from model.faults.table import find_faults
    from model.formats.read import read_any_motion
    from model.formats.reading import told_as
    from model.motion.kinematics import open_body_skeleton
    from model.motion.motion import first_frames

    said = told_as(fps, rotations)
    motions = {name: read_any_motion(path, said).motion for name, path in files.items()}
    heard = beside.heard()
    shortest = min(motion.num_frames for motion in motions.values())
    motions = {name: first_frames(motion, shortest) for name, motion in motions.items()}
    reference = None
    systems: dict[str, Any] = {}
    for name in sorted(motions, key=lambda name: name != REFERENCE_NAME):  # the reference first
        motion = motions[name]
        evidence = raw_evidence(motion, open_body_skeleton(), reference, **heard)
        told = numbers_of(evidence.raw, find_faults(evidence))
        kept = {"codes": moments_of(motion), "sha256": file_sha256(files[name])}
        systems[name] = told | kept
        if name == REFERENCE_NAME:
            reference = evidence
    if beside.emage_weights is not None:
        keep_codes(out, beside.emage_weights, motions)
    keep(out, stamp, {"frames": shortest, "systems": systems})
