"""A plan of speech without its motion, or of a motion without its speech."""

from __future__ import annotations

from pathlib import Path

from app.errors import RunError
from app.run.ask import Ask
from app.run.made import options_of
from app.run.models import get_system
from app.run.words import SpokenWords
from model.formats.read import ENDINGS, Assumptions, read_any_motion
from model.generation.windows import draw_conditions
from model.motion.kinematics import open_body_skeleton
from model.plan.files import check_ending, write_plan_file
from model.plan.found import found_plan
from model.plan.plan import GesturePlan, Noted
from model.plan.style import read_wish
from model.speech.audio import SpeechLimits, load_speech
from model.systems.registry import usual_planner

MAX_SPEECH_S = 3600.0


def is_motion(path: Path) -> bool:
    """Whether a file's ending is that of a motion."""
    return path.suffix.lower() in ENDINGS


def find_plan(motion: Path, out: Path, told: Assumptions | None = None) -> list[str]:
    """Find the plan that a motion seems to follow and write it; what was changed to read it.

    Raises:
        MotionError, PlanError, WriteError: each with one sentence for the person who asked.
    """
    check_ending(out)
    (told or Assumptions()).check([motion])
    read = read_any_motion(motion, told)
    write_plan_file(found_plan(read.motion, open_body_skeleton()), out)
    return list(read.notes)


def make_plan(ask: Ask, *, is_empty: bool = False) -> Noted:
    """Draw a plan of speech and write it to the file ``ask.out``; with it what its style could not
    do.

    Args:
        is_empty: of the speech's length with nothing in it, to be filled in by hand.

    Raises:
        RunError, SpeechError, TranscriptError, UnknownNameError, CheckpointError, PlanError,
        WriteError: each with one sentence for the person who asked.
    """
    ask.check()
    check_ending(ask.out)
    if is_empty and ask.style is not None:
        raise RunError("An empty plan has no style; leave one of the two out.")
    sound = ask.speech or Path()
    speech = load_speech(sound, SpeechLimits(max_s=MAX_SPEECH_S, channel=ask.channel))
    if is_empty:
        plan = GesturePlan(speech.duration_s)
        write_plan_file(plan, ask.out, sound)
        return Noted(plan)
    wish = None if ask.style is None else read_wish(ask.style)
    system = get_system(usual_planner(), ask.weights)
    with SpokenWords(ask.transcript, ask.words) as words:
        words.begin(speech.waveform)
        said, _ = words.found(lambda: None)
    (plan,) = draw_conditions(system, speech, options_of(ask, system, words=said.words))
    edited = Noted(plan) if wish is None else wish.done(plan, said.words)
    write_plan_file(edited.plan, ask.out, sound)
    return edited
