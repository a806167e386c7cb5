"""Writer of a run's folder while the run goes on, with its `run.json`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import Float32

from app.errors import Cancelled, message_for_user
from app.findings.metric_table import metric_values, parts_others_have
from app.findings.sentences import figure_sentences
from app.findings.verdict import make_verdict
from app.run.bodies import PointTracker, RootTransform, alignment_to_origin
from app.run.callbacks import NO_CALLBACKS, FolderUpdated, RunCallbacks
from app.run.frame_packets import MAX_FRAMES, frames_message
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import (
    MAX_FINDINGS,
    MAX_ROWS,
    RUN,
    SPEECH,
    TIMELINE,
    AssumptionRecord,
    FindingRecord,
    FramesAvailable,
    Row,
    RowFileKind,
    RunRecord,
    VerdictRecord,
    make_rows,
    truncate,
    viewer_file_name,
)
from app.run.timeline import make_timeline, padded_waveform, transcript_tiers
from conventions.names import (
    FILTER_VERSIONS,
    REFERENCE_NAME,
    join_names,
    safe_file_stem,
    short_names,
)
from model.diagnostics import Diagnostics
from model.faults.analysis import Finding, rank_findings
from model.faults.table import body_part
from model.formats.reading import ImportedMotion
from model.generation.base import Windowing
from model.metrics.protocols.clip import ProtocolInputs
from model.metrics.protocols.table import PROTOCOL_CAPTION
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, concatenate, save_motion
from model.plan.detection import plan_from_motion
from model.plan.files import read_plan_file, write_plan_file
from model.plan.plan import GesturePlan
from model.speech.audio import Speech, write_wav
from model.speech.transcript import Transcript
from model.storage.escaping import csv_text
from renderer.body.body import Body
from renderer.figures import saved_figures
from renderer.figures.style import CONTENTS_SUFFIX, FIGURE_FORMATS, save_figure

_GROWN = 1.2
"""Growth factor of a motion after which its alignment is computed again."""
FAULT = "The run stopped because of an internal error."


@dataclass
class _GrowingMotion:
    """Motion of one row that is being generated."""

    path: Path
    root_transform: RootTransform | None
    is_alignment_fixed: bool
    parts: list[Motion] = field(default_factory=list)
    num_written: int = 0
    aligned_at_frame: int = 0

    def current_transform(self, num_frames: int) -> RootTransform:
        """Return the alignment of the motion, computed anew as it grows and at its end."""
        is_due = self.num_written >= min(_GROWN * self.aligned_at_frame, num_frames)
        if self.root_transform is None or (is_due and not self.is_alignment_fixed):
            self.root_transform = alignment_to_origin(concatenate(self.parts))
            self.aligned_at_frame = self.num_written
        return self.root_transform


@dataclass(frozen=True)
class RunMotions:
    """Motions of one run with all data needed to measure them, by name, the reference last."""

    motions: Mapping[str, Motion]
    viewer_motions: Mapping[str, Motion]
    """Motions as the viewer plays them: imported ones aligned and as many as fit, generated ones
    after the post-filter, if one is chosen."""
    figure_motions: Mapping[str, Motion]
    """Motions in figures, as many as fit."""
    timeline: dict[str, Any]
    body: Body
    tracker: PointTracker
    audio_path: Path | None
    """Audio of videos; None without speech."""
    onsets_s: np.ndarray | None
    windows: Mapping[str, Windowing]
    """Generation windows by motion, if known."""
    speech_log_mel: np.ndarray | None = None
    """Log-mel bands of the speech per motion frame (T, bands), for estimating the lag of imported
    motions; None without speech."""
    protocol_inputs: ProtocolInputs | None = None
    """Further inputs of published protocols."""
    notes: tuple[str, ...] = ()
    """Notes on reading imported motions, added to the metrics."""
    imported_files: Mapping[str, ImportedMotion] = field(default_factory=dict)
    """Imported files as they were read."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Provenance of generated motions."""

    align: Callable[[Motion], Motion] = lambda motion: motion
    """Function that aligns a motion for pictures; imported ones are aligned when they are read."""
    speech_name: str = ""
    """Name of the speech in captions of figures."""


@contextmanager
def open_run_writer(
    out: Path,
    record: RunRecord,
    callbacks: RunCallbacks = NO_CALLBACKS,
    *,
    is_incremental: bool = False,
) -> Iterator[RunWriter]:
    """Open a run's folder as `ResultFolder`; an error in the block is recorded in ``run.json``."""
    with ResultFolder(out, is_incremental=is_incremental) as folder:
        run = RunWriter(folder, record, callbacks)
        try:
            yield run
        except BaseException as error:
            is_cancelled = isinstance(error, Cancelled)
            record.state = "cancelled" if is_cancelled else "failed"
            record.message = "" if is_cancelled else truncate(message_for_user(error) or FAULT)
            with suppress(Exception):
                run.write_record()
            raise


class RunWriter(RunCallbacks):
    """Writer of the folder and record of a run; its caller is notified of all changes."""

    def __init__(
        self, folder: ResultFolder, record: RunRecord, callbacks: RunCallbacks = NO_CALLBACKS
    ) -> None:
        super().__init__(callbacks.on_event, callbacks.should_cancel)
        self.notes: list[str] = []
        self.folder = folder
        self.record = record
        self._path = folder.new_path(RUN, grows=True)
        self._growing: dict[str, _GrowingMotion] = {}
        self.write_record()

    def add_notes(self, *sentences: str) -> None:
        """Add notes for the user, each sentence once."""
        self.notes.extend(note for note in sentences if note not in self.notes)

    def write_record(self) -> None:
        """Write the record, and notify the caller."""
        self.record.notes = [truncate(note) for note in self.notes[:MAX_FINDINGS]]
        self.record.write(self._path)
        self.on_event(FolderUpdated(self._path.parent))

    def finish(self, sentence: str) -> None:
        """Mark the run as done, and publish its files."""
        self.record.state, self.record.message = "done", truncate(sentence)
        self.write_record()
        self.folder.publish()

    def declare_rows(self, names: Iterable[str]) -> None:
        """Set the names of all rows, in order."""
        self.record.rows = make_rows(list(names)[:MAX_ROWS])

    def _row(self, name: str) -> Row:
        row = self.record.row(name)
        assert row is not None
        return row

    def add_files(self, *paths: Path, row: str = "", kind: RowFileKind | None = None) -> None:
        """Add complete files to the record."""
        of = self.record.row(row)
        for path in paths:
            whole = self.folder.mark_complete(path)
            if whole not in self.record.files:
                self.record.files.append(whole)
            if of is not None and kind is not None:
                of.files[kind] = whole
        self.write_record()

    def write_json_and_csv(
        self, name: str, json_content: object, csv_rows: Iterable[Iterable[object]]
    ) -> None:
        """Write metrics as JSON and as CSV."""
        numbers, table = (self.folder.new_path(f"{name}.{ending}") for ending in ("json", "csv"))
        numbers.write_text(json.dumps(json_content, indent=1) + "\n")
        table.write_text(csv_text(csv_rows), "utf-8", newline="")
        self.add_files(numbers, table)

    def write_figure(
        self, name: str, contents: Any, caption: str, formats: Sequence[str] = FIGURE_FORMATS
    ) -> None:
        """Draw a figure of `saved_figures.DRAW_FUNCTIONS` in the requested file formats.

        The caption also names the protocol of the numbers.
        If some formats are omitted, the content is saved so that they can be drawn later.
        """
        stem = self.folder.new_path(f"{name}.png").with_suffix("")
        caption = f"{caption} {PROTOCOL_CAPTION}"
        files = save_figure(
            lambda: saved_figures.DRAW_FUNCTIONS[name](contents), stem, caption, formats
        )
        if set(formats) != set(FIGURE_FORMATS):
            path = self.folder.new_path(viewer_file_name(name, CONTENTS_SUFFIX))
            saved_figures.save_figure_contents(path, name, contents, caption)
            self.add_files(path)
        self.add_files(*(self.folder.new_path(path.name) for path in files))

    def append_motion(
        self, name: str, motion: Motion, num_frames: int, aligned_like: Motion | None = None
    ) -> None:
        """Append frames to a row's motion of ``num_frames``, by default aligned like itself."""
        if num_frames > MAX_FRAMES:
            return
        row = self._row(name)
        if name not in self._growing:
            path = self.folder.new_path(viewer_file_name(name, ".frames"), grows=True)
            path.unlink(missing_ok=True)
            root_transform = None if aligned_like is None else alignment_to_origin(aligned_like)
            self._growing[name] = _GrowingMotion(path, root_transform, aligned_like is not None)
        growing = self._growing[name]
        with growing.path.open("ab") as file:
            file.write(frames_message(growing.num_written, motion))
            size = file.tell()
        growing.parts.append(motion)
        growing.num_written += motion.num_frames
        place = growing.current_transform(num_frames)
        row.files["frames"] = self.folder.mark_complete(growing.path)
        row.available = FramesAvailable(
            num_ready=growing.num_written,
            num_frames=num_frames,
            num_bytes=size,
            root_transform=(place.yaw_rad, *place.translation_m),
        )
        self.write_record()

    def write_motion(self, name: str, motion: Motion, file_name: str = "") -> None:
        """Write a row's whole motion as shown, by default to a file that only the player uses."""
        path = self.folder.new_path(file_name or viewer_file_name(name, ".npz"))
        save_motion(motion, path)
        if name not in self._growing:
            self.append_motion(name, motion, motion.num_frames)
        self.add_files(path, row=name, kind="motion")

    def write_audio(self, waveform: Float32[np.ndarray, " N"]) -> Path:
        """Write the sound of the run as 16 kHz WAV."""
        path = self.folder.new_path(SPEECH)
        write_wav(path, waveform)
        self.record.audio = SPEECH
        self.add_files(path)
        return self.folder.current_path(SPEECH)

    def write_motions_and_make_timeline(
        self,
        motions: Mapping[str, Motion],
        speech: Speech | None,
        tracker: PointTracker,
        accent_weights: Path | None = None,
        plans: Mapping[str, Path] | None = None,
    ) -> dict[str, Any]:
        """Write motions with their sound, silent without speech; return their unwritten timeline.

        ``accent_weights`` is the folder of the accent network; None omits accents. ``plans`` are
        the files of gesture plans that the motions follow, by name.
        """
        self.declare_rows(motions)
        self.write_audio(padded_waveform(speech, motions))
        for name in sorted(motions.keys() & (plans or {}).keys()):
            self.write_plan(name, read_plan_file((plans or {})[name]).plan)
        for name, motion in motions.items():
            self.write_motion(name, motion)
        return make_timeline(speech, motions, "raw", tracker, accent_weights)

    def write_timeline(
        self, timeline: Mapping[str, Any], transcript: Transcript | None = None
    ) -> None:
        """Write the timeline, with a transcript's tiers in place of its own; also again."""
        path = self.folder.new_path(TIMELINE)
        whole = {**timeline, **({} if transcript is None else transcript_tiers(transcript))}
        path.write_text(json.dumps(whole, allow_nan=False, separators=(",", ":")))
        self.record.timeline = TIMELINE
        self.add_files(path)

    def write_plan(self, name: str, plan: GesturePlan) -> GesturePlan:
        """Write the gesture plan of a row; return it as rounded in the file."""
        path = self.folder.new_path(f"{safe_file_stem(name)}.plan.json")
        write_plan_file(plan, path)
        written = read_plan_file(path).plan
        self._row(name).files["plan"] = path.name
        self.add_files(path, row=name, kind="input_plan")
        return written

    def detect_plans(self, motions: Mapping[str, Motion]) -> None:
        """Detect and write the gesture plans of rows that have none."""
        for name, motion in motions.items():
            if "plan" not in self._row(name).files:
                path = self.folder.new_path(viewer_file_name(name, ".plan.json"))
                write_plan_file(plan_from_motion(motion, open_body_skeleton()), path)
                self.add_files(path, row=name, kind="plan")

    def record_metrics(self, diagnostics: Diagnostics) -> None:
        """Record the final metrics, findings and verdict."""
        record, is_made = self.record, self.record.kind == "generated"
        record.tracked_point = diagnostics.tracked_point
        of_all = sorted(diagnostics.metrics_by_name.items(), key=lambda of: of[0] != REFERENCE_NAME)
        apart = parts_others_have(diagnostics.missing_parts)
        record.metrics = {
            name: {
                kind: metric_values(versions.version(kind), incomparable=apart.get(name, ()))
                for kind in FILTER_VERSIONS
            }
            for name, versions in of_all[:MAX_ROWS]
        }
        record.findings = finding_records(diagnostics.findings)
        verdict = make_verdict(record.tracked_point, [record.metrics], is_made)
        if verdict is not None and (is_made or len(of_all) > 1):
            record.verdict = VerdictRecord(
                jerk_sentence=truncate(verdict.jerk_sentence),
                comparison=truncate(verdict.comparison),
            )
        record.figure_captions = {
            key: truncate(sentence) for key, sentence in figure_sentences(diagnostics).items()
        }
        for row in record.rows:
            row.assumptions = cast(
                list[AssumptionRecord], diagnostics.assumptions.get(row.name, [])
            )
        self.write_record()


def draw_saved_figure_task(contents_and_target: tuple[Path, Path], *_: object) -> None:
    """Draw the saved content of a figure into a file, as a task."""
    saved_figures.draw_saved_figure(*contents_and_target)


def finding_records(findings: Mapping[str, Sequence[Finding]]) -> list[FindingRecord]:
    """Return the findings of several motions, the most severe first, then those without any.

    The normal range of a metric is named only once.
    """
    records: list[FindingRecord] = []
    norms: set[str] = set()
    for name, finding in rank_findings(findings)[: MAX_FINDINGS - 1]:
        sentence = finding.message if finding.normal_range in norms else finding.sentence
        norms.add(finding.normal_range)
        records.append(
            FindingRecord(
                motion_name=name,
                kind=finding.kind,
                sentence=truncate(sentence),
                worst_time_s=finding.worst_time_s,
                part=body_part(finding),
            )
        )
    labels = short_names(name for name in findings if name != REFERENCE_NAME)
    clean = [label for name, label in labels.items() if not findings[name]]
    if clean:
        which = f" in {join_names(clean)}" if len(labels) > 1 else ""
        records.append(FindingRecord(sentence=truncate(f"No findings{which}.")))
    return records
