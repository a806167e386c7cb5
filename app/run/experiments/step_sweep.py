"""Quality and speed of systems for several numbers of sampling steps, on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from pandas import DataFrame

from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.generated_motions import load_first_seconds
from app.run.models import get_system
from app.run.output.run_folder import RunRecord
from app.run.requests.parts import DEFAULT_TRACKED_POINT
from app.run.requests.requests import StepSweepRequest, requested_systems
from app.run.run_writer import open_run_writer
from conventions.names import short_names
from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.metrics.protocols.table import WORKBENCH
from model.metrics.smoothness import derivative_magnitudes, mean_over_time
from model.motion.kinematics import open_body_skeleton
from model.motion.tracks import track_points
from model.sampling.samplers import noise_seed_of_clip
from model.speech.audio import Speech
from renderer.figures.curves import STEP_SWEEP_CAPTION

MAX_S = 10.0
"""Part of the speech that is used (s); the time per frame does not depend on the length."""
MEASURED = "Measured {count} motions."
AS_CALM = 1.05
"""Ratio of jerk up to which motion counts as equally smooth."""


@dataclass(frozen=True)
class StepPoint:
    """Quality and speed of one system with one number of steps."""

    system: str
    steps: int
    ms_per_frame: float
    """Wall time, one motion at a time, without computing the speech features."""
    tip_jerk_m_s3: float
    distance_cm: float
    """Mean distance of all joints (cm) to the motion with the most steps and the same noise."""


def measure_step_sweep(request: StepSweepRequest, callbacks: RunCallbacks = NO_CALLBACKS) -> None:
    """Generate with each system and number of steps; write the table, the plot, and notes.

    Raises Cancelled, RunError, SpeechError, UnknownNameError, CheckpointError or WriteError.
    """
    request.check()
    speech = load_first_seconds(request.speech, MAX_S, request.max_speech_s)
    systems = [get_system(name, request.weights) for name in requested_systems(request)]
    record = RunRecord(kind="generated", tracked_point=DEFAULT_TRACKED_POINT)
    points: list[StepPoint] = []
    with open_run_writer(request.output.out, record, callbacks) as run:
        part = 1 / len(systems)
        for number, system in enumerate(systems):
            points += _points_of(
                system, speech, request, run.progress_callback("numbers", part, number * part)
            )
        run.progress_callback("numbers")(1.0)
        run.add_notes(*_step_sentences(points))
        rows = [asdict(point) | {"protocol": WORKBENCH} for point in points]
        run.write_json_and_csv("steps", rows, [rows[0], *(point.values() for point in rows)])
        run.write_figure(
            "steps", DataFrame(points), STEP_SWEEP_CAPTION, request.output.figure_formats
        )
        run.finish(MEASURED.format(count=len(points)))


def _points_of(
    system: System, speech: Speech, request: StepSweepRequest, on_share: Callable[[float], None]
) -> list[StepPoint]:
    """Measure one system, and return its results from few steps to many."""
    counts = sorted(
        set(request.step_counts), reverse=True
    )  # the first is the reference of the others
    speaker = request.speaker or next(iter(system.speakers))
    generate_motion(system, speech, GenerateOptions(speaker, steps=1))  # warm-up
    points: list[StepPoint] = []
    most: np.ndarray | None = None
    for done, count in enumerate(counts):
        on_share(done / len(counts))
        seed = noise_seed_of_clip(request.seed, speech.sha256)  # same motion as by `generate`
        options = GenerateOptions(speaker, seed=seed, steps=count)
        started = time.perf_counter()
        (motion,) = generate_motion(system, speech, options)
        seconds = time.perf_counter() - started
        tracks = track_points(motion, open_body_skeleton())
        most = tracks.joints if most is None else most
        apart = ((tracks.joints - most) ** 2).sum(-1) ** 0.5
        points.append(
            StepPoint(
                system=system.name,
                steps=count,
                ms_per_frame=1e3 * seconds / motion.num_frames,
                tip_jerk_m_s3=float(
                    mean_over_time(derivative_magnitudes(tracks.point(DEFAULT_TRACKED_POINT), 3))
                ),
                distance_cm=100 * float(apart.mean()),
            )
        )
    return points[::-1]


def _step_sentences(points: Sequence[StepPoint]) -> Iterator[str]:
    """Yield for each system the fewest steps that are as smooth as the most."""
    for system, label in short_names(dict.fromkeys(point.system for point in points)).items():
        of_it = [each for each in points if each.system == system]
        most = of_it[-1]
        calm = AS_CALM * most.tip_jerk_m_s3
        least = next(each for each in of_it if each.tip_jerk_m_s3 <= calm)
        yield (
            f"{label}: with each smaller number of sampling steps tested, fingertip jerk is over "
            f"5 % higher than with {most.steps}."
            if least is most
            else f"{label}: with {least.steps} instead of {most.steps} sampling steps, fingertip "
            f"jerk is at most 5 % higher, the joints differ by {least.distance_cm:.1f} cm on "
            f"average, and a frame takes {least.ms_per_frame:.1f} instead of "
            f"{most.ms_per_frame:.1f} ms."
        )
