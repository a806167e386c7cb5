"""Experiments: effects of speech and noise seed, rotation noise, and numbers of sampling steps.

`measure_hearing` compares motions that share the speech, the noise or neither. `show_mechanism`
applies equal noise to local and to global rotations, the paper's argument on a body.
`measure_step_curve` measures quality and speed on this machine.
"""

from __future__ import annotations

import itertools
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame

from app.errors import RunError
from app.run.bodies import choose_tip_source
from app.run.callbacks import DEAF, Ear
from app.run.made import options_of
from app.run.models import get_body, get_system, pool_for
from app.run.output.run_folder import RunRecord, check_file_stems
from app.run.requests.parts import DEFAULT_TRACKED_POINT
from app.run.requests.requests import (
    ROTATION_NOISE_VIDEO,
    RotationNoiseRequest,
    SpeechEffectRequest,
    StepSweepRequest,
    systems_of,
)
from app.run.run_writer import RunWriter, writing_run
from app.run.videos.videos import jobs_of
from conventions.names import file_stem, short_names
from conventions.rates import SAMPLE_RATE
from model.evaluation.classifiers import manner_of, wrist_speeds
from model.formats.read import read_any_motion
from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.metrics.error_growth import ErrorGrowth, growth_sentence, measure_error_growth
from model.metrics.smoothness import derivative_magnitudes, mean_over_time
from model.metrics.speech_effect import Decided, Grid, arm_rotations_same_noise, arm_speed, decided
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion, save_motion
from model.motion.tracks import moving_chain, track_points
from model.motion.transforms import noisy_motions
from model.sampling.samplers import clip_seed
from model.speech.audio import Speech, SpeechLimits, load_speech
from model.speech.transcript import NOTHING_SAID
from processes.job import Job
from renderer.figures.curves import (
    HEARING,
    STEPS,
    HearingRow,
)
from renderer.figures.style import MAX_SYSTEMS
from renderer.video.compose import compose_videos
from renderer.video.workers import draw_jobs

HEARD_S = 60.0
"""Part of each speech that is used (s)."""
COMPARED = "Compared {count} system{s}."
_NAMED = re.compile(r"(?:(?P<system>.+?)__)?(?P<speech>.+?)__(?P<seed>\d{1,9})\.npz")
_COLUMNS = (
    *("same_speech", "same_noise", "neither", "by_speech", "by_noise", "lead"),
    *("lead_low", "lead_high"),
)


@dataclass(frozen=True)
class _Made:
    """Motions of one system, by speech and seed."""

    grid: Grid
    guidance: float | None = None
    """Guidance scale of the speech; None if it is not known."""
    by_speaker: Grid = field(default_factory=dict)
    """Motions for the first speech, by speaker and seed."""


def measure_hearing(request: SpeechEffectRequest, ear: Ear = DEAF) -> None:
    """Generate each speech with each seed, or read a folder of motions, and compare the motions.

    The motions, the metrics, the figure, and sentences as notes are written.

    Raises:
        Cancelled: if the caller has cancelled.
        RunError, SpeechError, MotionError, UnknownNameError, CheckpointError, WriteError: with a
            sentence.
    """
    request.check()
    record = RunRecord(
        kind="given" if request.is_of_motions else "generated", point=DEFAULT_TRACKED_POINT
    )
    with writing_run(request.out, record, ear) as run:
        if request.is_of_motions:
            of_system = {
                name: _Made(grid) for name, grid in _read_grids(request.speeches[0]).items()
            }
            run.share("numbers")(1.0)
        else:
            speeches = {
                file_stem(path.stem): _beginning(path, HEARD_S, request.max_speech_s)
                for path in request.speeches
            }
            names = systems_of(request)
            check_file_stems(f"{name}__{speech}" for name in names for speech in speeches)
            of_system = _generated(request, speeches, run)
            for system, made in of_system.items():
                for (speech, seed), motion in made.grid.items():
                    path = run.folder.path(f"{file_stem(system)}__{speech}__{seed}.npz")
                    save_motion(motion, path)
                    run.file(path)
        told = {
            system: _heard_numbers(system, made, request.speakers)
            for system, made in of_system.items()
        }
        labels = short_names(told)
        run.note(*(_heard_sentence(labels[system], numbers) for system, numbers in told.items()))
        table = [
            (system, part, *shares.values())
            for system, numbers in told.items()
            for part, shares in numbers["parts"].items()
        ]
        run.table("hearing", told, [("system", "part", *_COLUMNS), *table])
        _draw_hearing(told, of_system, run, request)
        run.finish(COMPARED.format(count=len(told), s="s" if len(told) > 1 else ""))


def _beginning(path: Path, longest_s: float, max_s: float) -> Speech:
    """Load a speech, cut to a maximum length."""
    whole = load_speech(path, SpeechLimits(max_s=max_s))
    return replace(whole, waveform=whole.waveform[: int(longest_s * SAMPLE_RATE)])


def _generated(
    request: SpeechEffectRequest, speeches: Mapping[str, Speech], run: RunWriter
) -> dict[str, _Made]:
    """Generate all motions, in several processes where that is worth their start."""
    systems = [get_system(name, request.weights) for name in systems_of(request)]
    first, seeds, speakers = next(iter(speeches)), range(request.seeds), request.speakers or ()
    folder, jobs = run.folder.scratch("motions").absolute(), list[Job]()
    folder.mkdir()
    seconds_of_motion = 0.0

    def motion_file(system: System, speech: str, **asked: Any) -> Path:
        nonlocal seconds_of_motion
        seconds_of_motion += speeches[speech].duration_s
        path, options = folder / f"{len(jobs)}.npz", options_of(request.sampling, system, **asked)
        weights = request.weights.absolute()
        work = partial(_generate_to, path, system.name, weights, speeches[speech], options)
        jobs.append(Job(path.stem, path.is_file, work))
        return path

    guidance = {each.name: options_of(request.sampling, each).guidance for each in systems}
    files = {
        system.name: (
            {(name, n): motion_file(system, name, seed=n) for name in speeches for n in seeds},
            {
                (speaker, n): motion_file(system, first, speaker=speaker, seed=n)
                for speaker in speakers
                for n in seeds
            },
        )
        for system in systems
    }
    on_share, done = run.share("numbers"), itertools.count(1)
    on_share(0.0)
    failed = pool_for(seconds_of_motion).do_all(
        jobs, lambda _: on_share(next(done) / len(jobs)), should_cancel=run.should_cancel
    )
    for error in failed.values():
        raise error

    def grid(paths: Mapping[tuple[str, int], Path]) -> Grid:
        return {key: load_motion(path) for key, path in paths.items()}

    return {
        name: _Made(grid(paths), guidance[name], grid(by_speaker))
        for name, (paths, by_speaker) in files.items()
    }


def _generate_to(
    path: Path, system: str, weights: Path, speech: Speech, options: GenerateOptions
) -> None:
    """Generate one motion, in any process, and write it to a file."""
    (motion,) = generate_motion(get_system(system, weights), speech, options)
    save_motion(motion, path)


def _read_grids(folder: Path) -> dict[str, Grid]:
    """Read the motions of a folder, by the system, speech and seed in their file names."""
    grids: dict[str, dict[tuple[str, int], Motion]] = {}
    for path in sorted(path for path in folder.glob("*.npz") if not path.name.startswith(".")):
        named = _NAMED.fullmatch(path.name)
        if named is None:
            raise RunError(
                f"{path.name} must be called SYSTEM__SPEECH__SEED.npz or SPEECH__SEED.npz, with two"
                " underscores between, so that it is known what it was made of."
            )
        grid = grids.setdefault(named["system"] or folder.name, {})
        grid[named["speech"], int(named["seed"])] = read_any_motion(path).motion
    if not 1 <= len(grids) <= MAX_SYSTEMS:
        raise RunError(f"{folder} must hold 1 to {MAX_SYSTEMS} systems; found {len(grids)}.")
    return dict(grids)


def _heard_numbers(system: str, made: _Made, speakers: tuple[str, str] | None) -> dict[str, Any]:
    """Return the content of ``hearing.json`` for one system."""

    def shares(found: Decided) -> dict[str, float]:
        return {column: getattr(found, column) for column in _COLUMNS}

    try:
        parts = {part: shares(found) for part, found in decided(made.grid).items()}
        told = {
            "guidance": made.guidance,
            "arm_rotations_same_noise": arm_rotations_same_noise(made.grid),
            "parts": parts,
        }
        if speakers is None:
            return told
        calm, lively = wrist_speeds(made.by_speaker, speakers).values()
        compared = {
            "calm": speakers[0],
            "lively": speakers[1],
            "manner": manner_of(made.by_speaker),
            "calm_over_lively": calm / lively,
        }
    except ValueError as error:
        raise RunError(f"{system}: {error}") from error
    return {**told, "speakers": compared}


def _heard_sentence(system: str, numbers: Mapping[str, Any]) -> str:
    """Format the results of a system's arms as sentences."""
    arms = numbers["parts"]["arms"]
    lead, low, high = (round(100 * arms[key]) for key in ("lead", "lead_low", "lead_high"))
    if low > 0:
        verdict = "Speech decides more than chance."
    elif high < 0:
        verdict = "Speech decides less than chance."
    else:
        verdict = "It is open which of them decides more; more speeches and seeds would tell."
    told = (
        f"{system}: speech decides {_percent(arms['by_speech'])} of the arms' speed and"
        f" chance {_percent(arms['by_noise'])}, a difference of {_points(lead)} points (95 %"
        f" interval over pairs of motions {_points(low)} to {_points(high)}); with the same noise"
        " and other speech their rotations correlate"
        f" {numbers['arm_rotations_same_noise']:.2f}."
    )
    if "speakers" not in numbers:
        return f"{told} {verdict}"
    both = numbers["speakers"]
    calm, manner = both["calm"], both["manner"]
    return (
        f"{told} Of {calm} and {both['lively']}, the speaker decides"
        f" {_percent(manner['by_speaker'])} of the arms' speed; with the same noise and"
        f" speech their rotations correlate {manner['arm_rotations_same_noise']:.2f}, and"
        f" {calm}'s wrists move {both['calm_over_lively']:.2f} times as fast. {verdict}"
    )


def _draw_hearing(
    told: Mapping[str, Mapping[str, Any]],
    of_system: Mapping[str, _Made],
    run: RunWriter,
    request: SpeechEffectRequest,
) -> None:
    rows = [
        HearingRow(
            system,
            {key: arm_speed(motion) for key, motion in of_system[system].grid.items()},
            {
                part: (shares["by_speech"], shares["by_noise"])
                for part, shares in numbers["parts"].items()
            },
        )
        for system, numbers in told.items()
    ]
    run.figure("hearing", rows, HEARING, request.figure_forms)


def _percent(share: float) -> str:
    return f"{_points(round(100 * share))} %"


def _points(number: int) -> str:
    return str(number).replace("-", "\N{MINUS SIGN}")


NAMES: tuple[str, str] = ("local noise", "global noise")
"""Names of the two bodies, by the rotations with noise."""
DRAWN = "Noise of {noise:g} rad: left on local rotations, right on global ones."
_DRAWN = 0.85
"""Fraction of the work that is done when both bodies are rendered."""


def show_mechanism(request: RotationNoiseRequest, ear: Ear = DEAF) -> None:
    """Add noise to two copies of a motion, and show both, with a video if requested.

    Raises:
        Cancelled: if the caller has cancelled.
        RunError, MotionError, BodyError, GLError, VideoError: each with one sentence.
    """
    request.check()
    motion = request.motion
    if not moving_chain(request.joint):
        raise RunError(f"No rotation moves the {request.joint}; follow a joint further from it.")
    request.import_overrides.check([motion])
    found = read_any_motion(motion, request.import_overrides, request.body)
    growth = measure_error_growth(
        found.motion, open_body_skeleton(), request.joint, request.noise_rad, seed=request.seed
    )
    noisy = dict(
        zip(NAMES, noisy_motions(found.motion, request.noise_rad, request.seed), strict=True)
    )
    record = RunRecord(kind="given", point=DEFAULT_TRACKED_POINT)
    with writing_run(request.out, record, ear, is_kept=request.is_kept) as run:
        tip = choose_tip_source(request.body, DEFAULT_TRACKED_POINT)
        run.note(*found.notes, *_growth_told(growth, request.noise_rad))
        run.timeline(run.show(noisy, None, tip), NOTHING_SAID)
        _draw_growth(request, growth, run)
        if request.has_video:
            _draw_bodies(request, found.motion, noisy, run)
        run.finish(DRAWN.format(noise=request.noise_rad))


def _draw_growth(request: RotationNoiseRequest, growth: ErrorGrowth, run: RunWriter) -> None:
    """Draw the displacement of points along the kinematic chain."""
    spreads = DataFrame(
        {
            "point": growth.points,
            "local": growth.local_spread_m,
            "global": growth.global_spread_m,
            "predicted_local": growth.predicted_local_spread_m,
            "predicted_global": growth.predicted_global_spread_m,
        }
    )
    said = growth_sentence(growth, request.noise_rad)
    run.figure("error_growth", spreads, said, request.figure_forms)


def _draw_bodies(
    request: RotationNoiseRequest, clean: Motion, noisy: Mapping[str, Motion], run: RunWriter
) -> None:
    body = get_body(request.body)
    tip = choose_tip_source(request.body, request.joint)
    drawn = run.folder.scratch("bodies")
    drawn.mkdir()
    paths = {name: drawn / f"{number}.mp4" for number, name in enumerate(noisy)}

    def out(name: str, _: object) -> Path:
        return paths[name]

    # The camera frames the clean motion.
    jobs = jobs_of(noisy, request.video, body, tip, out, staged=[clean])
    draw_jobs(jobs, run.share("video", _DRAWN))
    video = run.folder.path(ROTATION_NOISE_VIDEO)
    compose_videos(
        list(paths.values()),
        [f"{request.noise_rad:g} rad of noise on {name}" for name in noisy],
        video,
        request.speech,
        on_progress=run.share("video", 1.0 - _DRAWN, _DRAWN),
    )
    run.file(video)


def _growth_told(growth: ErrorGrowth, noise_rad: float) -> Iterator[str]:
    """Yield sentences on the result of the experiment, and on its limits."""
    jerk = growth.jerk_m_s3
    yield growth_sentence(growth, noise_rad)
    yield (
        f"Its jerk is {jerk['local']:.0f} m/s³ with noise on local rotations, {jerk['global']:.0f} "
        f"on global ones and {jerk['clean']:.0f} without noise."
    )
    yield (
        "Equal noise is an assumption: how much a trained network errs in either form has to be "
        "measured."
    )


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


def measure_step_curve(request: StepSweepRequest, ear: Ear = DEAF) -> None:
    """Generate with each system and number of steps; write the table, the plot, and notes.

    Raises:
        Cancelled: if the caller has cancelled.
        RunError, SpeechError, UnknownNameError, CheckpointError, WriteError: with a sentence.
    """
    request.check()
    speech = _beginning(request.speech, MAX_S, request.max_speech_s)
    systems = [get_system(name, request.weights) for name in systems_of(request)]
    record = RunRecord(kind="generated", point=DEFAULT_TRACKED_POINT)
    points: list[StepPoint] = []
    with writing_run(request.out, record, ear) as run:
        part = 1 / len(systems)
        for number, system in enumerate(systems):
            points += _points_of(system, speech, request, run.share("numbers", part, number * part))
        run.share("numbers")(1.0)
        run.note(*_step_sentences(points))
        told = list(map(asdict, points))
        run.table("steps", told, [told[0], *(point.values() for point in told)])
        run.figure("steps", DataFrame(points), STEPS, request.figure_forms)
        run.finish(MEASURED.format(count=len(points)))


def _points_of(
    system: System, speech: Speech, request: StepSweepRequest, on_share: Callable[[float], None]
) -> list[StepPoint]:
    """Measure one system, and return its results from few steps to many."""
    counts = sorted(set(request.counts), reverse=True)  # the first is the reference of the others
    speaker = request.speaker or next(iter(system.speakers))
    generate_motion(system, speech, GenerateOptions(speaker, steps=1))  # warm-up
    found: list[StepPoint] = []
    most: np.ndarray | None = None
    for done, count in enumerate(counts):
        on_share(done / len(counts))
        seed = clip_seed(request.seed, speech.sha256)  # same motion as by `generate`
        options = GenerateOptions(speaker, seed=seed, steps=count)
        started = time.perf_counter()
        (motion,) = generate_motion(system, speech, options)
        seconds = time.perf_counter() - started
        tracks = track_points(motion, open_body_skeleton())
        most = tracks.joints if most is None else most
        apart = ((tracks.joints - most) ** 2).sum(-1) ** 0.5
        found.append(
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
    return found[::-1]


def _step_sentences(points: Sequence[StepPoint]) -> Iterator[str]:
    """Yield for each system the fewest steps that are as smooth as the most."""
    for system, label in short_names(dict.fromkeys(point.system for point in points)).items():
        of_it = [each for each in points if each.system == system]
        most = of_it[-1]
        calm = AS_CALM * most.tip_jerk_m_s3
        least = next(each for each in of_it if each.tip_jerk_m_s3 <= calm)
        yield (
            f"{label}: with fewer than {most.steps} steps the fingertip jerks over 5 % more."
            if least is most
            else f"{label}: {least.steps} of {most.steps} steps leave the fingertip as calm within"
            f" 5 %, {least.distance_cm:.1f} cm from where {most.steps} lead, at"
            f" {least.ms_per_frame:.1f} in place of {most.ms_per_frame:.1f} ms a frame."
        )
