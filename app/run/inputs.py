"""What a run works from, read and checked before anything is generated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import RunError
from app.run.models import get_body, get_system
from app.run.output.result_folder import require_free_space
from app.run.output.telling import Reporter
from app.run.requests.request import GenerateRequest, steps_of
from conventions.names import REFERENCE_NAME

if TYPE_CHECKING:
    import numpy as np

    from model.generation.base import System
    from model.generation.windows import GenerateOptions
    from model.motion.motion import Motion
    from model.plan.style import StyleWish
    from model.speech.audio import Speech
    from renderer.body.body import Body


@dataclass(frozen=True)
class Inputs:
    """Everything that is read from files, and what draws."""

    wav: Path
    """The speech as all videos get it: 16 kHz, mono."""
    speech_sha256: str
    speech_s: float
    num_frames: int
    systems: tuple[System, ...]
    speaker: str
    options: Mapping[str, GenerateOptions]
    """What each system is asked for, by its name."""
    body: Body
    reference: Motion | None
    backend: str | None
    """OpenGL backend; None when nothing is drawn."""
    wish: StyleWish | None = None
    """What is done to every plan."""


def read_inputs(
    request: GenerateRequest, sound: Callable[[np.ndarray], Path], reporter: Reporter
) -> tuple[Inputs, Speech]:
    """Read speech, systems, body and reference, and see that there is room for the results.

    Args:
        sound: writes the speech as viewers and videos get it.

    Returns:
        What the whole run needs, and the speech, which is large and can be let go of once the
        motion is there.

    Raises:
        RunError, SpeechError, UnknownNameError, CheckpointError, BodyError, MotionError, GLError,
        WriteError: each with one sentence.
    """
    from model.plan.style import read_wish
    from model.speech.audio import SpeechLimits, load_speech

    speech = load_speech(
        request.speech, SpeechLimits(max_s=request.max_speech_s, channel=request.channel)
    )
    reporter.note(*speech.notes)
    body = get_body(request.body, request.look)
    systems = _load_systems(request)
    speaker = request.speaker or _first_speaker(systems)
    for system in systems:
        system.speaker_index(speaker)  # raises for a name that it does not know
    reference = _read_reference(request, speech, reporter)
    backend = _choose_backend() if request.has_video else None
    needed_bytes = _needed_bytes(request, speech.num_frames, len(systems))
    require_free_space(request.out, needed_bytes)
    inputs = Inputs(
        wav=sound(speech.waveform),
        speech_sha256=speech.sha256,
        speech_s=speech.duration_s,
        num_frames=speech.num_frames,
        systems=systems,
        speaker=speaker,
        options=_options(request, systems, speaker, reporter),
        body=body,
        reference=reference,
        backend=backend,
        wish=None if request.style is None else read_wish(request.style),
    )
    return inputs, speech


def _first_speaker(systems: tuple[System, ...]) -> str:
    """The first that all of them know, or that the first of them knows."""
    first = systems[0].speakers
    shared = (name for name in first if all(name in each.speakers for each in systems))
    return next(shared, next(iter(first)))


def _load_systems(request: GenerateRequest) -> tuple[System, ...]:
    from model.systems.registry import list_systems

    names = request.systems or list_systems(request.weights)
    if not names:
        raise RunError(
            f"No trained systems were found in {request.weights}; "
            "name a folder of weights with --weights DIR."
        )
    asked = request.steps, request.face_steps
    unused = [
        name for steps in asked if isinstance(steps, Mapping) for name in steps if name not in names
    ]
    if unused:
        raise RunError(
            f"Steps are given for {unused[0]!r}, which is none of the systems of this run; these "
            f"are {', '.join(names)}."
        )
    return tuple(get_system(name, request.weights) for name in dict.fromkeys(names))


def _options(
    request: GenerateRequest, systems: tuple[System, ...], speaker: str, reporter: Reporter
) -> dict[str, GenerateOptions]:
    """A wish goes to the systems that know it; of the others the person is told.

    Raises:
        RunError: if no system has the sampler, or none takes guidance, steps of the face or a plan.
        PlanError: if the plan cannot be used.
    """
    from model.generation.windows import GenerateOptions
    from model.plan.files import read_plan_file
    from model.plan.plan import GesturePlan

    read = None if request.plan is None else read_plan_file(request.plan)
    plans = () if read is None else (read.plan,)
    for what, given in (("plan", request.plan), ("style", request.style)):
        if given is not None and not any(s.condition_type is GesturePlan for s in systems):
            raise RunError(f"None of these systems performs plans; leave the {what} out.")
    for note in () if read is None else read.notes:
        reporter.note(note)

    with_sampler = [
        system.name
        for system in systems
        if request.sampler in (None, *(sampler.name for sampler in system.samplers))
    ]
    if not with_sampler:
        names = dict.fromkeys(sampler.name for each in systems for sampler in each.samplers)
        raise RunError(
            f"There is no sampler {request.sampler!r}; choose one of {', '.join(names)}."
        )
    if request.guidance not in (None, 1) and all(each.guidance is None for each in systems):
        raise RunError("None of these systems takes guidance; leave it out.")
    options: dict[str, GenerateOptions] = {}
    for system in systems:
        chosen = request.sampler if system.name in with_sampler else None
        sampler = system.sampler(chosen)
        if chosen != request.sampler:
            reporter.note(
                f"{system.name} has no sampler {request.sampler}; it took {sampler.name}."
            )
        guidance = system.strength(None if system.guidance is None else request.guidance)
        if request.guidance not in (None, guidance):
            reporter.note(f"{system.name} takes no guidance.")
        performs = system.condition_type is GesturePlan
        if (plans or request.style) and not performs:
            reporter.note(f"{system.name} performs no plans.")
        face_steps = steps_of(request.face_steps, system.name)
        if face_steps is not None and sampler.face_steps is None:
            reporter.note(f"{system.name} takes no steps for the face alone.")
            face_steps = None
        steps, face_steps = sampler.counts(steps_of(request.steps, system.name), face_steps)
        options[system.name] = GenerateOptions(
            speaker=speaker,
            seed=request.seed,
            samples=request.samples,
            steps=steps,
            face_steps=face_steps,
            sampler=sampler.name,
            guidance=guidance,
            conditions=plans if performs else (),
        )
    if request.face_steps is not None and all(each.face_steps is None for each in options.values()):
        raise RunError("None of these systems takes steps for the face alone; leave them out.")
    return options


def _read_reference(request: GenerateRequest, speech: Speech, reporter: Reporter) -> Motion | None:
    """The recorded motion, no longer than the speech."""
    if request.reference is None:
        return None
    from model.formats.read import read_any_motion
    from model.motion.motion import first_frames

    request.told.check([request.reference])
    read = read_any_motion(request.reference, request.told, request.body, REFERENCE_NAME)
    for note in read.notes:
        reporter.note(note)
    motion = read.motion
    if motion.num_frames != speech.num_frames:
        is_longer = motion.num_frames > speech.num_frames
        reporter.note(
            f"The reference has {motion.num_frames} frames and the speech {speech.num_frames}; "
            + (
                f"the reference was cut to {speech.num_frames}."
                if is_longer
                else "where it has ended, the comparison holds its last frame."
            )
        )
    return first_frames(motion, speech.num_frames)


def _choose_backend() -> str:
    from renderer.draw.probe import choose_backend

    return choose_backend()


def _needed_bytes(request: GenerateRequest, num_frames: int, num_systems: int) -> int:
    """What such runs have taken, and half as much again."""
    count = num_systems * request.samples + 1
    motion_bytes = (4 * 268 + 504) * num_frames  # as a file, and as a browser plays it
    # Each picture is in the comparison too, and so is each close-up, of half a body's height.
    pixels = request.size**2 * (len(request.views) + len(request.close_ups) / 2) * 2
    video_bytes = 0.012 * pixels * num_frames if request.has_video else 0.0
    return int(1.5 * count * (motion_bytes + video_bytes) + 10e6)
