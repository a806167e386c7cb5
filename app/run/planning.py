"""A plan of speech without its motion, or of a motion without its speech."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import RunError
from app.flags import MANNER, SEED, WEIGHTS, flag
from app.run.requests.request import (
    ASSUME,
    CHANNEL,
    MAX_GUIDANCE,
    STYLE,
    TRANSCRIPT,
    WORDS,
    WordsAsked,
)
from app.run.words import SpokenWords
from model.formats.reading import Told

if TYPE_CHECKING:
    from model.plan.editing import Edited

MAX_SPEECH_S = 3600.0


@dataclass(frozen=True)
class PlanRequest:
    """What is to be planned, and where the plan goes."""

    speech: Path = field(
        metadata=flag("any sound file, or a motion", "SPEECH|MOTION", Path, is_positional=True)
    )
    out: Path = field(
        metadata=flag("ends in .json, or in .TextGrid or .eaf for Praat and ELAN", "FILE", Path)
    )
    weights: Path = field(metadata=WEIGHTS)
    speaker: str | None = field(default=None, metadata=MANNER)
    """None is the first speaker that the system knows."""
    seed: int = field(default=0, metadata=SEED)
    guidance: float | None = field(
        default=None,
        metadata=flag(
            "strength of the speech, 0 to 10; 1 is as trained (default: as suits the planner)",
            "N",
            float,
        ),
    )
    """Strength of the speech; None as suits the planner."""
    channel: int | None = field(default=None, metadata=CHANNEL)
    """See `GenerateRequest.channel`."""
    transcript: Path | None = field(default=None, metadata=TRANSCRIPT)
    """See `GenerateRequest.transcript`."""
    words: WordsAsked = field(default="none", metadata=WORDS)
    is_empty: bool = field(
        default=False,
        metadata=flag("draw nothing: leave the tiers to be annotated by hand", name="--empty"),
    )
    """Of the speech's length with nothing in it, to be filled in by hand."""
    told: Told = field(default=Told(), metadata=ASSUME)
    """How a motion is to be read."""
    style: Path | None = field(default=None, metadata=STYLE)
    """A style file (`model.plan.style`), done to the plan."""


def is_motion(path: Path) -> bool:
    """Whether a file's ending is that of a motion."""
    from model.formats.read import ENDINGS

    return path.suffix.lower() in ENDINGS


def find_plan(motion: Path, out: Path, told: Told | None = None) -> list[str]:
    """Find the plan that a motion seems to follow and write it; what was changed to read it.

    Raises:
        MotionError, PlanError, WriteError: each with one sentence for the person who asked.
    """
    from model.formats.read import read_any_motion
    from model.motion.kinematics import open_body_skeleton
    from model.plan.files import check_ending, write_plan_file
    from model.plan.found import found_plan

    check_ending(out)
    (told or Told()).check([motion])
    read = read_any_motion(motion, told)
    write_plan_file(found_plan(read.motion, open_body_skeleton()), out)
    return list(read.notes)


def make_plan(request: PlanRequest) -> Edited:
    """Draw the plan and write it; with it what its style could not do.

    Raises:
        RunError, SpeechError, TranscriptError, UnknownNameError, CheckpointError, PlanError,
        WriteError: each with one sentence for the person who asked.
    """
    from app.run.models import get_system
    from model.generation.windows import GenerateOptions, draw_conditions
    from model.plan.editing import Edited
    from model.plan.files import check_ending, write_plan_file
    from model.plan.plan import GesturePlan
    from model.plan.style import read_wish
    from model.speech.audio import SpeechLimits, load_speech
    from model.systems.registry import usual_planner

    if request.guidance is not None and not 0 <= request.guidance <= MAX_GUIDANCE:
        raise RunError(f"Guidance must be 0 to {MAX_GUIDANCE}; got {request.guidance:g}.")
    if request.seed < 0:
        raise RunError(f"The seed must not be negative; got {request.seed}.")
    check_ending(request.out)
    if request.is_empty and request.style is not None:
        raise RunError("An empty plan has no style; leave one of the two out.")
    speech = load_speech(request.speech, SpeechLimits(max_s=MAX_SPEECH_S, channel=request.channel))
    if request.is_empty:
        plan = GesturePlan(speech.duration_s)
        write_plan_file(plan, request.out, request.speech)
        return Edited(plan)
    wish = None if request.style is None else read_wish(request.style)
    system = get_system(usual_planner(), request.weights)
    with SpokenWords(request.transcript, request.words) as words:
        words.begin(speech.waveform)
        said, _ = words.found(lambda: None)
    options = GenerateOptions(
        request.speaker or next(iter(system.speakers)),
        seed=request.seed,
        guidance=request.guidance,
        words=said.words,
    )
    (plan,) = draw_conditions(system, speech, options)
    edited = Edited(plan) if wish is None else wish.done(plan, said.words)
    write_plan_file(edited.plan, request.out, request.speech)
    return edited
