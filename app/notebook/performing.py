"""Speech to motion and to plans, as a run of the page or of the command line makes them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from app.config import BUNDLED_WEIGHTS
from app.notebook.comparing import Comparison, compare
from app.notebook.inputs import (
    MotionLike,
    PlanLike,
    SpeechLike,
    motion_file,
    plan_file,
    read_motion,
    read_speech,
    speech_file,
)
from app.notebook.progress import Bar
from app.notebook.showing import HEIGHT_PX, Player, show
from app.run.pipeline import generate_all
from app.run.planning import PlanRequest, make_plan
from app.run.requests.request import GenerateRequest, Steps
from conventions.names import REFERENCE_NAME, PostFilter, file_stem
from model.diagnostics import Diagnostics
from model.motion.motion import Motion, first_frames, load_motion
from model.plan.plan import GesturePlan, read_plan
from model.speech.audio import Speech
from model.speech.transcript import Transcript
from model.systems.registry import usual_planner


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

    def __getitem__(self, name: str) -> Motion:
        return self.motions[name]

    def show(self, height: int = HEIGHT_PX) -> Player:
        """All bodies in lock-step with the sound, in a cell or as a file."""
        return show(
            self.motions, self.speech, plans=self.plans, said=self.said,
            findings=self.diagnostics.findings, height=height,
        )  # fmt: skip

    def compare(self) -> Comparison:
        """The measures beside each other."""
        return compare(self.motions, diagnostics=self.diagnostics)


def generate(
    speech: SpeechLike,
    systems: str | Sequence[str] | None = None,
    *,
    speaker: str | None = None,
    seed: int = 0,
    samples: int = 1,
    steps: Steps = None,
    sampler: str | None = None,
    guidance: float | None = None,
    post_filter: PostFilter = "none",
    plan: PlanLike | None = None,
    reference: MotionLike | None = None,
    transcript: str | Path | None = None,
    recognise_words: bool = False,
    weights: str | Path = BUNDLED_WEIGHTS,
    progress: bool = True,
) -> Performance:
    """Generate motion of one or more systems, with the same noise.

    Args:
        systems: a name or several (`app.notebook.systems`); "all" are all there are, None is the
            one that plans.
        speaker: in whose manner; None is the first that the systems know.
        samples: motions of each system, each from noise of its own.
        steps: of the sampler, of all systems or by name.
        guidance: strength of the speech, 0 to 10; 1 is as trained, None as suits each system.
        plan: what the systems that plan are to perform; None lets them plan.
        reference: recorded motion of the same speech, to be measured and shown beside.
        transcript: a TextGrid of the speech, or a plain English text of it.
        recognise_words: where there is no transcript.

    Raises:
        ValueError: of what cannot be done, with one sentence.
    """
    systems = usual_planner() if systems is None else systems
    named = () if systems == "all" else (systems,) if isinstance(systems, str) else tuple(systems)
    with ExitStack() as held:
        bar = held.enter_context(Bar("speech", progress))
        out = Path(held.enter_context(TemporaryDirectory()))
        request = GenerateRequest(
            speech=held.enter_context(speech_file(speech)),
            out=out,
            weights=Path(weights),
            systems=named,
            speaker=speaker,
            seed=seed,
            samples=samples,
            steps=steps,
            sampler=sampler,
            guidance=guidance,
            post_filter=post_filter,
            plan=held.enter_context(plan_file(plan)),
            reference=None if reference is None else held.enter_context(motion_file(reference)),
            transcript=None if transcript is None else Path(transcript),
            words="recognise" if recognise_words else "none",
            has_video=False,
            has_figures=False,
        )
        result = generate_all(request, bar.take)
        heard = read_speech(request.speech)
        stems = {name: out / file_stem(name) for name in result.names if name != REFERENCE_NAME}
        motions = {name: load_motion(f"{stem}.npz") for name, stem in stems.items()}
        plans = {name: Path(f"{stem}.plan.json") for name, stem in stems.items()}
        if request.reference is not None:
            recorded = read_motion(request.reference)
            motions[REFERENCE_NAME] = first_frames(recorded, result.num_frames)
        return Performance(
            speech=heard,
            motions=motions,
            plans={name: read_plan(path) for name, path in plans.items() if path.is_file()},
            said=result.said,
            diagnostics=result.diagnostics,
            notes=result.notes,
        )


def plan(
    speech: SpeechLike,
    *,
    speaker: str | None = None,
    seed: int = 0,
    guidance: float | None = None,
    transcript: str | Path | None = None,
    recognise_words: bool = False,
    weights: str | Path = BUNDLED_WEIGHTS,
) -> GesturePlan:
    """Draw what the system that plans is going to do with the speech; see `model.plan.plan`.

    Raises:
        ValueError: of what cannot be done, with one sentence.
    """
    with speech_file(speech) as sound, TemporaryDirectory() as folder:
        out = Path(folder) / "plan.json"
        drawn = make_plan(
            PlanRequest(
                speech=sound,
                out=out,
                weights=Path(weights),
                speaker=speaker,
                seed=seed,
                guidance=guidance,
                transcript=None if transcript is None else Path(transcript),
                words="recognise" if recognise_words else "none",
            )
        )
        return drawn.plan
