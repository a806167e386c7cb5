"""Measure systems: ``python -m model.evaluate [PROTOCOL] --data DIR --out OUT``.

- ``motion``, the default: metrics of generated motion compared with the recorded motion of the same
  clips, distances of their distributions, and the effect of matched against mismatched speech. Each
  value has a bootstrap interval over the test clips of speakers on which all systems were trained.
  Writes ``evaluation.json``, ``.md``, ``.csv`` and ``.tex``. Clips are distributed over processes
  or a Dask cluster. Metrics of finished clips are stored in ``clips``; the same command resumes.
- ``adherence``: does a system follow its plan? Writes the file ``OUT``.
- ``finding``: how well are plans detected in motion? Writes the file ``OUT``.
"""

import argparse
import hashlib
import json
import logging
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import cache, partial
from importlib import import_module
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from conventions.names import printable
from model.data.recordings import DataError, fingerprint, parse_speaker, read_split
from model.evaluation import classifiers, frechet, tables
from model.evaluation.adherence import evaluate_adherence
from model.evaluation.classifiers import SpeakerComparisonClips
from model.evaluation.clips import (
    ROWS_FORMAT,
    ClipEvaluator,
    EvaluationModels,
    clip_metrics_table,
    load_rows,
    pelvis_centred_positions,
    read_recording_cut_to_speech,
)
from model.evaluation.plan_detection import running_detection_scores
from model.generation.base import System
from model.metrics import beats
from model.metrics.protocols.table import WORKBENCH, protocol_of
from model.motion.motion import Motion
from model.networks.autoencoder import load_motion_encoder
from model.sampling.samplers import DEFAULT_SAMPLING, Sampling, UnknownNameError
from model.speech.audio import SpeechError
from model.storage.cards import (
    BUNDLED_WEIGHTS,
    DEFAULT_SPEAKER_PAIR,
    CheckpointError,
    parse_calm_and_lively_speaker,
)
from model.storage.files import FileStamps, file_stamps, write_atomically
from model.storage.npz import MotionError
from model.systems.helpers.config import MATCHING_NETWORK
from model.systems.helpers.matching import load_matcher
from model.systems.registry import list_systems, load_system
from processes.job import Job, JobsError
from processes.pool import JobPool

log = logging.getLogger(__name__)

SINGLE_PROCESS = JobPool(1)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m model.evaluate",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("protocol", nargs="?", choices=PROTOCOLS, default="motion")
    parser.add_argument("--data", type=Path, required=True, help="folder in BEAT2's layout")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder (motion) or FILE.json (adherence, finding)"
    )
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS)
    parser.add_argument(
        "--clips", type=int, help="number of clips (default: all; for adherence: 20)"
    )
    motion = parser.add_argument_group("motion")
    motion.add_argument("--systems", default="all", help="names separated by commas, or: all")
    motion.add_argument("--seeds", type=int, default=2, help="number of noise seeds per clip")
    motion.add_argument(
        "--guidance", type=float, help="guidance scale (default: that of each system)"
    )
    motion.add_argument(
        "--speakers",
        default=",".join(DEFAULT_SPEAKER_PAIR),
        metavar="CALM,LIVELY",
        help="two speakers whose gesture styles are compared (default: %(default)s)",
    )
    motion.add_argument(
        "--processes", type=int, help="processes on this machine (default: all cores)"
    )
    motion.add_argument("--scheduler", help="address of a Dask scheduler, such as tcp://head:8786")
    plans = parser.add_argument_group("adherence and finding (for a corpus with annotated plans)")
    plans.add_argument(
        "--edits", type=int, default=10, help="random edits of each clip (default: %(default)s)"
    )
    plans.add_argument(
        "--seed", type=int, default=0, help="random seed of the edits (default: %(default)s)"
    )
    plans.add_argument("--fit", action="store_true", help="train the plan detector first")
    args = parser.parse_args(arguments)
    torch.set_num_threads(1)
    try:
        PROTOCOLS[args.protocol](args)
    except (JobsError, CheckpointError, UnknownNameError, OSError, ValueError) as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return 1
    return 0


def _motion(args: argparse.Namespace) -> None:
    calm_and_lively, weights = parse_calm_and_lively_speaker(args.speakers), args.weights.absolute()
    names = list_systems(weights) if args.systems == "all" else args.systems.split(",")
    stamps = file_stamps(weights.glob("[!.]*"))
    load_models = partial(load_evaluation_models, tuple(names), weights, stamps)
    table = evaluate(
        load_models,
        args.data.absolute(),
        names_of_test_clips(args.data, load_models().systems)[: args.clips],
        args.seeds,
        sampling=Sampling(guidance=args.guidance),
        speakers=calm_and_lively,
        pool=JobPool(args.processes, args.scheduler),
        resume_folder=args.out / "clips",
    )
    write_table(table, args.out)
    sys.stdout.write(tables.as_markdown(table))


def _plans(args: argparse.Namespace) -> None:
    if args.protocol == "adherence":
        answers = evaluate_adherence(
            args.data, args.weights, args.clips or 20, args.edits, args.seed
        )
    else:
        answers = running_detection_scores(args.data, args.clips, args.fit)
    plans = {}
    for plans in tqdm(answers, desc="clips", unit="clip"):
        content = {"protocol": WORKBENCH, **plans}  # what there is so far
        write_atomically(args.out, json.dumps(content, indent=1) + "\n")
    for question, answer in plans.items():
        numbers = ", ".join(f"{name} {number:.4g}" for name, number in answer.items())
        sys.stdout.write(f"{question}: {numbers}\n")


PROTOCOLS = {"motion": _motion, "adherence": _plans, "finding": _plans}


def write_table(table: dict, out: Path) -> None:
    """Write the four files, each atomically."""
    out.mkdir(parents=True, exist_ok=True)
    contents = {
        "json": json.dumps(table, indent=1) + "\n",
        "md": tables.as_markdown(table),
        "csv": tables.as_csv(table),
        "tex": tables.as_latex(table),
    }
    for ending, content in contents.items():
        write_atomically(out / f"evaluation.{ending}", content)


def names_of_test_clips(folder: Path, systems: Sequence[System]) -> list[str]:
    """Return the test clips with speakers that all systems know; raises DataError if none."""
    speakers = set.intersection(*(set(system.speakers) for system in systems))
    names = [name for name, kind in sorted(read_split(folder).items()) if kind == "test"]
    names = [name for name in names if parse_speaker(name)[1] in speakers]
    if not names:
        raise DataError(
            f"{folder} has no test clip of a speaker on which all systems were trained."
        )
    return names


def evaluate(
    load_models: Callable[[], EvaluationModels],
    folder: Path,
    clips: Sequence[str],
    num_seeds: int,
    *,
    sampling: Sampling = DEFAULT_SAMPLING,
    speakers: tuple[str, str] = DEFAULT_SPEAKER_PAIR,
    pool: JobPool = SINGLE_PROCESS,
    resume_folder: Path,
) -> dict:
    """Compute the table, with the row ``recorded`` for the clips' recorded motion.

    `clip_metrics_table` lists its parts, ``left_out`` the missing metrics. Every clip has a noise
    seed that is the same for all systems.

    Args:
        load_models: loads the systems and classifiers, once in each process.
        speakers: a calm one and a lively one, who are compared on a few clips.
        pool: runs the jobs, one for each clip.
        resume_folder: folder with the numbers of each clip; those of the same recordings, weights
            and options are read from it.

    Raises:
        DataError: if fewer than two clips can be used.
        JobsError: if workers are lost.
    """
    models = load_models()
    motions = _usable(folder, clips, models)
    names = list(motions)
    speeds = [
        beats.joint_speeds(pelvis_centred_positions(motion)[:, beats.BEAT_JOINTS]).mean(0)
        for motion in motions.values()
    ]
    speaker_comparison = SpeakerComparisonClips.choose(folder, names, models.systems, speakers)
    clip_speakers = [parse_speaker(name)[1] for name in names]
    judge = classifiers.fit_speaker_classifier(folder, clip_speakers)
    evaluator = ClipEvaluator(
        folder, load_models, num_seeds, sampling, speaker_comparison, judge, np.mean(speeds, axis=0)
    )
    stamp = _stamp(evaluator, names, models)
    resume_folder.mkdir(parents=True, exist_ok=True)
    files = {name: (resume_folder / f"{name}-{stamp}.npz").absolute() for name in names}
    jobs = [
        Job(name, files[name].is_file, partial(evaluator.measure, name, other, files[name]))
        for name, other in zip(names, [*names[1:], names[0]], strict=True)
    ]
    todo = sum(not job.is_done() for job in jobs)
    with tqdm(total=todo, desc="clips", unit="clip") as bar:
        for error in pool.run_all(jobs, lambda _: bar.update()).values():
            raise error
    rows = [load_rows(files[name]) for name in names]
    return {
        "clips": names,
        "noise_seeds": num_seeds,
        "guidance": _guidance_by_system(models.systems, sampling),
        "protocols": {measure: protocol_of(measure) for measure in tables.COLUMNS},
        **clip_metrics_table(rows, clip_speakers),
        "left_out": [
            *frechet.left_out_sentences(models.encoders, motions.values()),
            *([] if models.matching_classifier else [classifiers.NO_MATCHING_CLASSIFIER]),
            *([] if speaker_comparison.speakers else [classifiers.SPEAKERS_NOT_COMPARED]),
            *([] if judge else [classifiers.NO_SPEAKER_CLASSIFIER]),
        ],
    }


@cache
def load_evaluation_models(
    names: tuple[str, ...], weights: Path, stamps: FileStamps
) -> EvaluationModels:
    """Load systems and evaluation networks, once per process and version of their files."""
    judges = {
        measure: load_motion_encoder(weights, encoder)
        for measure, encoder in frechet.ENCODER_NAMES.items()
        if (weights / f"{encoder}.safetensors").is_file()
    }
    has_judge = (weights / f"{MATCHING_NETWORK}.safetensors").is_file()
    return EvaluationModels(
        tuple(load_system(name, weights) for name in names),
        judges,
        load_matcher(weights, MATCHING_NETWORK) if has_judge else None,
    )


def _guidance_by_system(systems: Sequence[System], sampling: Sampling) -> dict[str, float | None]:
    """Return each system's guidance scale; systems without guidance have None."""
    return {
        each.name: each.resolve_sampling(each.supported_sampling(sampling)).guidance
        for each in systems
    }


def _stamp(evaluator: ClipEvaluator, names: Sequence[str], models: EvaluationModels) -> str:
    """Compute a digest of recordings, weights and options, which identifies stored numbers."""
    judge = evaluator.speaker_classifier
    stamp = {
        "format": ROWS_FORMAT,
        "recordings": fingerprint(evaluator.folder, names),
        "clips": list(names),
        "systems": {system.name: dict(system.sha256s) for system in models.systems},
        "judges": {measure: judge.sha256 for measure, judge in models.encoders.items()},
        "matching": models.matching_classifier and models.matching_classifier.sha256,
        "seeds": evaluator.num_seeds,
        "guidance": _guidance_by_system(models.systems, evaluator.sampling),
        "few": asdict(evaluator.speaker_comparison),
        "speaker_judge": judge and np.round(judge.weights, 6).tolist(),
    }
    return hashlib.sha256(json.dumps(stamp, sort_keys=True).encode()).hexdigest()[:16]


def _usable(folder: Path, clips: Sequence[str], models: EvaluationModels) -> dict[str, Motion]:
    """Read motions by name; log the unusable ones; raises DataError if fewer than two are left."""
    motions = {}
    window = max(system.windowing.frames for system in models.systems)
    for name in clips:
        try:
            motion, _ = read_recording_cut_to_speech(folder, name)
            if motion.num_frames < window:
                raise DataError(f"it has {motion.num_frames} frames; at least {window} are needed.")
        except (DataError, MotionError, SpeechError) as error:
            log.warning("Skipped %s: %s", name, error)
        else:
            motions[name] = motion
    if len(motions) < 2:
        raise DataError(
            f"{len(motions)} of {len(clips)} test clips in {folder} can be used; at least 2 are "
            "needed."
        )
    return motions


if __name__ == "__main__":
    # The import name, so that other processes can unpickle the functions of this module.
    sys.exit(import_module("model.evaluate").main())
