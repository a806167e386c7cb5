"""Metrics of folders or archives of motion files, with intervals over clips.

Files at any depth are paired by clip and sample (`app.run.batch.pairing`). Each clip is measured
unfiltered by one process, and its metrics, means over samples, are stored in ``clips``, so that an
interrupted run can continue. A clip without a readable file in some set is listed, not tabulated.
"""

from __future__ import annotations

import datetime
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.findings.metric_table import METRICS, metric_values, parts_others_have
from app.run.batch import frechet_distances, pairing, published_metrics
from app.run.batch.archives import UNPACKED, UnpackBudget, unpack_archives
from app.run.batch.published_metrics import PLAIN, PROTOCOL_VARIATIONS, PublishedMetrics
from app.run.batch.speech_batch import ENDINGS as SOUND_ENDINGS
from app.run.batch.speech_batch import inputs_stamp, run_jobs
from app.run.batch.table import average_samples, draw_distribution_figure, write_tables
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.diagnostics import cached_speech_onsets
from app.run.imported_motions import protocol_inputs
from app.run.output.result_folder import ResultFolder
from app.run.requests.convert import map_paths, replace_fields
from app.run.requests.parts import MetricOptions
from app.run.requests.requests import DiagnoseRequest
from app.run.tasks import SetResults
from conventions.names import REFERENCE_NAME, pluralise, printable
from model.diagnostics import analyse_raw
from model.faults.table import drop_findings_on_missing_parts, find_faults
from model.formats.parameters import sibling_parameter_files
from model.formats.read import ENDINGS, read_any_motion
from model.formats.reading import MISSING_PART_TEXTS, MOTIONS, REFERENCE, ImportedMotion
from model.metrics.lag import speech_bands_by_frame
from model.metrics.protocols.clip import Clip, ProtocolInputs, Sums
from model.metrics.protocols.formulas import protocol_sums
from model.metrics.protocols.table import PROTOCOLS, measurable_without, protocol_of
from model.metrics.results import BeatSpeedSource
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.speech.audio import SpeechReadOptions, load_speech
from model.storage.files import file_sha256, write_atomically
from model.storage.npz import MotionError
from model.storage.revision import revision
from processes.job import Job
from processes.pool import JobPool

FORMAT = 8
"""Format version of a clip's record; clips with a record of another version are measured again."""
METRICS_VERSION = 7
"""Version of the metrics' definitions; results of different versions cannot be compared."""
_SPEECH = "the speech"


MAX_BYTES, MAX_FILES = 10**9, 1500
"""Limits of all archives of a visitor's request, unpacked."""


def measure_uploaded_sets(
    request: DiagnoseRequest, callbacks: RunCallbacks = NO_CALLBACKS
) -> SetResults:
    """Measure a visitor's archives within limits; they stay unpacked in the output folder.

    Raises Cancelled, and RunError also if the archives exceed the limits.
    """
    limits = UnpackBudget(max_files=MAX_FILES, max_total_bytes=MAX_BYTES, min_free_bytes=10**9)
    folders = unpack_archives(input_sets(request), request.output.out / UNPACKED, limits)
    result = diagnose_folders(
        with_unpacked_folders(request, folders), callbacks.progress_callback("numbers")
    )
    return replace(result, request=request)


def diagnose_folders(
    request: DiagnoseRequest,
    on_progress: Callable[[float], None] = lambda share: None,
    pool: JobPool | None = None,
) -> SetResults:
    """Measure all clips that every folder has, and write the tables of `write_tables`.

    Args:
        request: request with folders or archives as motions, reference and speech.

    Raises:
        RunError: if folders have no readable clip in common, one is not a folder, or an archive is
            hostile.
        CheckpointError: for weights that are not EMAGE's.
        JobsError: if the workers are lost.
    """
    frechet_distances.check_fgd_options(
        map_paths(request, Path.absolute).metrics, request.imports.reference
    )
    with ResultFolder(request.output.out, is_incremental=True) as results:
        folders = unpack_archives(input_sets(request), results.scratch("sets"))
        return _diagnose_sets(
            with_unpacked_folders(request, folders), on_progress, pool or JobPool(1)
        )


def input_sets(request: DiagnoseRequest) -> list[tuple[Path, tuple[str, ...]]]:
    """Return folders and archives of the request, each with the suffixes of its files."""
    motions: list[tuple[Path, tuple[str, ...]]] = [
        (path, ENDINGS)
        for path in (*request.motions.motions, request.imports.reference)
        if path is not None
    ]
    return (
        [*motions, (request.speech.path, SOUND_ENDINGS)]
        if request.speech.path is not None
        else motions
    )


def with_unpacked_folders(
    request: DiagnoseRequest, folders: Mapping[Path, Path]
) -> DiagnoseRequest:
    """Return the request with folders in place of archives."""
    reference, speech = request.imports.reference, request.speech.path
    return replace_fields(
        request,
        motions=tuple(folders.get(path, path) for path in request.motions.motions),
        reference=reference and folders.get(reference, reference),
        speech=speech and folders.get(speech, speech),
    )


def _diagnose_sets(
    request: DiagnoseRequest, on_progress: Callable[[float], None], pool: JobPool
) -> SetResults:
    folders = _named_folders(request)
    of_sets: dict[str, tuple[Path, tuple[str, ...]]] = {
        name: (folder, ENDINGS) for name, folder in folders.items()
    }
    if (speech := _speech_folder(request)) is not None:
        of_sets[_SPEECH] = speech, SOUND_ENDINGS
    files = pairing.pair_files(of_sets, (REFERENCE_NAME, _SPEECH))
    sounds = {
        clip: pairing.first_sample_file(samples) for clip, samples in files.pop(_SPEECH, {}).items()
    }
    clips = sorted(set.intersection(*(set(paths_of_set) for paths_of_set in files.values())))
    if not clips:
        raise pairing.no_common_clips_error(files)
    notes = [
        f"{name}: {len(paths_of_set) - len(clips)} of {len(paths_of_set)} clips are missing from "
        f"another set and were not measured: "
        f"{pairing.shorten_list(set(paths_of_set) - set(clips))}."
        for name, paths_of_set in files.items()
        if len(paths_of_set) > len(clips)
    ]
    notes += [
        f"{name} has {count} samples of each clip; their metrics are averaged."
        for name, paths_of_set in files.items()
        if (count := _counts(len(paths_of_set[clip]) for clip in clips)) != "1"
    ]
    paths = [
        path
        for paths_of_set in files.values()
        for each in paths_of_set.values()
        for path in each.values()
    ]
    notes += filter(None, [request.imports.import_overrides.unknown_file_error(paths, *files)])
    silent = [clip for clip in clips if clip not in sounds]
    if request.speech.path is not None and silent:
        notes.append(f"{len(silent)} of {len(clips)} clips have no audio file of the same name.")
    return _diagnose_clips(request, files, sounds, clips, notes, on_progress, pool)


def _diagnose_clips(
    request: DiagnoseRequest,
    files: dict[str, dict[str, pairing.SampleFiles]],
    sounds: dict[str, Path],
    clips: list[str],
    notes: list[str],
    on_progress: Callable[[float], None],
    pool: JobPool,
) -> SetResults:
    clips_folder, here = request.output.out.absolute() / "clips", map_paths(request, Path.absolute)
    measured = {
        clip: _ClipJob(
            files={
                name: {sample: path.absolute() for sample, path in readings[clip].items()}
                for name, readings in files.items()
            },
            sound=sounds[clip].absolute() if clip in sounds else None,
            request=here,
            record_path=clips_folder / f"{clip}.json",
            semantics=_semantics_of(here, clip),
        )
        for clip in clips
    }
    jobs = [Job(clip, each.is_measured, each.measure) for clip, each in measured.items()]
    num_reused, left_out = run_jobs(jobs, pool, lambda clip, share: on_progress(share))
    if num_reused:
        notes.append(
            f"{pluralise(num_reused, 'clip')} had already been measured; the results were reused."
        )
    if len(left_out) == len(jobs):
        raise RunError(next(iter(left_out.values())))
    left_out = dict(sorted(left_out.items()))
    notes += [f"{clip} was left out: {sentence}" for clip, sentence in left_out.items()]
    records = {clip: each.record_path for clip, each in measured.items() if clip not in left_out}
    numbers = {clip: json.loads(path.read_text()) for clip, path in records.items()}
    notes += [sentence for each in numbers.values() for sentence in each["unread"]]
    above = import_notes(files, list(numbers.values()))
    notes[:0] = above
    systems, record_list = list(files), list(records.values())
    distances, unsaid = frechet_distances.distance_rows(systems, record_list, here.metrics)
    origin = _origin_of(systems, numbers, here.metrics)
    published = PublishedMetrics(record_list)
    speeds = _speeds_of(here)
    compared = _by_rule(published, systems, numbers, speeds) | frechet_distances.distance_values(
        systems, record_list, here.metrics, _variations(here)
    )
    written, results = write_tables(
        request.output.out,
        systems,
        numbers,
        above,
        left_out,
        origin=origin,
        extra_rows=[*distances, *published.rows(systems)],
        speeds=speeds,
        lines_below=published_metrics.protocol_comparison_lines(
            systems, compared, here.metrics.expected
        ),
    )
    drawn, spread_notes = draw_distribution_figure(
        request.output.out, systems, list(numbers.values()), speeds
    )
    return SetResults(
        request,
        files=(*written, *drawn),
        notes=(*notes, *unsaid, *spread_notes),
        batch_json=results,
        motion_files={
            name: {clip: pairing.first_sample_file(readings[clip]) for clip in numbers}
            for name, readings in files.items()
        },
        audio_files={clip: sounds[clip] for clip in numbers if clip in sounds},
    )


def _variations(request: DiagnoseRequest) -> tuple[str, ...]:
    """Return the variations of rules that are measured: all, if values are expected."""
    return (
        tuple(name for name in PROTOCOL_VARIATIONS if name != PLAIN)
        if request.metrics.expected
        else ()
    )


def _speeds_of(request: DiagnoseRequest) -> BeatSpeedSource:
    """Return the source of the mean speeds of BeatAlign."""
    if request.metrics.mean_speeds is not None:
        return "emage"
    return "own" if request.imports.reference is None else "reference"


def _by_rule(
    published: PublishedMetrics,
    systems: list[str],
    numbers: Mapping[str, dict[str, Any]],
    speeds: BeatSpeedSource,
) -> dict[tuple[str, str, str, str], float]:
    """Return the values of all protocols by system, id, name and variation."""
    values = {
        (system, protocol, key, variation): value
        for system in systems
        for protocol in PROTOCOLS
        for variation in PROTOCOL_VARIATIONS
        for key, value in published.values(protocol, system, variation).items()
    }
    for system in systems:
        for key in ("beat_align", "l1_diversity_m"):
            measured = [each["systems"][system]["numbers"].get(key) for each in numbers.values()]
            finite = [value for value in measured if value is not None]
            if finite:
                protocol = protocol_of(key, speeds)
                values[system, protocol, key, PLAIN] = sum(finite) / len(finite)
    return values


def _semantics_of(request: DiagnoseRequest, clip: str) -> Path | None:
    """Return the file of BEAT's labels of a clip, if there is one."""
    folder = request.metrics.semantics
    path = None if folder is None else folder / f"{clip.rpartition('/')[2]}.txt"
    return path if path is not None and path.is_file() else None


def _counts(numbers: Iterable[int]) -> str:
    """Format a range of numbers: ``5`` or ``3 to 5``."""
    counts = sorted(set(numbers))
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"


def _named_folders(request: DiagnoseRequest) -> dict[str, Path]:
    names = request.motions.names or [folder.resolve().name for folder in request.motions.motions]
    folders = dict(zip(map(printable, names), request.motions.motions, strict=True))
    if len(folders) < len(request.motions.motions) or REFERENCE_NAME in folders:
        raise RunError("Two folders have the same name, or one is called 'reference'; rename one.")
    if request.imports.reference is not None:
        folders[REFERENCE_NAME] = request.imports.reference
    wrong = next((folder for folder in folders.values() if not folder.is_dir()), None)
    if wrong is not None:
        raise RunError(
            f"{wrong} is not a folder or zip; give only folders and zips, or only motion files."
        )
    return folders


def _speech_folder(request: DiagnoseRequest) -> Path | None:
    if request.metrics.mean_speeds is not None and request.speech.path is None:
        raise RunError(
            "Mean joint speeds are used only for BeatAlign, which needs speech; also give a "
            "folder of audio files (--speech FOLDER)."
        )
    if request.speech.path is not None and not request.speech.path.is_dir():
        raise RunError(
            f"{request.speech.path} is not a folder or zip; for folders of motions, give a folder "
            "of audio files named like the clips."
        )
    return request.speech.path


@dataclass(frozen=True)
class _ClipJob:
    """Files of one clip, measured by one process; all paths are absolute."""

    files: dict[str, pairing.SampleFiles]
    """Motion files by set, including the recorded one."""
    sound: Path | None
    request: DiagnoseRequest
    record_path: Path
    semantics: Path | None = None
    """Labels of semantic relevance."""

    def _stamp(self) -> str:
        """Return the digest of everything that determines the metrics."""
        request = self.request
        beside = {
            "sound": self.sound,
            "speeds": request.metrics.mean_speeds,
            "encoder": request.metrics.emage_weights,
            **{f"genea encoder {k}": path for k, path in enumerate(request.metrics.genea_weights)},
            "semantics": self.semantics,
        }
        files = {
            f"{name} {sample}": path
            for name, samples in self.files.items()
            for sample, path in samples.items()
        }
        files |= {
            f"{name} {part}": each
            for name, path in files.items()
            for part, each in sibling_parameter_files(path).items()
        } | {name: path for name, path in beside.items() if path is not None}
        return inputs_stamp(
            files,
            [
                *(FORMAT, METRICS_VERSION),
                str(request.imports.import_overrides),
                str(request.video.body),
                request.speech.channel,
                bool(request.metrics.expected),
            ],
        )

    def is_measured(self) -> bool:
        """Check whether there is a complete record of these files."""
        try:
            is_current = json.loads(self.record_path.read_text()).get("stamp") == self._stamp()
        except (OSError, ValueError, AttributeError):
            return False
        return is_current and all(
            path(self.record_path).is_file()
            for path in (frechet_distances.features_path, published_metrics.sums_path)
        )

    def measure(self) -> None:
        """Measure sets over common frames, means over samples; raises MotionError."""
        unread: list[str] = []
        readings = {name: self._readings(name, unread) for name in self.files}
        of_all = {
            f"{name} {sample}": each
            for name, imported in readings.items()
            for sample, each in imported.items()
        }
        shortest = min(each.motion.num_frames for each in of_all.values())
        shared = self._shared_inputs(shortest)
        apart = parts_others_have({which: each.missing_parts for which, each in of_all.items()})
        reference = None
        systems: dict[str, Any] = {}
        motions: dict[str, list[Motion]] = {}
        clips: dict[str, list[Clip]] = {}
        for name in sorted(readings, key=lambda name: name != REFERENCE_NAME):  # first
            notes = []
            for sample, reading in readings[name].items():
                motion = first_frames(reading.motion, shortest)
                motions.setdefault(name, []).append(motion)
                analysed = analyse_raw(motion, open_body_skeleton(), reference, **shared)
                recorded = None if name == REFERENCE_NAME else clips.get(REFERENCE_NAME, [None])[0]
                clip = shared["protocol_inputs"].make_clip(motion, analysed.tracks, recorded)
                clips.setdefault(name, []).append(clip)
                faults = drop_findings_on_missing_parts(
                    find_faults(analysed), reading.missing_parts
                )
                notes.append({
                    "numbers": metric_values(
                        analysed.metrics, reading.missing_parts, apart[f"{name} {sample}"]
                    ),
                    "findings": [fault.kind for fault in faults],
                    "sha256": file_sha256(self.files[name][sample]),
                })  # fmt: skip
                if name == REFERENCE_NAME:
                    reference = analysed
            assumed = [assumptions_and_missing_parts(each) for each in readings[name].values()]
            systems[name] = {**average_samples(notes), "assumed": assumed}
        self.record_path.parent.mkdir(parents=True, exist_ok=True)
        variations = _variations(self.request)
        frechet_distances.save_features(self.record_path, motions, self.request.metrics, variations)
        published_metrics.save_sums(
            self.record_path, self._sums(readings, motions, clips, shared["protocol_inputs"])
        )
        notes = {"frames": shortest, "systems": systems, "unread": unread}
        write_atomically(
            self.record_path, json.dumps({"stamp": self._stamp(), **notes}, allow_nan=False) + "\n"
        )

    def _sums(
        self,
        readings: Mapping[str, Mapping[str, ImportedMotion]],
        motions: Mapping[str, Sequence[Motion]],
        clips: Mapping[str, Sequence[Clip]],
        inputs: ProtocolInputs,
    ) -> dict[tuple[str, str], dict[str, Sums]]:
        """Return the sums of published protocols by system and variation.

        ``motions`` are samples by system, the reference first; ``clips`` are theirs, unvaried.
        """
        with_metrics_measured_elsewhere = bool(self.request.metrics.expected)
        sums: dict[tuple[str, str], dict[str, Sums]] = {}
        for variation in (PLAIN, *_variations(self.request)):
            recorded: Clip | None = None
            for name, samples in motions.items():
                varied = clips[name]
                if variation != PLAIN:
                    varied = [
                        published_metrics.make_varied_clip(each, inputs, variation, recorded)
                        for each in samples
                    ]
                if name == REFERENCE_NAME:
                    recorded = varied[0]
                sums[name, variation] = published_metrics.mean_sums([
                    measurable_without(
                        protocol_sums(clip, with_metrics_measured_elsewhere), reading.missing_parts
                    )
                    for clip, reading in zip(varied, readings[name].values(), strict=True)
                ])  # fmt: skip
        return sums

    def _shared_inputs(self, num_frames: int) -> dict[str, Any]:
        """Return the arguments of `analyse_raw` that do not depend on the motion."""
        speech = None
        if self.sound is not None:
            speech = load_speech(self.sound, SpeechReadOptions(channel=self.request.speech.channel))
        metrics = replace(self.request.metrics, semantics=self.semantics)
        inputs = protocol_inputs(replace(self.request, metrics=metrics), speech, num_frames)
        if speech is None:
            return {"protocol_inputs": inputs}
        bands = speech_bands_by_frame(speech.waveform)
        return {
            "onsets_s": cached_speech_onsets(speech),
            "speech_log_mel": bands,
            "protocol_inputs": inputs,
        }

    def _readings(self, name: str, unread: list[str]) -> dict[str, ImportedMotion]:
        """Read a set's samples; append errors to ``unread``; raises MotionError if all have one."""
        kind = REFERENCE if name == REFERENCE_NAME else MOTIONS
        readings: dict[str, ImportedMotion] = {}
        why: MotionError | None = None
        for sample, path in self.files[name].items():
            try:
                readings[sample] = read_any_motion(
                    path, self.request.imports.import_overrides, self.request.video.body, kind, name
                )
            except MotionError as error:
                why = error
                unread.append(f"A sample was skipped: {error}")
        if why is not None and not readings:
            raise why
        return readings


def _origin_of(
    systems: list[str], numbers: Mapping[str, dict[str, Any]], metrics: MetricOptions
) -> dict[str, Any]:
    """Return the ``provenance`` of ``batch.json``."""
    digests = {}
    for name in systems:
        parts = [[clip, each["systems"][name]["sha256"]] for clip, each in numbers.items()]
        digests[name] = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "project": revision(),
        "systems": digests,
        "reference": digests.get(REFERENCE_NAME),
        "encoders": frechet_distances.encoder_digests(metrics),
        "mean_speeds": metrics.mean_speeds and file_sha256(metrics.mean_speeds),
        "measures": METRICS_VERSION,
    }


def assumptions_and_missing_parts(reading: ImportedMotion) -> dict[str, Any]:
    """Return a file's assumptions that differ from our format (said) and missing parts (lacks)."""
    assumptions = [each for each in reading.assumptions if not each.is_own_convention]
    return {
        "said": [[each.kind, each.value, each.reason] for each in assumptions],
        "lacks": sorted(reading.missing_parts),
    }


def import_notes(systems: Iterable[str], numbers: Sequence[dict[str, Any]]) -> list[str]:
    """Return notes on all clips: what sets lack, how they differ, and their assumptions.

    Assumptions are the most frequent first, such as ``mine: up assumed to be z in 40 of 40 files``.
    """
    files = {
        name: [file for each in numbers for file in each["systems"][name]["assumed"]]
        for name in systems
    }
    assumptions = [each for of_set in files.values() for file in of_set for each in file["said"]]
    why = {(kind, value): because for kind, value, because in reversed(assumptions)}
    counts = {
        name: Counter((kind, value) for file in of_set for kind, value, _ in file["said"])
        for name, of_set in files.items()
    }
    counted = [
        f"{name}: {kind!r} is assumed to be {value} in {count} of {len(files[name])} files: "
        f"{why[kind, value]}."
        for name, many in counts.items()
        for (kind, value), count in many.most_common()
    ]
    return [*_lacking(files), *_reading_differences(counts), *counted]


def _lacking(files: Mapping[str, Sequence[Mapping[str, Any]]]) -> Iterator[str]:
    """Yield what sets lack, and which metrics are omitted for that."""
    lacks = {
        name: {part for file in of_set for part in file["lacks"]} for name, of_set in files.items()
    }
    apart = parts_others_have(lacks)
    for part, (what, _) in MISSING_PART_TEXTS.items():
        if part == "face":  # in the counts of assumptions
            continue
        for name, of_set in files.items():
            count = sum(part in file["lacks"] for file in of_set)
            rows = [row for row in METRICS if part in row.required_parts]
            rows += [
                row for row in METRICS if part in row.parts_that_must_match and part in apart[name]
            ]
            titles = ", ".join(row.title for row in rows)
            out = f"; these metrics are left out: {titles}" if rows else ""
            some = "" if count == len(of_set) else f" in {count} of {len(of_set)} files"
            if count:
                yield f"{name} {what}{some}{out}."


def _reading_differences(counts: Mapping[str, Counter[tuple[str, str]]]) -> Iterator[str]:
    for kind in dict.fromkeys(kind for many in counts.values() for kind, _ in many):
        values = {
            name: ", ".join(sorted(value for other, value in many if other == kind))
            for name, many in counts.items()
        }
        if len(set(values.values())) > 1:
            each = "; ".join(f"{name}: {value or 'the default'}" for name, value in values.items())
            yield f"The sets were read with different assumptions about {kind!r} ({each})."
