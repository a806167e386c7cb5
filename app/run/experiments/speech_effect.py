"""Effects of the speech and of the noise seed on motion.

Motions that share the speech, the noise or neither are compared.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.generated_motions import generation_options, load_first_seconds
from app.run.models import get_system, make_job_pool
from app.run.output.run_folder import RunRecord, check_distinct_file_stems
from app.run.requests.parts import DEFAULT_TRACKED_POINT
from app.run.requests.requests import SpeechEffectRequest, requested_systems
from app.run.run_writer import RunWriter, open_run_writer
from conventions.names import pluralise, safe_file_stem, short_names
from model.evaluation.classifiers import arm_speaker_effect, calm_and_lively_wrist_speeds
from model.formats.read import read_any_motion
from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.metrics.protocols.table import WORKBENCH
from model.metrics.speech_effect import (
    Grid,
    SharedInputCorrelations,
    arm_rotation_correlation_same_noise,
    smoothed_arm_speed_sum_deg_s,
    speech_and_noise_shares,
)
from model.motion.motion import Motion, load_motion, save_motion
from model.speech.audio import Speech
from processes.job import Job
from renderer.figures.curves import SPEECH_EFFECT_CAPTION, SpeechEffectRow
from renderer.figures.style import MAX_SYSTEMS

USED_SPEECH_S = 60.0
"""Part of each speech that is used (s)."""
_NAMED = re.compile(r"(?:(?P<system>.+?)__)?(?P<speech>.+?)__(?P<seed>\d{1,9})\.npz")
_COLUMNS = (
    *("same_speech", "same_noise", "neither", "by_speech", "by_noise", "lead"),
    *("lead_low", "lead_high"),
)


@dataclass(frozen=True)
class _SystemMotions:
    """Motions of one system, by speech and seed."""

    by_speech: Grid
    guidance: float | None = None
    """Guidance scale of the speech; None if it is not known."""
    by_speaker: Grid = field(default_factory=dict)
    """Motions for the first speech, by speaker and seed."""


def measure_speech_effect(
    request: SpeechEffectRequest, callbacks: RunCallbacks = NO_CALLBACKS
) -> None:
    """Generate each speech with each seed, or read a folder of motions, and compare the motions.

    The motions, metrics, figure, and sentences as notes are written. Raises Cancelled, or with one
    sentence RunError, SpeechError, MotionError, UnknownNameError, CheckpointError or WriteError.
    """
    request.check()
    record = RunRecord(
        kind="imported" if request.compares_existing_motions else "generated",
        tracked_point=DEFAULT_TRACKED_POINT,
    )
    with open_run_writer(request.output.out, record, callbacks) as run:
        if request.compares_existing_motions:
            of_system = {
                name: _SystemMotions(grid) for name, grid in _read_grids(request.inputs[0]).items()
            }
            run.progress_callback("numbers")(1.0)
        else:
            speeches = {
                safe_file_stem(path.stem): load_first_seconds(
                    path, USED_SPEECH_S, request.max_speech_s
                )
                for path in request.inputs
            }
            names = requested_systems(request)
            check_distinct_file_stems(f"{name}__{speech}" for name in names for speech in speeches)
            of_system = _generate_grids(request, speeches, run)
            for system, made in of_system.items():
                for (speech, seed), motion in made.by_speech.items():
                    path = run.folder.new_path(f"{safe_file_stem(system)}__{speech}__{seed}.npz")
                    save_motion(motion, path)
                    run.add_files(path)
        effects = {
            system: _effect_numbers(system, made, request.speakers)
            for system, made in of_system.items()
        }
        labels = short_names(effects)
        run.add_notes(
            *(_effect_sentence(labels[system], numbers) for system, numbers in effects.items())
        )
        table = [
            (system, part, *shares.values(), WORKBENCH)
            for system, numbers in effects.items()
            for part, shares in numbers["parts"].items()
        ]
        run.write_json_and_csv(
            "speech_effect", effects, [("system", "part", *_COLUMNS, "protocol"), *table]
        )
        _draw_speech_effect(effects, of_system, run, request)
        run.finish(f"Compared {pluralise(len(effects), 'system')}.")


def _generate_grids(
    request: SpeechEffectRequest, speeches: Mapping[str, Speech], run: RunWriter
) -> dict[str, _SystemMotions]:
    """Generate all motions, in several processes where that is worth their start."""
    systems = [get_system(name, request.weights) for name in requested_systems(request)]
    first, seeds, speakers = next(iter(speeches)), range(request.num_seeds), request.speakers or ()
    folder, jobs = run.folder.scratch("motions").absolute(), list[Job]()
    folder.mkdir()
    seconds_of_motion = 0.0

    def motion_file(system: System, speech: str, **conditions: Any) -> Path:
        nonlocal seconds_of_motion
        seconds_of_motion += speeches[speech].duration_s
        path = folder / f"{len(jobs)}.npz"
        options = generation_options(request.sampling, system, **conditions)
        weights = request.weights.absolute()
        work = partial(_generate_to, path, system.name, weights, speeches[speech], options)
        jobs.append(Job(path.stem, path.is_file, work))
        return path

    guidance = {each.name: generation_options(request.sampling, each).guidance for each in systems}
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
    on_share, done = run.progress_callback("numbers"), itertools.count(1)
    on_share(0.0)
    failed = make_job_pool(seconds_of_motion).run_all(
        jobs, lambda _: on_share(next(done) / len(jobs)), should_cancel=run.should_cancel
    )
    for error in failed.values():
        raise error

    def grid(paths: Mapping[tuple[str, int], Path]) -> Grid:
        return {key: load_motion(path) for key, path in paths.items()}

    return {
        name: _SystemMotions(grid(paths), guidance[name], grid(by_speaker))
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
                f"{path.name} must be named SYSTEM__SPEECH__SEED.npz or SPEECH__SEED.npz "
                "(two underscores), so that its speech and seed are known."
            )
        grid = grids.setdefault(named["system"] or folder.name, {})
        grid[named["speech"], int(named["seed"])] = read_any_motion(path).motion
    if not 1 <= len(grids) <= MAX_SYSTEMS:
        limit = f"motion of 1 to {MAX_SYSTEMS} systems"
        raise RunError(f"{folder} must contain {limit}; found {len(grids)}.")
    return dict(grids)


def _effect_numbers(
    system: str, generated: _SystemMotions, speakers: tuple[str, str] | None
) -> dict[str, Any]:
    """Return the content of ``speech_effect.json`` for one system."""

    def shares(shares_of_motion: SharedInputCorrelations) -> dict[str, float]:
        return {column: getattr(shares_of_motion, column) for column in _COLUMNS}

    try:
        parts = {
            part: shares(part_shares)
            for part, part_shares in speech_and_noise_shares(generated.by_speech).items()
        }
        effect = {
            "protocol": WORKBENCH,
            "guidance": generated.guidance,
            "arm_rotations_same_noise": arm_rotation_correlation_same_noise(generated.by_speech),
            "parts": parts,
        }
        if speakers is None:
            return effect
        calm, lively = calm_and_lively_wrist_speeds(generated.by_speaker, speakers).values()
        compared = {
            "calm": speakers[0],
            "lively": speakers[1],
            "manner": arm_speaker_effect(generated.by_speaker),
            "calm_over_lively": calm / lively,
        }
    except ValueError as error:
        raise RunError(f"{system}: {error}") from error
    return {**effect, "speakers": compared}


def _effect_sentence(system: str, numbers: Mapping[str, Any]) -> str:
    """Format the results of a system's arms as sentences."""
    arms = numbers["parts"]["arms"]
    lead, low, high = (round(arms[key], 2) for key in ("lead", "lead_low", "lead_high"))
    if low > 0:
        verdict = "Arm motion depends more on the speech than on the noise seed."
    elif high < 0:
        verdict = "Arm motion depends more on the noise seed than on the speech."
    else:
        verdict = (
            "The difference between the effects of speech and noise seed is not significant; use "
            "more speech recordings and seeds."
        )
    sentence = (
        f"{system}: compared with pairs of motions that share neither speech nor noise seed, the "
        f"correlation of arm speeds is higher by {_format_gain(arms['by_speech'])} in pairs that "
        f"share the speech and by {_format_gain(arms['by_noise'])} in pairs that share the seed "
        f"(difference {_format_gain(lead)}, 95 % confidence interval over pairs "
        f"{_format_gain(low)} to {_format_gain(high)}). {verdict} In pairs with the same seed "
        "and different speech, arm rotations correlate at r = "
        f"{numbers['arm_rotations_same_noise']:.2f}."
    )
    if "speakers" not in numbers:
        return sentence
    both = numbers["speakers"]
    calm, manner = both["calm"], both["manner"]
    return (
        f"{sentence} For the speakers {calm} and {both['lively']} with the same speech, the "
        f"correlation is higher by {_format_gain(manner['by_speaker'])} in pairs that share the "
        "speaker than in pairs that share neither speaker nor seed. From the same seed and speech, "
        "the arm rotations of the two speakers correlate at r = "
        f"{manner['arm_rotations_same_noise']:.2f}, and {calm}'s wrists move "
        f"{both['calm_over_lively']:.2f} times as fast as {both['lively']}'s."
    )


def _draw_speech_effect(
    numbers: Mapping[str, Mapping[str, Any]],
    of_system: Mapping[str, _SystemMotions],
    run: RunWriter,
    request: SpeechEffectRequest,
) -> None:
    rows = [
        SpeechEffectRow(
            system,
            {
                key: smoothed_arm_speed_sum_deg_s(motion)
                for key, motion in of_system[system].by_speech.items()
            },
            {
                part: (shares["by_speech"], shares["by_noise"])
                for part, shares in of["parts"].items()
            },
        )
        for system, of in numbers.items()
    ]
    run.write_figure("speech_effect", rows, SPEECH_EFFECT_CAPTION, request.output.figure_formats)


def _format_gain(correlation: float) -> str:
    """Format a difference of two correlation coefficients."""
    return f"{correlation:z.2f}".replace("-", "\N{MINUS SIGN}")
