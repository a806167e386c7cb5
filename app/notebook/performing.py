"""Speech to motion and to plans, as a run of the page or of the command line makes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from app.errors import RunError
from app.notebook.comparing import Comparison, compare
from app.notebook.inputs import (
    MotionLike,
    PlanLike,
    SpeechLike,
    motion_in,
    plan_in,
    read_motion,
    read_speech,
    speech_in,
)
from app.notebook.showing import HEIGHT_PX, Player, show
from app.run.output.bars import Bars
from app.run.pipeline import do
from app.run.planning import make_plan
from app.run.requests.request import Ask
from conventions.names import REFERENCE_NAME, file_stem
from model.diagnostics import Diagnostics
from model.motion.motion import Motion, first_frames, load_motion
from model.plan.plan import GesturePlan, read_plan
from model.speech.audio import Speech
from model.speech.transcript import Transcript
from model.systems.registry import usual_planner

RUN = "run"
"""Folder of a run, beside what was handed over."""


@dataclass(frozen=True, eq=False)
class Performance:
    """What several systems made of one piece of speech, with the same noise."""

    speech: Speech
    motions: dict[str, Motion]
    """By system, and ``SYSTEM.s2`` and on of further samples; a recorded one as "reference"."""
    plans: dict[str, GesturePlan]
    """Of the systems that plan."""
    said: Transcript
    """Words with their times, where they were given or found."""
    diagnostics: Diagnostics
    notes: tuple[str, ...]
    """What a person should know, such as what was done to the speech."""
    _folder: TemporaryDirectory[str]
    """Holds the run's."""

    def __getitem__(self, name: str) -> Motion:
        return self.motions[name]

    def show(self, height: int = HEIGHT_PX) -> Player:
        """All bodies in lock-step with the sound, in a cell or as a file."""
        return show(Path(self._folder.name) / RUN, height=height)

    def compare(self) -> Comparison:
        """The measures beside each other."""
        return compare(self.motions, diagnostics=self.diagnostics)


def generate(
    speech: SpeechLike,
    systems: str | Sequence[str] | None = None,
    *,
    plan: PlanLike | None = None,
    reference: MotionLike | None = None,
    progress: bool = True,
    **asked: Any,
) -> Performance:
    """Generate motion of one or more systems, with the same noise.

    Args:
        systems: a name or several (`app.notebook.systems`); "all" are all there are, None is the
            one that plans.
        plan: what the systems that plan are to perform; None lets them plan.
        reference: recorded motion of the same speech, to be measured and shown beside.
        asked: further fields of `app.run.requests.request.Ask`, such as ``seed``, ``speaker``,
            ``samples``, ``steps``, ``transcript`` or ``words="recognise"``.

    Raises:
        ValueError: of what cannot be done, with one sentence.
    """
    systems = usual_planner() if systems is None else systems
    named = () if systems == "all" else (systems,) if isinstance(systems, str) else tuple(systems)
    held = TemporaryDirectory()
    folder = Path(held.name)
    ask = Ask(
        speech=speech_in(folder, speech),
        out=folder / RUN,
        systems=named,
        plan=None if plan is None else plan_in(folder, plan),
        reference=None if reference is None else motion_in(folder, reference),
        has_figures=False,
        **_fields(asked),
    )
    with Bars(is_shown=progress, stays=False) as bars:
        result = do(ask, bars.take)
    stems = {name: result.out / file_stem(name) for name in result.names if name != REFERENCE_NAME}
    motions = {name: load_motion(f"{stem}.npz") for name, stem in stems.items()}
    plans = {name: Path(f"{stem}.plan.json") for name, stem in stems.items()}
    if ask.reference is not None:
        motions[REFERENCE_NAME] = first_frames(read_motion(ask.reference), result.num_frames)
    return Performance(
        speech=read_speech(ask.speech or ""),
        motions=motions,
        plans={name: read_plan(path) for name, path in plans.items() if path.is_file()},
        said=result.said,
        diagnostics=result.diagnostics,
        notes=result.notes,
        _folder=held,
    )


def plan(speech: SpeechLike, **asked: Any) -> GesturePlan:
    """Draw what the system that plans is going to do with the speech; see `model.plan.plan`.

    Args:
        asked: as of `generate`.

    Raises:
        ValueError: of what cannot be done, with one sentence.
    """
    with TemporaryDirectory() as held:
        sound, out = speech_in(Path(held), speech), Path(held, "drawn.json")
        return make_plan(Ask(speech=sound, out=out, **_fields(asked))).plan


def _fields(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Of an ask, with files named by text, too.

    Raises:
        RunError: if there is no such field.
    """
    known = {field.name for field in fields(Ask)}
    for name in asked:
        if name == "recognise_words":
            raise RunError('recognise_words=True is words="recognise" now.')
        if name not in known:
            raise RunError(
                f"There is no {name!r} to ask for; there are {', '.join(sorted(known))}."
            )
    files = ("weights", "transcript", "style", "body")
    return {
        name: Path(value) if name in files and isinstance(value, str) else value
        for name, value in asked.items()
    }
