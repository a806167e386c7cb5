"""Numbers of anyone's motion, what stands out in it, and the plan that it seems to follow."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from app.notebook.inputs import (
    MotionLike,
    SpeechLike,
    named_motions,
    read_motion,
    read_speech,
)
from app.run.diagnostics import measure_motions, onsets_of
from app.run.followed_point import TIP, choose_tip_source
from app.run.models import get_body
from app.run.output.bars import Bars
from conventions.names import REFERENCE_NAME
from model.diagnostics import Diagnostics
from model.measures.lag import heard_of
from model.motion.kinematics import open_body_skeleton
from model.plan.found import found_plan
from model.plan.plan import GesturePlan


def diagnose(
    motions: MotionLike | Mapping[str, MotionLike],
    *,
    reference: MotionLike | None = None,
    speech: SpeechLike | None = None,
    joint: str = TIP,
    progress: bool = True,
) -> Diagnostics:
    """Measure motions, raw and filtered, and name their faults.

    Args:
        motions: one, or several by name.
        reference: recorded motion to compare with; all are then cut to the shortest.
        speech: the sound that all of them belong to, for BeatAlign.
        joint: the fingertip or joint that the ``tip_`` measures follow.

    Returns:
        ``systems`` and ``findings`` by name; ``as_json()`` is what ``diagnostics.json`` holds.

    Raises:
        ValueError: of what cannot be done, with one sentence.
    """
    named = named_motions(motions)
    if reference is not None:
        named[REFERENCE_NAME] = read_motion(reference)
    tip = choose_tip_source(get_body(None), None, joint)
    sound = None if speech is None else read_speech(speech)
    with Bars(is_shown=progress, stays=False) as bars:
        return measure_motions(
            named,
            tip,
            onsets_s=None if sound is None else onsets_of(sound),
            heard=None if sound is None else heard_of(sound.waveform),
            on_share=partial(bars.show, "measure"),
        )


def find_plan(motion: MotionLike) -> GesturePlan:
    """Phases of both hands, nods, looks and steps, as they seem to be in a motion."""
    return found_plan(read_motion(motion), open_body_skeleton())
