"""A take: the motion of a run after its plan was changed, made anew where it has to be."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.errors import CancelledRun, RunError
from app.run.output.result_folder import ResultFolder, require_free_space
from app.run.output.run_folder import RunRecord
from app.run.requests.request import GenerateRequest, OnEvent, ShouldCancel, steps_of
from app.run.run_writer import RunWriter
from app.run.takes.edits import Edit, Locked, edited
from conventions.names import SampleName, file_stem
from model.speech.transcript import Word

if TYPE_CHECKING:
    from model.generation.base import System
    from model.generation.windows import GenerateOptions
    from model.motion.motion import Motion
    from model.plan.plan import GesturePlan

MAX_EDITED_S = 180.0
"""Speech of which takes are made: each keeps a megabyte for eight seconds."""
_BYTES_A_SECOND = 500_000


@dataclass(frozen=True)
class TakeFiles:
    """What is kept of a take, to go on from it."""

    plan: Path
    motion: Path
    windows: Path


@dataclass(frozen=True)
class TakeRequest:
    """Which motion is to be changed, and how."""

    run: GenerateRequest
    """That the motion is of."""
    system: str
    sample: int
    """From 1."""
    name: str
    """Of the take's row."""
    out: Path
    plan: Path
    """As which the take that the edits start from moves."""
    before: TakeFiles | None
    """The take itself; None of the first, whose windows nobody has kept yet."""
    beside: Path
    """A motion: takes are laid beside the others as this one is."""
    edits: tuple[Edit, ...] = ()
    """None is the plan as it is."""
    locked: tuple[Locked, ...] = ()
    words: tuple[Word, ...] = ()


@dataclass(frozen=True)
class Take:
    """What has become of it."""

    files: TakeFiles
    told: Path
    """What an editor shows, as JSON: `told_of`."""
    notes: tuple[str, ...] = field(default=())
    """What was mended, in sentences."""
    fresh_s: tuple[tuple[float, float], ...] = ()
    """The stretches that were made anew."""


def make_take(request: TakeRequest, on_event: OnEvent, should_cancel: ShouldCancel) -> Take:
    """Change the plan and perform it again; of the motion each window is told as it is made.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError, PlanError, SpeechError, CheckpointError, WriteError: with one sentence.
    """
    from model.plan.plan import read_plan

    plan = read_plan(request.plan)
    if plan.duration_s > MAX_EDITED_S:
        raise RunError(
            f"This speech lasts {plan.duration_s:.0f} s; gestures are edited in speech of at most "
            f"{MAX_EDITED_S:.0f} s: cut it, and generate motion for a part."
        )
    done = edited(plan, request.edits, request.words, request.locked)
    request.out.mkdir(parents=True, exist_ok=True)
    require_free_space(request.out, int(_BYTES_A_SECOND * plan.duration_s))
    record = RunRecord(kind="generated", title=request.name, point=request.run.joint)
    with (
        ResultFolder(request.out, is_kept=True) as folder,
        RunWriter(folder, record, on_event, should_cancel) as run,
    ):
        run.rows([request.name])
        written = run.performed(request.name, done.plan)
        told = folder.path(f"{file_stem(request.name)}.told.json")
        told.write_text(json.dumps(told_of(written, request.words), allow_nan=False))
        take = _performed(request, written, folder, file_stem(request.name), run)
        run.finish("")
    return Take(take.files, take.told, done.notes, take.fresh_s)


def _performed(
    request: TakeRequest,
    plan: GesturePlan,
    folder: ResultFolder,
    stem: str,
    run: RunWriter,
) -> Take:
    from app.run.models import get_system
    from conventions.rates import FPS
    from model.generation.again import (
        ENDING,
        KeptError,
        load_performance,
        perform,
        perform_again,
        save_performance,
    )
    from model.generation.windows import Cancelled
    from model.motion.filtering import smooth_motion
    from model.motion.motion import load_motion
    from model.plan.plan import read_plan
    from model.speech.audio import SpeechLimits, load_speech

    asked = request.run
    system = get_system(request.system, asked.weights)
    speech = load_speech(asked.speech, SpeechLimits(max_s=asked.max_speech_s))
    options = options_of(request, system, plan)
    is_smoothed = asked.post_filter == "savgol"
    beside = load_motion(request.beside)

    def on_piece(motion: Motion) -> None:
        if not is_smoothed:
            run.grow(request.name, motion, speech.num_frames, like=beside)

    try:
        if request.before is None:
            made = perform(system, speech, options, run.should_cancel, on_piece)
        else:
            kept = request.before
            old = load_performance(
                kept.windows, system, read_plan(kept.plan), load_motion(kept.motion)
            )
            made = perform_again(system, speech, options, old, run.should_cancel, on_piece)
    except Cancelled as error:
        raise CancelledRun from error
    except KeptError as error:
        raise RunError(str(error)) from error
    save_performance(made, folder.path(f"{stem}{ENDING}"))
    shown = smooth_motion(made.motion) if is_smoothed else made.motion
    run.motion(request.name, shown, f"{stem}.npz")
    names = (f"{stem}.plan.json", f"{stem}.npz", f"{stem}{ENDING}")
    files = TakeFiles(*(request.out / name for name in names))
    fresh = tuple((part.start / FPS, part.stop / FPS) for part in made.fresh)
    return Take(files, request.out / f"{stem}.told.json", (), fresh)


def options_of(request: TakeRequest, system: System, plan: GesturePlan) -> GenerateOptions:
    """What the run asked of the system for this one motion."""
    from model.generation.windows import GenerateOptions

    run = request.run
    known = {sampler.name for sampler in system.samplers}
    sampler = system.sampler(run.sampler if run.sampler in known else None)
    asked = steps_of(run.steps, system.name), steps_of(run.face_steps, system.name)
    steps, face_steps = sampler.counts(asked[0], asked[1] if sampler.face_steps else None)
    return GenerateOptions(
        speaker=run.speaker or next(iter(system.speakers)),
        seed=run.seed,
        steps=steps,
        face_steps=face_steps,
        sampler=sampler.name,
        guidance=system.strength(None if system.guidance is None else run.guidance),
        first_sample=request.sample - 1,
        conditions=(plan,),
    )


def told_of(plan: GesturePlan, words: Sequence[Word]) -> dict[str, Any]:
    """What an editor shows of a plan: its gestures with what each is like, the head's and the
    eyes' events, the style of the whole, and what can be added."""
    from model.plan.editing import Gesture as Which
    from model.plan.editing import partner_of
    from model.plan.kinds import PLACES, strokes_of
    from model.plan.style import style_of

    gestures = []
    for stroke in strokes_of(plan):
        phases = plan.hand(stroke.side)[stroke.first : stroke.last + 1]
        lands = stroke.lands
        holds = [each for each in phases if each.phase == "hold" and each.start_s >= lands.end_s]
        hold_s = sum(each.end_s - each.start_s for each in holds)
        partner = partner_of(plan, Which(stroke.side, lands.end_s))
        gestures.append({
            "side": stroke.side, "start": phases[0].start_s, "end": phases[-1].end_s,
            "strikes": lands.start_s, "lands": lands.end_s, "hold": round(hold_s, 4),
            "kind": lands.kind, "word": lands.word,
            "partner": None if partner is None else partner.lands_s,
        })  # fmt: skip
    return {
        "duration": plan.duration_s,
        "gestures": sorted(gestures, key=lambda each: (each["lands"], each["side"])),
        "nods": [each.time_s for each in plan.nods],
        "looks": [[each.start_s, each.end_s, each.yaw_deg, each.pitch_deg] for each in plan.looks],
        "blinks": [each.time_s for each in plan.blinks],
        "style": {name: round(value, 4) for name, value in asdict(style_of(plan)).items()},
        "kinds": sorted(PLACES),
        "words": [[word.start_s, word.end_s, word.text] for word in words],
    }


def row_of(name: str, systems: Sequence[str], samples: int) -> tuple[str, int]:
    """System and sample of a row of a run.

    Raises:
        RunError: if the run has no such row.
    """
    for row in (SampleName(name), SampleName.parse(name)):
        if row.system in systems and row.number <= samples:
            return row.system, row.number
    raise RunError("This run has no such motion; choose one that moves by a plan.")
