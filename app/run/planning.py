"""A plan of speech without its motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import RunError
from app.run.request import MAX_GUIDANCE, WordsAsked
from app.run.words import SpokenWords

if TYPE_CHECKING:
    from model.plan.plan import GesturePlan

MAX_SPEECH_S = 3600.0


@dataclass(frozen=True)
class PlanRequest:
    """What is to be planned, and where the plan goes."""

    speech: Path
    out: Path
    weights: Path
    speaker: str | None = None
    """None is the first speaker that the system knows."""
    seed: int = 0
    guidance: float | None = None
    """Strength of the speech; None as suits the planner."""
    transcript: Path | None = None
    """See `GenerateRequest.transcript`."""
    words: WordsAsked = "none"


def make_plan(request: PlanRequest) -> GesturePlan:
    """Draw the plan and write it.

    Raises:
        RunError, SpeechError, TranscriptError, UnknownNameError, CheckpointError, WriteError: each
        with one sentence for the person who asked.
    """
    from app.run.models import get_system
    from model.generation.windows import GenerateOptions, draw_plans
    from model.speech.audio import SpeechLimits, load_speech
    from model.systems.planned.config import PLANNED

    if request.guidance is not None and not 0 <= request.guidance <= MAX_GUIDANCE:
        raise RunError(f"Guidance must be 0 to {MAX_GUIDANCE}; got {request.guidance:g}.")
    if request.seed < 0:
        raise RunError(f"The seed must not be negative; got {request.seed}.")
    system = get_system(PLANNED, request.weights)
    speech = load_speech(request.speech, SpeechLimits(max_s=MAX_SPEECH_S))
    with SpokenWords(request.transcript, request.words) as words:
        words.begin(speech.waveform)
        said, _ = words.found(lambda: None)
    options = GenerateOptions(
        request.speaker or next(iter(system.speakers)),
        seed=request.seed,
        guidance=request.guidance,
        words=said.words,
    )
    (plan,) = draw_plans(system, speech, options)
    plan.write(request.out)
    return plan
