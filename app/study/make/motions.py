"""Motions of a study's clips with equal length, body, face and position for every system."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from app.errors import RunError
from app.run.bodies import body_motion
from app.run.models import get_body, get_system
from app.run.plan_edits.edits import check_plan_matches_speech
from app.study.design.plan import Clip, Condition, StudyPlan
from conventions.rates import FPS, SAMPLE_RATE
from model.formats.read import read_any_motion
from model.generation.windows import GenerateOptions, draw_conditions, generate_motion
from model.motion.motion import Motion
from model.motion.transforms import apply_post_filter
from model.plan.files import read_plan_file
from model.plan.plan import GesturePlan, PlanError
from model.sampling.samplers import noise_seed_of_clip
from model.speech.audio import Speech, load_speech
from model.storage.files import file_sha256
from renderer.body.body import Body
from renderer.scene.camera_setup import make_camera_setup

FACE_JOINTS = slice(3 * 22, 3 * 25)
"""Columns of jaw and eyes in ``poses``."""


@dataclass(frozen=True, eq=False)
class ClipInputs:
    """Clip with its speech, motions and plans."""

    clip: Clip
    num_frames: int
    speech: Speech | None
    """Excerpt of the speech; None without speech."""
    file_sha256s: Mapping[str, str]
    """SHA-256 of each source file, by ``speech`` or the system's name."""
    motion_excerpts: Mapping[str, Motion]
    """Excerpts of motion files, by system."""
    plans: Mapping[str, GesturePlan] = field(default_factory=dict)
    """Plans for systems to perform, by system."""


def read_all_clip_inputs(plan: StudyPlan) -> tuple[ClipInputs, ...]:
    """Read all inputs and check their lengths; raises RunError, SpeechError or MotionError."""
    first, *others = sources = tuple(read_clip_inputs(plan, clip) for clip in plan.clips)
    for source in others if plan.protocol == "matched" else ():
        if source.num_frames != first.num_frames:
            raise RunError(
                f"Matched and mismatched speech must be equally long, but {first.clip.name!r} has "
                f"{first.num_frames} frames and {source.clip.name!r} has {source.num_frames}. Set "
                "`length_s` to cut all of them to one length."
            )
    return sources


def read_clip_inputs(plan: StudyPlan, clip: Clip) -> ClipInputs:
    """Read speech, motion and plan of one clip; raises RunError, SpeechError or MotionError."""
    files: dict[str, str] = {}
    speech = None
    lengths: dict[str, int] = {}
    start = round(clip.start_s * FPS)
    motions: dict[str, Motion] = {}
    for system in plan.conditions:
        name = system.name
        if system.motion is not None:
            path = _existing(system.motion[clip.name], f"motion of {name!r} for clip {clip.name!r}")
            motions[name], digest = read_any_motion(path).motion, file_sha256(path)
            for other in (other for other, same in files.items() if same == digest):
                raise RunError(
                    f"The systems {other!r} and {name!r} have the same motion file for clip "
                    f"{clip.name!r}; a comparison needs different ones."
                )
            files[name] = digest
            lengths[f"the motion of {name!r}"] = motions[name].num_frames - start
    if clip.speech is not None:
        speech = load_speech(_existing(clip.speech, f"speech of clip {clip.name!r}"))
        files = {"speech": speech.sha256, **files}
        lengths["the speech"] = round(FPS * (speech.duration_s - clip.start_s))
    num_frames = _common_length(plan, clip, lengths)
    plans = {}
    for system in plan.conditions:
        if system.plan is not None:
            path = system.plan[clip.name]
            plans[system.name] = _read_plan(system, clip, path, num_frames / FPS)
            files[f"plan of {system.name}"] = file_sha256(path)
    return ClipInputs(
        clip=clip,
        num_frames=num_frames,
        speech=None if speech is None else _excerpt(speech, clip.start_s, num_frames),
        file_sha256s=files,
        motion_excerpts={
            name: motion.part(slice(start, start + num_frames)) for name, motion in motions.items()
        },
        plans=plans,
    )


def _existing(path: Path, noun: str) -> Path:
    if not path.is_file():
        raise RunError(f"The {noun} was not found: {path} does not exist.")
    return path


def _read_plan(system: Condition, clip: Clip, path: Path, duration_s: float) -> GesturePlan:
    what = f"gesture plan of {system.name!r} for clip {clip.name!r}"
    try:
        return check_plan_matches_speech(read_plan_file(_existing(path, what)).plan, duration_s)
    except PlanError as error:
        raise RunError(f"The {what}: {error}") from None


def _common_length(plan: StudyPlan, clip: Clip, lengths: Mapping[str, int]) -> int:
    """Return the frames of the excerpt: ``length_s``, or the common length of the clip's files."""
    if plan.video_s is not None:
        wanted = round(plan.video_s * FPS)
        for what, frames in lengths.items():
            if frames < wanted:
                raise RunError(
                    f"Clip {clip.name!r}: {what} lasts only {max(frames, 0) / FPS:.1f} s from the "
                    "start of the excerpt (`start_s`), less than the video length of "
                    f"{plan.video_s:g} s (`length_s`). Choose a shorter video length."
                )
        return wanted
    if len(set(lengths.values())) > 1:
        lengths_text = ", ".join(f"{what}: {frames} frames" for what, frames in lengths.items())
        raise RunError(
            f"The files of clip {clip.name!r} have different lengths ({lengths_text}). Set "
            "`length_s` to cut all of them to one length."
        )
    frames = next(iter(lengths.values()))
    if frames < 1:
        raise RunError(
            f"The files of clip {clip.name!r} end before the start of its excerpt (`start_s` = "
            f"{clip.start_s:g})."
        )
    return frames


def _excerpt(speech: Speech, start_s: float, num_frames: int) -> Speech:
    """Cut the excerpt to exactly the frames' length; less than a frame of silence may be added."""
    start = round(start_s * SAMPLE_RATE)
    waveform = np.zeros(round(num_frames * SAMPLE_RATE / FPS), np.float32)
    excerpt = speech.waveform[start : start + len(waveform)]
    waveform[: len(excerpt)] = excerpt
    return replace(speech, waveform=waveform)


def make_clip_motions(
    plan: StudyPlan,
    source: ClipInputs,
    weights: Path,
    body_path: Path | None,
    should_cancel: Callable[[], bool],
) -> dict[str, Motion]:
    """Read or generate the motion of every system for one clip, ready to be rendered.

    Raises RunError if two systems move exactly alike, or faces cannot be compared, Cancelled, and
    UnknownNameError, CheckpointError, BodyError, each with one sentence.
    """
    motions = {
        system.name: source.motion_excerpts[system.name]
        if system.motion is not None
        else _generate(system, source, weights, should_cancel)
        for system in plan.conditions
    }
    for (one, first), (other, second) in itertools.combinations(motions.items(), 2):
        if np.array_equal(first.poses, second.poses) and np.array_equal(first.trans, second.trans):
            raise RunError(  # other bytes may hold the same motion
                f"The systems {one!r} and {other!r} have identical motion in clip "
                f"{source.clip.name!r}; a comparison needs different motion."
            )
    bases = sorted({motion.expression_basis for motion in motions.values()})
    if plan.face == "moving" and len(bases) > 1:
        raise RunError(
            f"The systems use different face models ({' and '.join(bases)}), which would reveal "
            'the systems to participants. Set `face = "still"` in the study plan.'
        )
    body = get_body(body_path)
    return {name: _normalised_body(motion, plan.face, body) for name, motion in motions.items()}


def _generate(
    system: Condition, source: ClipInputs, weights: Path, should_cancel: Callable[[], bool]
) -> Motion:
    """Generate motion from the excerpt alone, which is also what participants hear.

    Clips have different noise, or participants would see the same gestures again and again;
    conditions of one system and seed share it, and the plan that a style changes.
    """
    assert source.speech is not None and system.system is not None
    loaded = get_system(system.system, weights)
    options = GenerateOptions(
        speaker=system.speaker or next(iter(loaded.speakers)),
        seed=noise_seed_of_clip(system.seed, source.clip.name),
        steps=system.steps,
        sampler=system.sampler,
    )
    if (plan := source.plans.get(system.name)) is not None:
        options = replace(options, conditions=(plan,))
    if system.style is not None:
        plans = options.conditions or draw_conditions(loaded, source.speech, options)
        options = replace(options, conditions=tuple(system.style.apply(p).plan for p in plans))
    (motion,) = generate_motion(loaded, source.speech, options, should_cancel=should_cancel)
    return apply_post_filter(motion, system.post_filter)


def _normalised_body(motion: Motion, face: Literal["still", "moving"], body: Body) -> Motion:
    """Return the motion on the mean body, standing on the floor in the middle of the picture."""
    poses, expressions = motion.poses.copy(), motion.expressions
    if face == "still":
        poses[:, FACE_JOINTS] = 0
        expressions = np.zeros_like(expressions)
    plain = replace(motion, poses=poses, expressions=expressions, betas=np.zeros_like(motion.betas))
    x, _, z = motion.trans.mean(axis=0)
    floor = make_camera_setup(body, [body_motion(plain)]).floor_m
    return replace(plain, trans=motion.trans - np.array([x, floor, z], np.float32))
