"""Training data: a folder in BEAT2's layout, read once into memory-mapped arrays.

Poses, root positions, face units and speech features of all clips lie end to end; a window is a
slice. Features are computed once per file, with context, and never per window.
"""

import csv
import json
import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from tqdm import tqdm

from model.files import written_atomically
from model.motion import Motion, MotionError, load_motion
from model.speech.audio import SpeechError, SpeechLimits, load_speech
from model.speech.encoder import SpeechEncoder

log = logging.getLogger(__name__)

NUM_FACE_UNITS = 52
_ARRAYS = {"poses": 165, "transl": 3, "expression": NUM_FACE_UNITS}


class DataError(ValueError):
    """A data folder that cannot be used: says what is missing and what to do."""


@dataclass(frozen=True)
class Clip:
    """Where one recording lies in the arrays."""

    name: str
    speaker: int
    split: str
    start: int
    num_frames: int

    @property
    def stop(self) -> int:
        return self.start + self.num_frames


@dataclass(frozen=True)
class Batch:
    """Windows cut from clips; every tensor starts with the batch axis."""

    poses: Float[Tensor, "B T 165"]
    transl: Float[Tensor, "B T 3"]
    expression: Float[Tensor, "B T 52"]
    speech: Float[Tensor, "B T dim"]
    speaker: Int[Tensor, " B"]
    clips: list[str]
    frames: Int[np.ndarray, "B T"]


@dataclass(frozen=True)
class PreparedData:
    """All clips of a data folder as arrays of frames."""

    clips: tuple[Clip, ...]
    poses: np.ndarray
    transl: np.ndarray
    expression: np.ndarray
    speech: np.ndarray
    speakers: dict[int, str]

    def of_split(self, split: str) -> tuple[Clip, ...]:
        """The clips of ``train``, ``val``, ``test`` or ``additional``.

        Raises:
            DataError: if there are none.
        """
        clips = tuple(clip for clip in self.clips if clip.split == split)
        if not clips:
            found = ", ".join(sorted({clip.split for clip in self.clips})) or "no clips"
            raise DataError(f"train_test_split.csv names no usable {split} clip (found: {found}).")
        return clips

    def window_batch(
        self, clips: tuple[Clip, ...], window: int, size: int, rng: np.random.Generator
    ) -> Batch:
        """``size`` windows of ``window`` frames, every possible start equally likely."""
        usable = [clip for clip in clips if clip.num_frames >= window]
        starts = np.array([clip.num_frames - window + 1 for clip in usable], float)
        chosen = rng.choice(len(usable), size, p=starts / starts.sum())
        first = [usable[c].start + int(rng.integers(starts[c])) for c in chosen]
        frames = np.array(first)[:, None] + np.arange(window)
        return self.batch(frames, [usable[c] for c in chosen])

    def batch(self, frames: Int[np.ndarray, "B T"], clips: list[Clip]) -> Batch:
        """The rows at ``frames`` (absolute indices) as tensors."""

        def take(array: np.ndarray) -> Tensor:
            return torch.from_numpy(array[frames].astype(np.float32))

        return Batch(
            poses=take(self.poses),
            transl=take(self.transl),
            expression=take(self.expression),
            speech=take(self.speech),
            speaker=torch.tensor([clip.speaker for clip in clips]),
            clips=[clip.name for clip in clips],
            frames=frames,
        )


def read_split(folder: Path) -> dict[str, str]:
    """Clip name -> ``train``, ``val``, ``test`` or ``additional``, from BEAT2's csv.

    Raises:
        DataError: if the file is missing or has other columns.
    """
    path = folder / "train_test_split.csv"
    if not path.is_file():
        raise DataError(f"{path} is missing; the folder is not laid out as BEAT2.")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows or not {"id", "type"} <= set(rows[0]):
        raise DataError(f"{path} must have the columns id and type.")
    return {row["id"]: row["type"] for row in rows}


def read_clip(folder: Path, name: str, encoder: SpeechEncoder) -> tuple[Motion, np.ndarray]:
    """Motion and speech features of one recording, both cut to the shorter of the two.

    Raises:
        MotionError, SpeechError: if either file cannot be used.
    """
    motion = load_motion(folder / "smplxflame_30" / f"{name}.npz")
    speech = load_speech(
        folder / "wave16k" / f"{name}.wav", SpeechLimits(max_s=3600, max_bytes=2**31)
    )
    num_frames = min(motion.num_frames, speech.num_frames)
    features = encoder.encode(speech.waveform, num_frames)
    cut = replace(
        motion,
        poses=motion.poses[:num_frames],
        trans=motion.trans[:num_frames],
        expressions=motion.expressions[:num_frames],
    )
    return cut, features


def prepare(
    folder: Path, cache: Path, encoder: SpeechEncoder, *, min_frames: int = 60
) -> PreparedData:
    """Read ``folder`` once into ``cache`` (kept for the next run), then map it.

    Clips that cannot be read or are shorter than ``min_frames`` are named in the log, counted and
    left out.

    Raises:
        DataError: if nothing usable is left, or the cache belongs to other data.
    """
    split = read_split(folder)
    origin = {
        "folder": sorted(split.items()),
        "encoder": encoder.name,
        "dim": encoder.dim,
        "min_frames": min_frames,
    }
    index_path = cache / "index.json"
    if not index_path.is_file():
        _fill_cache(folder, cache, encoder, split, origin, min_frames)
    index = json.loads(index_path.read_text())
    if index["origin"] != json.loads(json.dumps(origin)):
        raise DataError(f"{cache} was made from other data or another encoder; remove it.")
    clips = tuple(Clip(**clip) for clip in index["clips"])
    arrays = {name: np.load(cache / f"{name}.npy", mmap_mode="r") for name in (*_ARRAYS, "speech")}
    speakers = {int(number): name for number, name in index["speakers"].items()}
    return PreparedData(clips=clips, speakers=speakers, **arrays)


def _fill_cache(
    folder: Path,
    cache: Path,
    encoder: SpeechEncoder,
    split: dict[str, str],
    origin: dict,
    min_frames: int,
) -> None:
    cache.mkdir(parents=True, exist_ok=True)
    clips: list[Clip] = []
    parts: dict[str, list[np.ndarray]] = {name: [] for name in (*_ARRAYS, "speech")}
    speakers: dict[int, str] = {}
    skipped = 0
    start = 0
    for name, kind in tqdm(sorted(split.items()), desc="reading clips", unit="clip"):
        try:
            motion, features = read_clip(folder, name, encoder)
            number, speaker = _speaker_of(name)
        except (MotionError, SpeechError, DataError) as error:
            log.warning("Skipped %s: %s", name, error)
            skipped += 1
            continue
        if motion.num_frames < min_frames:
            log.warning("Skipped %s: %d frames, %d needed.", name, motion.num_frames, min_frames)
            skipped += 1
            continue
        speakers[number] = speaker
        clips.append(Clip(name, number, kind, start, motion.num_frames))
        start += motion.num_frames
        parts["poses"].append(motion.poses)
        parts["transl"].append(motion.trans)
        parts["expression"].append(_face_units(motion))
        parts["speech"].append(features.astype(np.float16))
    if not clips:
        raise DataError(f"{folder} holds no usable clip ({skipped} skipped).")
    if skipped:
        log.warning("%d of %d clips were skipped.", skipped, len(split))
    for name, rows in parts.items():
        with written_atomically(cache / f"{name}.npy") as path:
            np.save(path, np.concatenate(rows))
    index = {
        "origin": origin,
        "clips": [vars(clip) for clip in clips],
        "speakers": {str(number): name for number, name in sorted(speakers.items())},
    }
    with written_atomically(cache / "index.json") as path:
        path.write_text(json.dumps(index))


def _speaker_of(clip_name: str) -> tuple[int, str]:
    number, _, rest = clip_name.partition("_")
    if not number.isdigit() or not rest:
        raise DataError(f"{clip_name} does not start with a speaker number and name.")
    return int(number), rest.split("_")[0]


def _face_units(motion: Motion) -> np.ndarray:
    """The 52 face units; zero where the clip has FLAME coefficients instead."""
    if motion.expression_basis == "arkit52":
        return motion.expressions[:, :NUM_FACE_UNITS].astype(np.float32)
    return np.zeros((motion.num_frames, NUM_FACE_UNITS), np.float32)


def validation_batches(
    data: PreparedData, clips: tuple[Clip, ...], window: int, size: int, count: int
) -> Iterator[Batch]:
    """The same ``count`` batches every time."""
    for k in range(count):
        yield data.window_batch(clips, window, size, np.random.default_rng([k, 91]))
