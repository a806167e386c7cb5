"""Writes a run's folder while the run goes on: what viewers need beside the results, and the
`run.json` that names all of it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from app.errors import Cancelled, sentence_of
from app.findings.measure_rows import numbers_of, parts_apart
from app.findings.sentences import sentences_of
from app.findings.verdict import verdict_of
from app.run.bodies import Register, TipSource, register_of
from app.run.callbacks import DEAF, Ear, Grown
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import (
    MAX_ROWS,
    MAX_TOLD,
    RUN,
    SPEECH,
    TIMELINE,
    AssumedTold,
    Row,
    RowKind,
    RunRecord,
    There,
    Told,
    ToldVerdict,
    cut,
    rows_of,
    shown_file,
)
from app.run.pieces import MAX_FRAMES, frames_message
from app.run.timeline import (
    make_timeline,
    tiers_of,
    waveform_of,
)
from conventions.names import REFERENCE_NAME, VERSIONS, file_stem, listed, short_names
from model.diagnostics import Diagnostics
from model.faults.evidence import Finding, ranked
from model.formats.read import Reading
from model.generation.base import Windowing
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, put_together, save_motion
from model.plan.files import read_plan_file, write_plan_file
from model.plan.found import found_plan
from model.plan.plan import GesturePlan
from model.speech.audio import Speech, write_wav
from model.speech.transcript import Transcript
from model.storage.harmless import csv_text
from renderer.body.body import Body
from renderer.figures import kept
from renderer.figures.style import CONTENTS_ENDING, FORMS, Places, written

_GROWN = 1.2
"""So many times as long, a motion may stand elsewhere among the others."""
FAULT = "The program failed in the middle of this run."


@dataclass
class _Growing:
    """One row's motion while it is made."""

    path: Path
    register: Register | None
    is_placed: bool
    parts: list[Motion] = field(default_factory=list)
    end: int = 0
    register_at: int = 0

    def placed(self, num_frames: int) -> Register:
        """Of the whole at its end; before it from time to time, as it takes all frames so far."""
        is_due = self.end >= min(_GROWN * self.register_at, num_frames)
        if self.register is None or (is_due and not self.is_placed):
            self.register = register_of(put_together(self.parts))
            self.register_at = self.end
        return self.register


@dataclass(frozen=True)
class Rows:
    """The motions of one run, generated or given, and what is known of them before they are
    measured; all by name, the reference last."""

    measured: Mapping[str, Motion]
    staged: Mapping[str, Motion]
    """As the stage plays them: of the given no more than fit, laid onto each other; of the
    generated behind the filter."""
    drawn: Mapping[str, Motion]
    """As figures have them: no more than fit."""
    timeline: dict[str, Any]
    body: Body
    tip: TipSource
    sound: Path | None
    """Of videos; None where there is no speech."""
    onsets_s: np.ndarray | None
    windows: Mapping[str, Windowing]
    """How each was cut, where that is known."""
    heard: np.ndarray | None = None
    """Of the speech frame by frame, for how late given motions are."""
    mean_speeds: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    """Of reading the given ones; they go to the numbers."""
    readings: Mapping[str, Reading] = field(default_factory=dict)
    """Of the given."""
    origin: Mapping[str, Any] = field(default_factory=dict)
    """What made the generated, for the record."""

    @property
    def is_made(self) -> bool:
        return bool(self.origin)


@contextmanager
def writing_run(
    out: Path,
    record: RunRecord,
    ear: Ear = DEAF,
    *,
    is_kept: bool = False,
) -> Iterator[RunWriter]:
    """Keep a run's folder for the block, as `ResultFolder`; of a block that is left by an error it
    is said in ``run.json``."""
    with ResultFolder(out, is_kept=is_kept) as folder:
        run = RunWriter(folder, record, ear)
        try:
            yield run
        except BaseException as error:
            is_cancelled = isinstance(error, Cancelled)
            record.state = "cancelled" if is_cancelled else "failed"
            record.sentence = "" if is_cancelled else cut(sentence_of(error) or FAULT)
            with suppress(Exception):
                run.tell()
            raise


class RunWriter(Ear):
    """Tells of a run by its folder."""

    def __init__(self, folder: ResultFolder, record: RunRecord, ear: Ear = DEAF) -> None:
        super().__init__(ear.hear, ear.should_cancel)
        self.notes: list[str] = []
        self.folder = folder
        self.record = record
        self._path = folder.path(RUN, grows=True)
        self._growing: dict[str, _Growing] = {}
        self.tell()

    def note(self, *sentences: str) -> None:
        """Keep what the person should read; each sentence once."""
        self.notes.extend(note for note in sentences if note not in self.notes)

    def tell(self) -> None:
        """Write what is known, and say so."""
        self.record.notes = [cut(note) for note in self.notes[:MAX_TOLD]]
        self.record.write(self._path)
        self.hear(Grown(self._path.parent))

    def finish(self, sentence: str) -> None:
        """All has come."""
        self.record.state, self.record.sentence = "done", cut(sentence)
        self.tell()
        self.folder.publish()

    def rows(self, names: Iterable[str]) -> None:
        """All that there will be, in their order."""
        self.record.rows = rows_of(list(names)[:MAX_ROWS])

    def _row(self, name: str) -> Row:
        row = self.record.row(name)
        assert row is not None
        return row

    def file(self, *paths: Path, row: str = "", kind: RowKind | None = None) -> None:
        """Note files that are whole.

        Args:
            row: that shows them, as what ``kind`` says.
        """
        of = self.record.row(row)
        for path in paths:
            whole = self.folder.whole(path)
            if whole not in self.record.files:
                self.record.files.append(whole)
            if of is not None and kind is not None:
                of.files[kind] = whole
        self.tell()

    def table(self, name: str, told: object, rows: Iterable[Iterable[object]]) -> None:
        """What was measured, as JSON and as CSV."""
        numbers, table = (self.folder.path(f"{name}.{ending}") for ending in ("json", "csv"))
        numbers.write_text(json.dumps(told, indent=1) + "\n")
        table.write_text(csv_text(rows), "utf-8", newline="")
        self.file(numbers, table)

    def figure(self, name: str, contents: Any, caption: str, forms: Sequence[str] = FORMS) -> None:
        """Draw one of `renderer.figures.kept.DRAW` in some forms; where these are not all, keep
        what the others can be drawn from."""
        stem = self.folder.path(f"{name}.png").with_suffix("")
        places: Places = []
        files = written(lambda: kept.DRAW[name](contents), stem, caption, forms, places)
        if set(forms) != set(FORMS):
            path = self.folder.path(shown_file(name, CONTENTS_ENDING))
            kept.save_contents(path, name, contents, caption, places)
            self.file(path)
        self.file(*(self.folder.path(path.name) for path in files))

    def grow(self, name: str, motion: Motion, num_frames: int, like: Motion | None = None) -> None:
        """Motion that goes on with what there is of a row, which is to have so many frames.

        Args:
            like: a motion as which it is laid onto the others; None is by itself.
        """
        if num_frames > MAX_FRAMES:
            return
        row = self._row(name)
        if name not in self._growing:
            path = self.folder.path(shown_file(name, ".frames"), grows=True)
            path.unlink(missing_ok=True)
            register = None if like is None else register_of(like)
            self._growing[name] = _Growing(path, register, like is not None)
        growing = self._growing[name]
        with growing.path.open("ab") as file:
            file.write(frames_message(growing.end, motion))
            size = file.tell()
        growing.parts.append(motion)
        growing.end += motion.num_frames
        place = growing.placed(num_frames)
        row.files["frames"] = self.folder.whole(growing.path)
        row.there = There(
            end=growing.end,
            num_frames=num_frames,
            bytes=size,
            place=(place.turn_rad, *place.shift_m),
        )
        self.tell()

    def motion(self, name: str, motion: Motion, file_name: str = "") -> None:
        """A row's whole motion, as it is shown.

        Args:
            file_name: where it is kept; by default among what only a player shows.
        """
        path = self.folder.path(file_name or shown_file(name, ".npz"))
        save_motion(motion, path)
        if name not in self._growing:
            self.grow(name, motion, motion.num_frames)
        self.file(path, row=name, kind="motion")

    def sound(self, waveform: np.ndarray) -> Path:
        """What is heard: 16 kHz."""
        path = self.folder.path(SPEECH)
        write_wav(path, waveform)
        self.record.sound = SPEECH
        self.file(path)
        return self.folder.at(SPEECH)

    def show(
        self,
        motions: Mapping[str, Motion],
        speech: Speech | None,
        tip: TipSource,
        weights: Path | None = None,
        plans: Mapping[str, Path] | None = None,
    ) -> dict[str, Any]:
        """Motions that are there, and what is heard: as long as the longest of them, silent without
        speech. Returns their time line.

        Args:
            weights: where the speech encoder is whose accents are told; None tells none.
            plans: that they performed, by name.
        """
        self.rows(motions)
        self.sound(waveform_of(speech, motions))
        for name in sorted(motions.keys() & (plans or {}).keys()):
            self.performed(name, read_plan_file((plans or {})[name]).plan)
        for name, motion in motions.items():
            self.motion(name, motion)
        return make_timeline(speech, motions, "raw", tip, weights)

    def timeline(self, timeline: Mapping[str, Any], said: Transcript) -> None:
        """What is seen under the bodies; also again, with words that were looked for."""
        path = self.folder.path(TIMELINE)
        whole = {**timeline, **tiers_of(said)}
        path.write_text(json.dumps(whole, allow_nan=False, separators=(",", ":")))
        self.record.timeline = TIMELINE
        self.file(path)

    def performed(self, name: str, plan: GesturePlan) -> GesturePlan:
        """Leave a row's plan beside its motion; given back with the decimals that anybody finds in
        the file."""
        path = self.folder.path(f"{file_stem(name)}.plan.json")
        write_plan_file(plan, path)
        written = read_plan_file(path).plan
        self._row(name).files["plan"] = path.name
        self.file(path, row=name, kind="performed")
        return written

    def find_plans(self, motions: Mapping[str, Motion]) -> None:
        """What those rows seem to follow that performed no plan."""
        for name, motion in motions.items():
            if "plan" not in self._row(name).files:
                path = self.folder.path(shown_file(name, ".plan.json"))
                write_plan_file(found_plan(motion, open_body_skeleton()), path)
                self.file(path, row=name, kind="plan")

    def measured(self, diagnostics: Diagnostics) -> None:
        """Numbers that nothing will change any more, and what they say."""
        record, is_made = self.record, self.record.kind == "generated"
        record.point = diagnostics.point
        of_all = sorted(diagnostics.of_all.items(), key=lambda of: of[0] != REFERENCE_NAME)
        apart = parts_apart(diagnostics.lacks)
        record.numbers = {
            name: {
                kind: numbers_of(versions.of(kind), apart=apart.get(name, ())) for kind in VERSIONS
            }
            for name, versions in of_all[:MAX_ROWS]
        }
        record.findings = findings_told(diagnostics.findings)
        verdict = verdict_of(record.point, [record.numbers], is_made)
        if verdict is not None and (is_made or len(of_all) > 1):
            record.verdict = ToldVerdict(
                numbers=cut(verdict.numbers), judgement=cut(verdict.judgement)
            )
        record.says = {key: cut(said) for key, said in sentences_of(diagnostics).items()}
        for row in record.rows:
            row.assumed = cast(list[AssumedTold], diagnostics.assumed.get(row.name, []))
        self.tell()


def draw_figure(asked: tuple[Path, Path], *_: object) -> None:
    """Draw a figure from what a run has kept of it into a file, as a task."""
    kept.draw_saved(*asked)


def findings_told(findings: Mapping[str, Sequence[Finding]]) -> list[Told]:
    """Of several motions, the gravest first, what people do told once; last, and of no name, in
    which there is nothing."""
    told: list[Told] = []
    norms: set[str] = set()
    for name, finding in ranked(findings)[: MAX_TOLD - 1]:
        sentence = finding.said if finding.people in norms else finding.sentence
        norms.add(finding.people)
        told.append(Told(name=name, kind=finding.kind, sentence=cut(sentence), at=finding.worst_s))
    labels = short_names(name for name in findings if name != REFERENCE_NAME)
    clean = [label for name, label in labels.items() if not findings[name]]
    if clean:
        which = f" in {listed(clean)}" if len(labels) > 1 else ""
        told.append(Told(sentence=cut(f"Nothing stands out{which}.")))
    return told
