"""Measure systems: ``python -m model.evaluate --data DIR --systems A,B --out DIR``.

Three questions, each with a bootstrap interval over clips: how does generated motion move beside
the recorded motion of the same clips, how near is its distribution, and does the right speech help
more than the wrong one? Clips of the test split, of speakers the weights know. Writes
``evaluation.json``, ``.md``, ``.csv`` and ``.tex``. Under torchrun the clips are shared out.
"""

import argparse
import json
import logging
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Float
from tqdm import tqdm

from model.data.recordings import DataError, read_files, read_split, speaker_of
from model.evaluation import frechet, tables
from model.evaluation.clip_measures import rooted_positions
from model.evaluation.clips import RECORDED, ClipContext, ClipRow, as_table
from model.evaluation.speech_response import speech_tracks
from model.generation.base import System
from model.generation.clip_noise import clip_seed
from model.generation.family import UnknownNameError
from model.generation.windows import GenerateOptions, generate_motion
from model.measures import beats
from model.motion.motion import Motion, MotionError, first_frames
from model.networks.autoencoder import FrozenEncoder, load_encoder
from model.speech.audio import Speech, SpeechError
from model.speech.encoder import SpeechEncoder
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError
from model.storage.files import written_atomically
from model.systems.registry import list_systems, load_system
from model.training.parallel import WHOLE, Shard, joined_processes

log = logging.getLogger(__name__)

BATCH_WINDOWS = 64


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="python -m model.evaluate", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder in BEAT2's layout")
    parser.add_argument("--systems", default="all", help="names with commas between, or: all")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS)
    parser.add_argument("--seeds", type=int, default=2, help="noise seeds for each clip")
    parser.add_argument("--guidance", type=float, default=1.0, help="strength of the speech")
    parser.add_argument("--clips", type=int, help="only the first so many clips")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args(arguments)
    torch.set_num_threads(args.threads)
    names = list_systems(args.weights) if args.systems == "all" else args.systems.split(",")
    try:
        systems = [load_system(name, args.weights) for name in names]
        judges = {
            measure: load_encoder(args.weights, encoder)
            for measure, encoder in frechet.ENCODERS.items()
            if (args.weights / f"{encoder}.safetensors").is_file()
        }
        clips = test_clips(args.data, systems)[: args.clips]
        with joined_processes() as shard:
            table = evaluate(args.data, clips, systems, args.seeds, judges=judges, shard=shard,
                             guidance=args.guidance)  # fmt: skip
            if shard.is_first:
                write(table, args.out)
    except (DataError, CheckpointError, UnknownNameError, OSError, ValueError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if shard.is_first:
        sys.stdout.write(tables.as_markdown(table))
    return 0


def write(table: dict, out: Path) -> None:
    """The four files, each whole or not at all."""
    out.mkdir(parents=True, exist_ok=True)
    contents = {
        "json": json.dumps(table, indent=1) + "\n",
        "md": tables.as_markdown(table),
        "csv": tables.as_csv(table),
        "tex": tables.as_latex(table),
    }
    for ending, content in contents.items():
        with written_atomically(out / f"evaluation.{ending}") as path:
            path.write_text(content)


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


def evaluate(
    folder: Path,
    clips: Sequence[str],
    systems: Sequence[System],
    seeds: int,
    *,
    judges: Mapping[str, FrozenEncoder] = MappingProxyType({}),
    guidance: float = 1.0,
    shard: Shard = WHOLE,
    batch_windows: int = BATCH_WINDOWS,
) -> dict:
    """The table, with the row ``recorded`` for the clips' own motion; `as_table` lists its parts.
    Every clip has noise of its own, which is the same for all systems.

    Args:
        judges: encoders by distance, see `frechet.ENCODERS`; a distance without one is left out,
            and ``left_out`` of the table says so.
        batch_windows: windows asked at once; changes the speed and nothing else.

    Raises:
        DataError: if fewer than two clips can be used.
    """
    recordings = _read(folder, clips, systems)
    names = list(recordings)
    mean_speed = np.mean(
        [
            beats.joint_speeds(rooted_positions(motion)[:, beats.BEAT_JOINTS]).mean(0)
            for motion in (recording.motion for recording in recordings.values())
        ],
        axis=0,
    )
    found: dict[str, dict[str, ClipRow]] = {}
    share = [k for k in range(len(names)) if k % shard.count == shard.rank]
    for k in tqdm(share, desc="clips", unit="clip", disable=not shard.is_first):
        name, other = names[k], names[(k + 1) % len(names)]
        mine, foreign = recordings[name], recordings[other]
        motion = mine.motion
        context = ClipContext(
            motion, mine.speech.waveform, foreign.speech.waveform, mean_speed, judges
        )
        rows = {RECORDED: context.row([motion])}
        for system in systems:
            options = GenerateOptions(
                speaker=_speaker(name),
                seed=clip_seed(0, name),
                samples=seeds,
                guidance=guidance if system.takes_guidance else 1.0,
            )
            prediction = system.predict_with(
                motion,
                speech_tracks(mine.features(system.encoder), foreign.features(system.encoder)),
                system.speaker_index(_speaker(name)),
                batch_windows,
            )
            rows[system.name] = context.row(
                generate_motion(system, mine.speech, options), prediction
            )
        found[name] = rows
    gathered = {name: rows for part in shard.gather(found) for name, rows in part.items()}
    table = as_table([gathered[name] for name in names], [_speaker(name) for name in names])
    motions = [recording.motion for recording in recordings.values()]
    return {
        "clips": names,
        "noise_seeds": seeds,
        "guidance": guidance,
        **table,
        "left_out": frechet.left_out(judges, motions),
    }


@dataclass(frozen=True)
class Recording:
    """A test clip: its motion, its speech, and what each encoder hears in it."""

    motion: Motion
    speech: Speech

    def features(self, encoder: SpeechEncoder) -> Float[np.ndarray, "T dim"]:
        """The speech of the motion's frames; encoded once for all systems with that encoder."""
        if encoder.name not in self._heard:
            found = encoder.encode(self.speech.waveform, self.motion.num_frames)
            self._heard[encoder.name] = found
        return self._heard[encoder.name]

    @cached_property
    def _heard(self) -> dict[str, Float[np.ndarray, "T dim"]]:
        return {}


def _read(folder: Path, clips: Sequence[str], systems: Sequence[System]) -> dict[str, Recording]:
    """Recordings by name; what cannot be used is named in the log and counted."""
    recordings = {}
    window = max(system.windowing.frames for system in systems)
    for name in clips:
        try:
            motion, speech = read_files(folder, name)
            num_frames = min(motion.num_frames, speech.num_frames)
            if num_frames < window:
                raise DataError(f"{num_frames} frames, {window} needed.")
        except (DataError, MotionError, SpeechError) as error:
            log.warning("Skipped %s: %s", name, error)
        else:
            recordings[name] = Recording(first_frames(motion, num_frames), speech)
    if len(recordings) < 2:
        raise DataError(
            f"{len(recordings)} of {len(clips)} test clips in {folder} can be used; at least 2 are "
            "needed."
        )
    return recordings


def _speaker(clip_name: str) -> str:
    return speaker_of(clip_name)[1]


if __name__ == "__main__":
    sys.exit(main())
