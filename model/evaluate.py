"""Measure systems: ``python -m model.evaluate --data DIR --systems A,B --out DIR``.

Two questions, each with a bootstrap interval over clips: how does generated motion move beside the
recorded motion of the same clips, and does the right speech help more than the wrong one? Clips of
the test split, of speakers the weights know.
"""

import argparse
import json
import logging
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from tqdm import tqdm

from model.cards import BUNDLED_WEIGHTS, CheckpointError, list_systems
from model.data import DataError, read_clip, read_split
from model.diagnostics import measures
from model.expression import predict_expressions
from model.files import written_atomically
from model.flow import interpolate
from model.generate import GenerateOptions, generate_motion
from model.kinematics import global_from_local
from model.motion import Motion, MotionError
from model.packing import pack
from model.rotations import rot6d_from_matrix
from model.skeleton import open_body_skeleton
from model.speech.audio import SpeechError, SpeechLimits, load_speech
from model.systems import System, UnknownNameError, load_system

log = logging.getLogger(__name__)

MOTION_MEASURES = (
    "tip_jerk_m_s3",
    "tip_path_m_s",
    "tip_velocity_power_above_5hz",
    "seam_jerk_ratio",
    "foot_slide_m_s",
)
FLOW_TIMES = (0.0, 0.2, 0.4)
"""Flow times of the wrong-speech test: early, where speech matters more than x_t."""
SHIFT_S = 4.0
BOOTSTRAP_DRAWS = 2000


@dataclass(frozen=True)
class Interval:
    """A mean over clips with its 95 % bootstrap interval."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:.3g} [{self.low:.3g}, {self.high:.3g}]"


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="python -m model.evaluate", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder in BEAT2's layout")
    parser.add_argument("--systems", default="all", help="names with commas between, or: all")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS)
    parser.add_argument("--seeds", type=int, default=2, help="noise seeds for each clip")
    parser.add_argument("--clips", type=int, help="only the first so many clips")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args(arguments)
    torch.set_num_threads(args.threads)
    names = list_systems(args.weights) if args.systems == "all" else args.systems.split(",")
    try:
        systems = [load_system(name, args.weights) for name in names]
        clips = test_clips(args.data, systems)[: args.clips]
        table = evaluate(args.data, clips, systems, args.seeds)
        args.out.mkdir(parents=True, exist_ok=True)
        with written_atomically(args.out / "evaluation.json") as path:
            path.write_text(json.dumps(table, indent=1) + "\n")
        with written_atomically(args.out / "evaluation.md") as path:
            path.write_text(as_markdown(table))
    except (DataError, CheckpointError, UnknownNameError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stdout.write(as_markdown(table))
    return 0


def test_clips(folder: Path, systems: Sequence[System]) -> list[str]:
    """Names of the test clips whose speaker every system was trained on.

    Raises:
        DataError: if there is none.
    """
    known = set.intersection(*(set(system.speakers) for system in systems))
    names = [name for name, kind in sorted(read_split(folder).items()) if kind == "test"]
    names = [name for name in names if _speaker(name) in known]
    if not names:
        raise DataError(f"{folder} has no test clip of a speaker that the systems know.")
    return names


def evaluate(folder: Path, clips: Sequence[str], systems: Sequence[System], seeds: int) -> dict:
    """``{"clips": [...], "motion": {row: {measure: interval}}, "wrong_speech": {...}}``.

    The row ``recorded`` of ``motion`` holds the clips' own motion. ``wrong_speech`` gives, for each
    system, how much the x_1 error grows with shifted and with foreign speech (1 = not at all).
    """
    skeleton = open_body_skeleton()
    encoder = systems[0].encoder
    numbers: dict[str, dict[str, list[float]]] = {}
    errors: dict[str, dict[str, list[float]]] = {system.name: {} for system in systems}
    recordings = {}
    for name in clips:
        try:
            recordings[name] = read_clip(folder, name, encoder)
        except (MotionError, SpeechError) as error:
            log.warning("Skipped %s: %s", name, error)
    if len(recordings) < 2:
        raise DataError(f"{len(recordings)} usable test clips in {folder}; at least 2 are needed.")
    names = list(recordings)
    for k, name in enumerate(tqdm(names, desc="clips", unit="clip")):
        motion, features = recordings[name]
        foreign = recordings[names[(k + 1) % len(names)]][1]
        _note(numbers, "recorded", [measures(motion, skeleton)])
        speech = load_speech(folder / "wave16k" / f"{name}.wav", SpeechLimits(max_s=3600))
        for system in systems:
            options = GenerateOptions(speaker=_speaker(name), samples=seeds)
            made = generate_motion(system, speech, options)
            _note(numbers, system.name, [measures(m, skeleton) for m in made])
            for kind, error in speech_errors(system, motion, features, foreign, name).items():
                errors[system.name].setdefault(kind, []).append(error)
    return {
        "clips": names,
        "noise_seeds": seeds,
        "motion": {
            row: {measure: vars(bootstrap(values)) for measure, values in columns.items()}
            for row, columns in numbers.items()
        },
        "wrong_speech": {
            name: {
                kind: vars(bootstrap_ratio(by_kind[kind], by_kind["right"]))
                for kind in ("shifted", "foreign")
            }
            for name, by_kind in errors.items()
        },
    }


@torch.inference_mode()
def speech_errors(
    system: System,
    motion: Motion,
    features: Float[np.ndarray, "T dim"],
    foreign: Float[np.ndarray, "T2 dim"],
    name: str,
) -> dict[str, float]:
    """Mean squared x_1 error of the hands-and-torso vector with right, shifted, foreign speech.

    The same windows, noise and flow times for all three; no seed pose, which would give most of the
    answer away.
    """
    config = system.config
    window = config.window_frames
    rotmat = motion.local_rotations()
    if config.rotation_space == "global":
        rotmat = global_from_local(rotmat)
    vectors = pack(rot6d_from_matrix(rotmat), torch.from_numpy(motion.trans))
    target = system.normaliser.normalise(vectors)
    starts = range(0, motion.num_frames - window + 1, window)
    x_1 = torch.stack([target[start : start + window] for start in starts])
    generator = torch.Generator().manual_seed(0)
    x_0 = torch.randn(x_1.shape, generator=generator)
    size = len(x_1)
    index = system.speaker_index(_speaker(name))
    shift = round(SHIFT_S * 30)
    tracks = {
        "right": features,
        "shifted": np.roll(features, shift, axis=0),
        "foreign": np.resize(foreign, features.shape),
    }
    result = {}
    for kind, track in tracks.items():
        speech: Float[Tensor, "T dim"] = torch.from_numpy(np.ascontiguousarray(track))
        expression = predict_expressions(system.expression_network, speech, index)
        errors = []
        for time in FLOW_TIMES:
            t = torch.full((size,), time)
            predicted = system.network(
                interpolate(x_0, x_1, t),
                t,
                speech=torch.stack([speech[s : s + window] for s in starts]),
                expression=torch.stack([expression[s : s + window] for s in starts]),
                seed=torch.zeros(size, config.seed_frames, x_1.shape[-1]),
                speaker=torch.full((size,), index),
                has_seed=torch.zeros(size, dtype=torch.bool),
                has_speech=torch.ones(size, dtype=torch.bool),
            )
            errors.append(float((predicted - x_1).square().mean()))
        result[kind] = float(np.mean(errors))
    return result


def bootstrap(values: Sequence[float], draws: int = BOOTSTRAP_DRAWS) -> Interval:
    """Mean and 95 % percentile interval over resampled clips."""
    array = np.asarray(values, float)
    index = np.random.default_rng(0).integers(len(array), size=(draws, len(array)))
    low, high = np.percentile(array[index].mean(1), [2.5, 97.5])
    return Interval(float(array.mean()), float(low), float(high))


def bootstrap_ratio(wrong: Sequence[float], right: Sequence[float]) -> Interval:
    """Mean error with wrong over mean error with right speech; clips are resampled in pairs."""
    a, b = np.asarray(wrong, float), np.asarray(right, float)
    index = np.random.default_rng(0).integers(len(a), size=(BOOTSTRAP_DRAWS, len(a)))
    low, high = np.percentile(a[index].mean(1) / b[index].mean(1), [2.5, 97.5])
    return Interval(float(a.mean() / b.mean()), float(low), float(high))


def as_markdown(table: dict) -> str:
    """The two tables, each value as mean and interval."""
    lines = [f"| {len(table['clips'])} test clips | " + " | ".join(MOTION_MEASURES) + " |"]
    lines.append("|---" * (len(MOTION_MEASURES) + 1) + "|")
    for row, columns in table["motion"].items():
        cells = [str(Interval(**columns[m])) if m in columns else "-" for m in MOTION_MEASURES]
        lines.append(f"| {row} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "| x_1 error / error with right speech | shifted 4 s | foreign |",
        "|---|---|---|",
    ]
    for name, columns in table["wrong_speech"].items():
        cells = [str(Interval(**columns[kind])) for kind in ("shifted", "foreign")]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _note(numbers: dict, row: str, found: Sequence[dict]) -> None:
    """Add one clip's measures, averaged over noise seeds; those it lacks are left out."""
    for measure in MOTION_MEASURES:
        values = [one[measure] for one in found if one[measure] is not None]
        if values:
            numbers.setdefault(row, {}).setdefault(measure, []).append(float(np.mean(values)))


def _speaker(clip_name: str) -> str:
    return clip_name.split("_")[1]


if __name__ == "__main__":
    sys.exit(main())
