"""Folders, or zips, of motion files beside each other: each measure with an interval over clips.

Files at any depth are paired by clip and sample (`app.run.many.pairing`). Each clip is measured by
one process, as it is, and its numbers, means over its samples, are kept in ``clips``, so that a run
that was stopped goes on where it was. A clip of which some set has no file that can be read is left
out of the tables, and told of.
"""

from __future__ import annotations

import datetime
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.errors import RunError, sentence_of
from app.findings.measure_rows import numbers_of
from app.run.ask import Ask, OnEvent, ShouldCancel
from app.run.diagnostics import onsets_of
from app.run.many.assumed import assumed_in, told_above, without_what_lacks
from app.run.many.distances import (
    EmageDistances,
    check_weights,
    codes_path,
    emage_distances,
    keep_codes,
    moments_of,
    why_left_out,
)
from app.run.many.pairing import Samples, first_of, no_pair, paired_files, some_of
from app.run.many.speeches import ENDINGS as SOUND_ENDINGS
from app.run.many.speeches import stamp_of
from app.run.many.table import Above, draw_spread, mean_of_samples, write_tables
from app.run.many.unpacked import UnpackLimits, unpack_sets, unpacked_sets
from app.run.output.result_folder import held_folder, remove_unfinished
from app.run.output.telling import Reporter
from conventions.names import REFERENCE_NAME, printable
from model.formats.read import ENDINGS, MOTIONS, REFERENCE, Assumptions, Reading
from model.storage.cards import BUNDLED_WEIGHTS, load_card
from model.storage.files import file_sha256, written_atomically
from processes.job import Job
from processes.pool import JobPool

if TYPE_CHECKING:
    from model.motion.motion import Motion

FORMAT = 5
"""Of a clip's record; another one is measured anew."""
_SPEECH = "the speech"


MAX_BYTES, MAX_FILES = 10**9, 1500
"""Of all zips that a visitor brings at once, unpacked."""


@dataclass(frozen=True)
class Sets:
    """What was written, found, and must be said."""

    ask: Ask
    files: tuple[Path, ...]
    notes: tuple[str, ...]
    told: dict[str, Any]
    """What `app.run.many.table.write_tables` leaves in ``many.json``."""
    clips: dict[str, dict[str, Path]]
    """By system, and the reference, the motion file of each clip that is in the tables."""
    sounds: dict[str, Path]
    """Of those clips that have one."""


def measure_sets(
    ask: Ask,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> Sets:
    """As `diagnose_folders`, of zips, each a system's results, which stay unpacked below
    ``ask.out``.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError: also where all together hold too much.
    """
    limits = UnpackLimits(files=MAX_FILES, total_bytes=MAX_BYTES)
    folders = unpack_sets(sets_of(ask), ask.out / "unpacked", limits)
    run = Reporter(on_event, should_cancel)
    return replace(diagnose_folders(in_folders(ask, folders), run.share("numbers")), ask=ask)


def diagnose_folders(
    ask: Ask,
    on_progress: Callable[[float], None] = lambda share: None,
    pool: JobPool | None = None,
) -> Sets:
    """Measure all clips that every folder has, and leave what `write_tables` writes in ``ask.out``.

    Args:
        ask: its motions, its reference and its speech are folders, or zips.
        pool: who measures; by default this process.

    Raises:
        RunError: where folders have no clip in common, a folder is none, or a zip is hostile.
        MotionError, SpeechError: if no clip can be read.
        CheckpointError: for weights that are not EMAGE's.
        JobsError: if those who measure are lost.
    """
    check_weights(ask.emage_weights, ask.reference)
    remove_unfinished(ask.out)
    with held_folder(ask.out), unpacked_sets(sets_of(ask), ask.out) as folders:
        return _diagnose_sets(in_folders(ask, folders), on_progress, pool or JobPool(1))


def sets_of(ask: Ask) -> list[tuple[Path, tuple[str, ...]]]:
    """Folders or zips, each with the endings of its files."""
    motions: list[tuple[Path, tuple[str, ...]]] = [
        (path, ENDINGS) for path in (*ask.motions, ask.reference) if path is not None
    ]
    return [*motions, (ask.speech, SOUND_ENDINGS)] if ask.speech is not None else motions


def in_folders(ask: Ask, folders: Mapping[Path, Path]) -> Ask:
    """The same of folders, which stand in place of zips."""
    return replace(
        ask,
        motions=tuple(folders.get(path, path) for path in ask.motions),
        reference=ask.reference and folders.get(ask.reference, ask.reference),
        speech=ask.speech and folders.get(ask.speech, ask.speech),
    )


def _diagnose_sets(ask: Ask, on_progress: Callable[[float], None], pool: JobPool) -> Sets:
    folders = _named_folders(ask)
    of_sets: dict[str, tuple[Path, tuple[str, ...]]] = {
        name: (folder, ENDINGS) for name, folder in folders.items()
    }
    if (speech := _speech_folder(ask)) is not None:
        of_sets[_SPEECH] = speech, SOUND_ENDINGS
    files = paired_files(of_sets, (REFERENCE_NAME, _SPEECH))
    sounds = {clip: first_of(samples) for clip, samples in files.pop(_SPEECH, {}).items()}
    clips = sorted(set.intersection(*(set(found) for found in files.values())))
    if not clips:
        raise no_pair(files)
    notes = [
        f"{name}: {len(found) - len(clips)} of {len(found)} clips have no partner of that name:"
        f" {some_of(set(found) - set(clips))}."
        for name, found in files.items()
        if len(found) > len(clips)
    ]
    notes += [
        f"{name} has {told} samples of each clip, which are averaged first."
        for name, found in files.items()
        if (told := _counts(len(found[clip]) for clip in clips)) != "1"
    ]
    paths = [path for found in files.values() for each in found.values() for path in each.values()]
    notes += filter(None, [ask.told.unknown(paths, *files)])
    silent = [clip for clip in clips if clip not in sounds]
    if ask.speech is not None and silent:
        notes.append(f"{len(silent)} of {len(clips)} clips have no sound of their name.")
    return _diagnose_clips(ask, files, sounds, clips, notes, on_progress, pool)


def _diagnose_clips(
    ask: Ask,
    files: dict[str, dict[str, Samples]],
    sounds: dict[str, Path],
    clips: list[str],
    notes: list[str],
    on_progress: Callable[[float], None],
    pool: JobPool,
) -> Sets:
    kept = ask.out / "clips"
    kept.mkdir(parents=True, exist_ok=True)
    records = {clip: (kept / f"{clip}.json").absolute() for clip in clips}
    jobs = []
    for clip in clips:
        of_clip = {
            name: {sample: path.absolute() for sample, path in found[clip].items()}
            for name, found in files.items()
        }
        sound, speeds, weights = (
            path and path.absolute()
            for path in (sounds.get(clip), ask.mean_speeds, ask.emage_weights)
        )
        beside = _Beside(sound, speeds, weights, ask.channel)
        asked = ask.told, ask.body and ask.body.absolute()
        measured_of = {
            f"{name} {sample}".strip(): path
            for name, samples in of_clip.items()
            for sample, path in samples.items()
        }
        stamp = stamp_of(measured_of | beside.files, [FORMAT, *map(str, asked), ask.channel])
        jobs.append(
            Job(
                clip,
                partial(_is_measured, records[clip], stamp, beside),
                partial(_measure_clip, of_clip, beside, asked, records[clip], stamp),
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

    failed = pool.do_all(jobs, on_done)
    left_out = {clip: sentence_of(error) or "" for clip, error in sorted(failed.items())}
    for clip, error in failed.items():
        if len(failed) == len(jobs) or not left_out[clip]:
            raise error
    notes += [f"Left out: {clip}: {sentence}" for clip, sentence in left_out.items()]
    clips = [clip for clip in clips if clip not in failed]
    records = {clip: records[clip] for clip in clips}
    numbers = [json.loads(path.read_text()) for path in records.values()]
    notes += [sentence for each in numbers for sentence in each["unread"]]
    above = Above(told_above(files, numbers), left_out)
    notes[:0] = above.notes
    by_emage = EmageDistances()
    if ask.emage_weights is not None:
        frames = [each["frames"] for each in numbers]
        by_emage = emage_distances(list(files), dict(zip(records.values(), frames, strict=True)))
    origin = _origin_of(list(files), clips, numbers, ask.mean_speeds)
    written = write_tables(ask.out, list(files), clips, numbers, origin, by_emage.rows, above)
    notes += filter(None, (why_left_out(numbers), by_emage.note))
    drawn, said = draw_spread(ask.out, list(files), numbers)
    measured = {
        name: {clip: first_of(found[clip]) for clip in clips} for name, found in files.items()
    }
    heard = {clip: sounds[clip] for clip in clips if clip in sounds}
    notes += said
    told = json.loads((ask.out / "many.json").read_text())
    return Sets(ask, (*written, *drawn), tuple(notes), told, measured, heard)


def _counts(numbers: Iterable[int]) -> str:
    """``5``, or ``3 to 5``."""
    counts = sorted(set(numbers))
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"


def _named_folders(ask: Ask) -> dict[str, Path]:
    names = ask.names or [folder.resolve().name for folder in ask.motions]
    folders = dict(zip(map(printable, names), ask.motions, strict=True))
    if len(folders) < len(ask.motions) or REFERENCE_NAME in folders:
        raise RunError("Two folders have the same name, or one is called 'reference'; rename one.")
    if ask.reference is not None:
        folders[REFERENCE_NAME] = ask.reference
    wrong = next((folder for folder in folders.values() if not folder.is_dir()), None)
    if wrong is not None:
        raise RunError(f"{wrong} is no folder or zip; give sets only, or files only.")
    return folders


def _speech_folder(ask: Ask) -> Path | None:
    if ask.mean_speeds is not None and ask.speech is None:
        raise RunError("Mean speeds are of use with sound only; give both (--speech FOLDER).")
    if ask.speech is not None and not ask.speech.is_dir():
        raise RunError(
            f"{ask.speech} is no folder or zip; sets of motion go with a set of sound, "
            "whose files have the clips' names."
        )
    return ask.speech


@dataclass(frozen=True)
class _Beside:
    """What one clip's motions are measured with."""

    speech: Path | None
    mean_speeds: Path | None
    emage_weights: Path | None
    channel: int | None

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
        from model.measures.beats import read_mean_speeds
        from model.measures.lag import heard_of
        from model.speech.audio import SpeechLimits, load_speech

        if self.speech is None:
            return {}
        speech = load_speech(self.speech, SpeechLimits(channel=self.channel))
        return {
            "onsets_s": onsets_of(speech),
            "heard": heard_of(speech.waveform),
            "mean_speeds": self.mean_speeds and read_mean_speeds(self.mean_speeds),
        }


def _is_measured(record: Path, stamp: str, beside: _Beside) -> bool:
    """Whether a clip's record is there, whole, and of this very stamp."""
    try:
        is_kept = json.loads(record.read_text()).get("stamp") == stamp
    except (OSError, ValueError, AttributeError):
        return False
    return is_kept and (beside.emage_weights is None or codes_path(record).is_file())


def _measure_clip(
    files: dict[str, Samples],
    beside: _Beside,
    asked: tuple[Assumptions, Path | None],
    out: Path,
    stamp: str,
) -> None:
    """All systems of one clip beside its reference, over the frames that all have; of each the mean
    over its samples.

    Raises:
        MotionError: if some system has no sample that can be read.
    """
    from model.diagnostics import raw_evidence
    from model.faults.table import find_faults, without
    from model.motion.kinematics import open_body_skeleton
    from model.motion.motion import first_frames

    unread: list[str] = []
    readings = {name: _readings(name, files[name], asked, unread) for name in files}
    heard = beside.heard()
    shortest = min(each.motion.num_frames for found in readings.values() for each in found.values())
    reference = None
    systems: dict[str, Any] = {}
    motions: dict[str, list[Motion]] = {}
    for name in sorted(readings, key=lambda name: name != REFERENCE_NAME):  # the reference first
        told = []
        for sample, reading in readings[name].items():
            motion = first_frames(reading.motion, shortest)
            motions.setdefault(name, []).append(motion)
            evidence = raw_evidence(motion, open_body_skeleton(), reference, **heard)
            faults = without(find_faults(evidence), reading.lacks)
            told.append({
                "numbers": without_what_lacks(numbers_of(evidence.raw), reading.lacks),
                "findings": [fault.kind for fault in faults],
                "codes": moments_of(motion),
                "sha256": file_sha256(files[name][sample]),
            })  # fmt: skip
            if name == REFERENCE_NAME:
                reference = evidence
        systems[name] = mean_of_samples(told)
        systems[name]["assumed"] = [assumed_in(each) for each in readings[name].values()]
    if beside.emage_weights is not None:
        keep_codes(out, beside.emage_weights, motions)
    out.parent.mkdir(parents=True, exist_ok=True)
    record = {"stamp": stamp, "frames": shortest, "systems": systems, "unread": unread}
    with written_atomically(out) as part:
        part.write_text(json.dumps(record, allow_nan=False) + "\n")


def _readings(
    name: str, samples: Samples, asked: tuple[Assumptions, Path | None], unread: list[str]
) -> dict[str, Reading]:
    """Of those samples that can be read; why others cannot goes to ``unread``.

    Raises:
        MotionError: if none can.
    """
    from model.formats.read import read_any_motion
    from model.storage.npz import MotionError

    kind = REFERENCE if name == REFERENCE_NAME else MOTIONS
    found: dict[str, Reading] = {}
    why: MotionError | None = None
    for sample, path in samples.items():
        try:
            found[sample] = read_any_motion(path, *asked, kind, name)
        except MotionError as error:
            why = error
            unread.append(f"Of the samples of one clip this is left out: {error}")
    if why is not None and not found:
        raise why
    return found


def _origin_of(
    systems: list[str],
    clips: list[str],
    numbers: list[dict[str, Any]],
    mean_speeds: Path | None,
) -> dict[str, Any]:
    """What stands in ``many.json`` as ``provenance``.

    Args:
        numbers: of each clip, in ``systems`` by name the ``sha256`` of its file.
        mean_speeds: published ones that BeatAlign was measured with.
    """
    from model.systems.helpers.config import FGD_ENCODER
    from model.training.loop import revision

    digests = {
        name: _digest(
            [clip, each["systems"][name]["sha256"]]
            for clip, each in zip(clips, numbers, strict=True)
        )
        for name in systems
    }
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "project": revision(),
        "systems": digests,
        "reference": digests.get(REFERENCE_NAME),
        "encoders": {"FGD": load_card(BUNDLED_WEIGHTS, FGD_ENCODER).sha256},
        "mean_speeds": mean_speeds and file_sha256(mean_speeds),
        "measures": FORMAT,
    }


def _digest(parts: Any) -> str:
    return hashlib.sha256(json.dumps(list(parts)).encode()).hexdigest()
