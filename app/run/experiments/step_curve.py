"""Quality against time: what steps of a sampler buy, and what they cost on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from pandas import DataFrame

from app.findings.comparison import ALIKE
from app.run.ask import OnEvent, ShouldCancel
from app.run.models import get_system
from app.run.output.run_folder import RunRecord
from app.run.run_writer import writing_run
from app.run.tasks import StepsAsk
from conventions.names import short_names
from conventions.rates import SAMPLE_RATE
from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.measures.smoothness import derivative_magnitudes, mean_over_time
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import track_points
from model.speech.audio import Speech, SpeechLimits, load_speech
from renderer.figures.curves import STEPS, draw_step_curve

MAX_S = 10.0
"""Of the speech: time a frame does not depend on its length."""
FINGERTIP = "right_middle"
MEASURED = "Measured {count} motions."


@dataclass(frozen=True)
class StepPoint:
    """One system with one number of steps."""

    system: str
    steps: int
    ms_per_frame: float
    """By the clock, one motion at a time, with the features of the speech."""
    tip_jerk_m_s3: float
    distance_cm: float
    """Mean distance of all joints to where the same system, with the same noise, has them with the
    most steps that were tried."""


def measure_step_curve(
    ask: StepsAsk,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> None:
    """Generate with each system and number of steps; leave the table, the plot, and what they say
    as notes.

    Raises:
        Cancelled: when ``should_cancel`` said so.
        RunError, SpeechError, UnknownNameError, CheckpointError, WriteError: with a sentence.
    """
    ask.check()
    whole = load_speech(ask.speech or "", SpeechLimits(max_s=ask.max_speech_s))
    speech = replace(whole, waveform=whole.waveform[: int(MAX_S * SAMPLE_RATE)])
    systems = [get_system(name, ask.weights) for name in ask.systems]
    record = RunRecord(kind="generated", point=FINGERTIP)
    points: list[StepPoint] = []
    with writing_run(ask.out, record, on_event, should_cancel) as run:
        part = 1 / len(systems)
        for number, system in enumerate(systems):
            points += _points_of(system, speech, ask, run.share("numbers", part, number * part))
        run.share("numbers")(1.0)
        run.note(*_sentences(points))
        told = list(map(asdict, points))
        run.table("steps", told, [told[0], *(point.values() for point in told)])
        run.figure("steps", lambda: draw_step_curve(DataFrame(points)), STEPS)
        run.finish(MEASURED.format(count=len(points)))


def _points_of(
    system: System, speech: Speech, ask: StepsAsk, on_share: Callable[[float], None]
) -> list[StepPoint]:
    """From few steps to many."""
    counts = sorted(set(ask.counts), reverse=True)  # the most first: others are compared to it
    speaker = ask.speaker or next(iter(system.speakers))
    generate_motion(system, speech, GenerateOptions(speaker, steps=1))  # what is only done once
    found: list[StepPoint] = []
    most: np.ndarray | None = None
    for done, count in enumerate(counts):
        on_share(done / len(counts))
        options = GenerateOptions(speaker, seed=ask.seed, steps=count)
        started = time.perf_counter()
        (motion,) = generate_motion(system, speech, options)
        seconds = time.perf_counter() - started
        positions, jerk = _places_and_jerk(motion)
        most = positions if most is None else most
        apart = ((positions - most) ** 2).sum(-1) ** 0.5
        found.append(
            StepPoint(
                system=system.name,
                steps=count,
                ms_per_frame=1e3 * seconds / motion.num_frames,
                tip_jerk_m_s3=jerk,
                distance_cm=100 * float(apart.mean()),
            )
        )
    return found[::-1]


def _places_and_jerk(motion: Motion) -> tuple[np.ndarray, float]:
    tracks = track_points(motion, open_body_skeleton())
    tip = tracks.point(FINGERTIP)
    return tracks.joints, float(mean_over_time(derivative_magnitudes(tip, 3)))


def _sentences(points: Sequence[StepPoint]) -> Iterator[str]:
    """Of each system the fewest steps that are as calm as the most."""
    for system, label in short_names(dict.fromkeys(point.system for point in points)).items():
        of_it = [each for each in points if each.system == system]
        most = of_it[-1]
        calm = ALIKE * most.tip_jerk_m_s3
        least = next((each for each in of_it if each.tip_jerk_m_s3 <= calm), most)
        yield (
            f"{label}: {least.steps} of {most.steps} steps leave the fingertip as calm within"
            f" 5 %, {least.distance_cm:.1f} cm from where {most.steps} lead, at"
            f" {least.ms_per_frame:.1f} in place of {most.ms_per_frame:.1f} ms a frame."
        )
