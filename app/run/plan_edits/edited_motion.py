"""Takes: motions of a run after an edit of its plan, generated again where it changed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from app import text
from app.errors import RunError
from app.run.bodies import make_point_tracker
from app.run.callbacks import FolderUpdated, RunCallbacks
from app.run.generated_motions import generation_options
from app.run.models import get_system
from app.run.output.result_folder import ResultFolder, require_free_space
from app.run.output.run_folder import (
    MAX_RUN_BYTES,
    EditInfo,
    Row,
    RunRecord,
    existing_file,
    locked_record,
    make_rows,
    read_run,
    viewer_file_name,
)
from app.run.plan_edits.edits import EditResult, PlanEditRequest, apply_edits, find_alternatives
from app.run.requests.parts import SamplingOptions
from app.run.run_writer import RunWriter
from app.run.timeline import motion_curves, read_transcript_of_run
from conventions.names import PostFilter, SampleName, safe_file_stem, version_after_post_filter
from conventions.rates import FPS
from model.generation.base import System
from model.generation.regenerate import (
    STATE_SUFFIX,
    GenerationState,
    regenerate,
    restore_state,
    save_windows,
)
from model.generation.windows import GenerateOptions
from model.motion.motion import Motion, load_motion
from model.motion.transforms import apply_post_filter
from model.plan import kinds
from model.plan.editing import GestureKey, other_hand_gesture
from model.plan.files import read_plan_file
from model.plan.kinds import HOLD_S, PREPARATION_S, STROKE_S, TWO_HANDED_KINDS, USUAL_STROKE_GOALS
from model.plan.plan import GesturePlan, PlanError
from model.plan.style import style_of
from model.speech.audio import Speech, SpeechReadOptions, load_speech
from model.speech.transcript import Word
from model.storage.json_validation import read_json, type_adapter

MAX_TAKES = 60
"""Maximum number of takes of a run."""
MAX_EDITED_S = 180.0
"""Maximum length of a speech with takes (s); each take uses a megabyte for eight seconds."""
_BYTES_A_SECOND = 500_000


class _TakeWriter(RunWriter):
    """Writer of one more row into the folder of a finished run."""

    def write_record(self) -> None:
        with locked_record(self.folder.out) as record:
            for row in self.record.rows:
                record.set_row(row)
            record.files += [name for name in self.record.files if name not in record.files]
        self.on_event(FolderUpdated(self.folder.out))


def regenerate_edited(request: PlanEditRequest, callbacks: RunCallbacks) -> EditResult:
    """Apply edits to a plan, and generate its motion again, published window by window.

    Raises Cancelled, and RunError, PlanError, SpeechError, CheckpointError, WriteError, each with
    one sentence.
    """
    record = read_run(request.run)
    sampling, sound = _as_the_run(request, record)
    start = record.row(request.source_row)
    performed = start and existing_file(request.run, start.files.get("input_plan"))
    if start is None or performed is None:
        raise RunError(text.EDITS_GONE)
    plan, words = read_plan_file(performed).plan, read_transcript_of_run(request.run).words
    if plan.duration_s > MAX_EDITED_S:
        raise RunError(
            f"This speech lasts {plan.duration_s:.0f} s; gestures can be edited in speech of at "
            f"most {MAX_EDITED_S:.0f} s. Generate motion for a part of it instead."
        )
    numbers = [row.edit.take_number for row in record.rows if row.edit]
    if request.edits and len(numbers) >= MAX_TAKES:
        raise RunError(text.TOO_MANY_TAKES.format(limit=MAX_TAKES))
    require_free_space(request.run, int(_BYTES_A_SECOND * plan.duration_s))
    of = start.edit.original_row if start.edit else start.name
    sample = SampleName.parse(of)
    system = get_system(sample.system, sampling.weights)
    speech = load_speech(sound, SpeechReadOptions(max_s=request.max_speech_s))
    with ResultFolder(request.run, is_incremental=True) as folder:
        options = generation_options(
            sampling, system, num_samples=1, first_sample=sample.number - 1
        )
        before = _ready(request.run, start, system, speech, options, plan, words, callbacks)
        if not request.edits:
            return EditResult(0)
        try:
            done = apply_edits(plan, request.edits, words)
        except PlanError as error:
            offers = find_alternatives(plan, request.edits[-1], words)
            if len(request.edits) > 1 or not offers:
                raise
            return EditResult(0, (str(error),), offers)
        number = 1 + max(numbers, default=0)
        name = f"{of}.take{number}"
        row = make_rows([*(each.name for each in record.rows), name])[-1]
        row.label = f"version {number}"
        row.edit = take = EditInfo(take_number=number, original_row=of, parent_row=start.name)
        alone = RunRecord(kind=record.kind, tracked_point=record.tracked_point, rows=[row])
        (row,) = alone.rows
        run = _TakeWriter(folder, alone, callbacks)
        written = run.write_plan(name, done.plan)
        beside = load_motion(_there(request.run, record, of))

        def on_piece(motion: Motion) -> None:
            if sampling.post_filter != "savgol":
                run.append_motion(name, motion, speech.num_motion_frames, aligned_like=beside)

        options = replace(options, conditions=(written,))
        made = regenerate(system, speech, options, before, callbacks.should_cancel, on_piece)
        take.regenerated_s = [(part.start / FPS, part.stop / FPS) for part in made.changed_frames]
        row.files["state"] = viewer_file_name(name, STATE_SUFFIX)
        save_windows(made, request.run / row.files["state"])
        shown = apply_post_filter(made.motion, sampling.post_filter)
        run.write_motion(name, shown, f"{safe_file_stem(name)}.npz")
        _tell(request.run, row, written, words)
        run.add_files(request.run / row.files["editor"])
        jerk = _add_curves(request, record, run, row, shown, sampling.post_filter)
        run.finish("")
    return EditResult(number, (*jerk, *done.notes))


def _add_curves(
    request: PlanEditRequest,
    record: RunRecord,
    run: RunWriter,
    row: Row,
    motion: Motion,
    post_filter: PostFilter,
) -> tuple[str, ...]:
    """Add the curves of a take to the run's timeline; return a sentence on its jerk."""
    path = existing_file(request.run, record.timeline)
    if path is None or row.edit is None:
        return ()
    timeline = read_json(path, dict[str, Any], MAX_RUN_BYTES)
    version = version_after_post_filter(post_filter)
    tracker = make_point_tracker(request.body, record.tracked_point)
    curves = timeline["curves"] | {row.name: motion_curves(motion, version, tracker)}
    run.write_timeline(timeline | {"curves": curves})
    jerk = [
        f"{np.mean(of[version]['jerk_m_s3']['values']):.0f}"
        for name in (row.name, row.edit.parent_row)
        if (of := curves.get(name))
    ]
    return (text.TAKE_JERK.format(" m/s³, before the edit ".join(jerk)),)


def _ready(
    folder: Path,
    row: Row,
    system: System,
    speech: Speech,
    options: GenerateOptions,
    plan: GesturePlan,
    words: Sequence[Word],
    callbacks: RunCallbacks,
) -> GenerationState:
    """Return the motion that a take starts from, generated again if its windows are missing."""
    windows = existing_file(folder, row.files.get("state"))
    if windows is not None:
        motion = load_motion(_there(folder, read_run(folder), row.name))
        return restore_state(windows, system, plan, motion)
    performed = replace(options, conditions=(plan,))
    made = regenerate(system, speech, performed, None, callbacks.should_cancel)
    row.files["state"] = viewer_file_name(row.name, STATE_SUFFIX)
    save_windows(made, folder / row.files["state"])
    _tell(folder, row, plan, words)
    with locked_record(folder) as record:
        record.set_row(row)
    return made


def _tell(folder: Path, row: Row, plan: GesturePlan, words: Sequence[Word]) -> None:
    """Write the editor's data of a row, which can be edited from then on."""
    row.files["editor"] = viewer_file_name(row.name, ".told.json")
    (folder / row.files["editor"]).write_text(
        json.dumps(plan_editor_json(plan, words), allow_nan=False)
    )


def _there(folder: Path, record: RunRecord, name: str) -> Path:
    row = record.row(name)
    path = row and existing_file(folder, row.files.get("motion"))
    if path is None:
        raise RunError(text.EDITS_GONE)
    return path


def plan_editor_json(plan: GesturePlan, words: Sequence[Word]) -> dict[str, Any]:
    """Return the plan editor's JSON: gestures, style parameters and available gesture types."""
    gestures = []
    for stroke in kinds.group_gesture_phases(plan):
        phases = plan.hand(stroke.side)[stroke.first_index : stroke.last_index + 1]
        lands = stroke.last_stroke
        holds = [each for each in phases if each.phase == "hold" and each.start_s >= lands.end_s]
        hold_s = sum(each.end_s - each.start_s for each in holds)
        partner = other_hand_gesture(plan, GestureKey(stroke.side, lands.end_s))
        gestures.append({
            "side": stroke.side, "start": phases[0].start_s, "end": phases[-1].end_s,
            "lands": lands.end_s, "hold": round(hold_s, 4), "kind": lands.kind,
            "partner": None if partner is None else partner.stroke_end_s,
        })  # fmt: skip
    return {
        "gestures": sorted(gestures, key=lambda each: (each["lands"], each["side"])),
        "style": {name: round(value, 4) for name, value in asdict(style_of(plan)).items()},
        "kinds": {
            kind: "both" if kind in TWO_HANDED_KINDS else "right"
            for kind in sorted(USUAL_STROKE_GOALS)
        },
        "places": dict(USUAL_STROKE_GOALS),
        "around": [-STROKE_S - PREPARATION_S, HOLD_S],
        "words": [[word.start_s, word.end_s, word.text] for word in words],
    }


def _as_the_run(request: PlanEditRequest, record: RunRecord) -> tuple[SamplingOptions, Path]:
    """Return the sampling options and the speech of a run."""
    speech = existing_file(request.run, record.audio)
    if record.kind != "generated" or speech is None:
        raise RunError(text.EDITS_GONE)
    try:
        sampling = type_adapter(SamplingOptions).validate_python(record.request.get("sampling", {}))
    except ValidationError as error:
        raise RunError(text.EDITS_GONE) from error
    seed = sampling.seed if record.noise_seed is None else record.noise_seed
    return replace(sampling, weights=request.weights, seed=seed), speech
