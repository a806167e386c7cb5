"""One test clip measured: every system's motion beside the recorded one, kept on disk."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from model.data.recordings import read_files, speaker_of
from model.evaluation.clips import RECORDED, ClipContext, ClipRow
from model.evaluation.few_clips import FewClips
from model.evaluation.matching import speech_tracks
from model.evaluation.speakers import SpeakerJudge
from model.generation.base import System
from model.generation.clip_noise import clip_seed
from model.generation.windows import GenerateOptions, generate_motion
from model.motion.motion import Motion, first_frames
from model.networks.autoencoder import FrozenEncoder
from model.speech.audio import Speech
from model.speech.encoder import SpeechEncoder
from model.storage.files import written_atomically
from model.systems.matching.network import MatchingJudge

_NUMBERS = ("measures", "by_depth", "couplings", "errors")


def save_rows(path: Path, rows: dict[str, ClipRow]) -> None:
    """Write a clip's rows, whole or not at all: numbers as JSON, arrays as they are."""
    arrays: dict[str, np.ndarray] = {}
    told = {}
    for place, (name, row) in enumerate(rows.items()):
        own = {f"features.{key}": value for key, value in row.features.items()}
        own |= {f"positions.{seed}": joints for seed, joints in enumerate(row.positions)}
        own["windows"] = row.windows
        arrays |= {f"{place}.{key}": array for key, array in own.items()}
        told[name] = {key: getattr(row, key) for key in _NUMBERS}
    text = json.dumps(told).encode()
    with written_atomically(path) as part:
        np.savez(part, rows=np.frombuffer(text, np.uint8), **arrays)  # type: ignore[arg-type]


def load_rows(path: Path) -> dict[str, ClipRow]:
    """What `save_rows` wrote."""
    with np.load(path, allow_pickle=False) as archive:
        told = json.loads(archive["rows"].tobytes())
        rows = {}
        for place, (name, numbers) in enumerate(told.items()):
            start = f"{place}."
            own = {key[len(start) :]: archive[key] for key in archive if key.startswith(start)}
            features = {k.partition(".")[2]: v for k, v in own.items() if k.startswith("features.")}
            seeds = sum(key.startswith("positions.") for key in own)
            rows[name] = ClipRow(
                **numbers,
                features=features,
                positions=[own[f"positions.{seed}"] for seed in range(seeds)],
                windows=own["windows"],
            )
    return rows


@dataclass(frozen=True)
class Cast:
    """Who is measured, and the encoders of the distances."""

    systems: Sequence[System]
    judges: Mapping[str, FrozenEncoder]
    matching: MatchingJudge | None = None
    """Who tells matched from mismatched speech."""


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


def read_recording(folder: Path, name: str) -> Recording:
    """The frames that both motion and speech have.

    Raises:
        DataError, MotionError, SpeechError: if it cannot be used.
    """
    motion, speech = read_files(folder, name)
    return Recording(first_frames(motion, min(motion.num_frames, speech.num_frames)), speech)


def speaker_in(clip_name: str) -> str:
    """The speaker's name."""
    return speaker_of(clip_name)[1]


@dataclass(frozen=True)
class OneClip:
    """What is the same for all clips of an evaluation."""

    folder: Path
    cast: Callable[[], Cast]
    seeds: int
    guidance: float | None
    few: FewClips
    speaker_judge: SpeakerJudge | None
    batch_windows: int
    mean_speed: np.ndarray
    """Of the joints whose beats count, over all clips."""

    def measure(self, name: str, other: str, out: Path) -> None:
        """Write the rows of clip ``name``; the speech of ``other`` is the wrong one."""
        cast = self.cast()
        mine, foreign = read_recording(self.folder, name), read_recording(self.folder, other)
        motion = mine.motion
        context = ClipContext(
            motion, mine.speech.waveform, foreign.speech.waveform, self.mean_speed, cast.judges,
            cast.matching,
        )  # fmt: skip
        of_recordings = (
            context.in_silence()
            | self.few.recorded_measures(self.folder, name)
            | self._told([motion], name)
        )
        rows = {RECORDED: context.row([motion], more=of_recordings)}
        for system in cast.systems:
            guidance = None if system.guidance is None else self.guidance
            options = GenerateOptions(
                speaker=speaker_in(name),
                seed=clip_seed(0, name),
                samples=self.seeds,
                guidance=guidance,
            )
            prediction = system.predict_with(
                motion,
                speech_tracks(mine.features(system.encoder), foreign.features(system.encoder)),
                system.speaker_index(speaker_in(name)),
                self.batch_windows,
            )
            motions = generate_motion(system, mine.speech, options)
            elsewhere = generate_motion(system, foreign.speech, options)
            more = self.few.measures(system, name, mine.speech, guidance)
            more |= self._told(motions, name)
            rows[system.name] = context.row(motions, prediction, elsewhere, more)
        save_rows(out, rows)

    def _told(self, motions: Sequence[Motion], name: str) -> dict[str, float]:
        judge = self.speaker_judge
        return {} if judge is None else judge.measures(motions, speaker_in(name))
