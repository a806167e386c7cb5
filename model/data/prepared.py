"""Training data: a folder in BEAT2's layout, read once into memory-mapped arrays.

Poses, root positions, face units and speech features of all clips lie end to end; a window is a
slice. Features are computed once per file, with context, and never per window. Training recordings
may be stored several times, at other speeds and as other microphones would have caught them.
"""

import json
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from tqdm import tqdm

from model.data.recordings import (
    NUM_FACE_UNITS,
    DataError,
    augmented_copy,
    encode_clip,
    face_units,
    fingerprint,
    read_files,
    read_split,
    speaker_of,
)
from model.motion.motion import Motion
from model.speech.audio import Speech, SpeechError
from model.speech.encoder import SpeechEncoder
from model.storage.files import write_atomically, written_atomically
from model.storage.npz import MotionError

log = logging.getLogger(__name__)

MAX_MISMATCH_S = 5.0
"""Between motion and sound of one recording; some of BEAT2's differ by seconds at the end."""
CACHE_FORMAT = 2
"""Raised whenever the same folder gives other arrays."""
MIN_FRAMES = 60
Columns = Mapping[str, tuple[int, type]]
"""How many numbers a frame has of which kind, by the name of each array."""
_COLUMNS: Columns = {
    "poses": (165, np.float32),
    "transl": (3, np.float32),
    "expression": (NUM_FACE_UNITS, np.float32),
}


@dataclass(frozen=True)
class PreparedClip:
    """Where one recording, or an augmented copy of it, lies in the arrays."""

    name: str
    speaker: int
    split: str
    start: int
    num_frames: int
    copy: int = 0
    """0 for the recording itself, from 1 for its copies."""

    @property
    def stop(self) -> int:
        return self.start + self.num_frames


@dataclass(frozen=True)
class Batch:
    """Windows cut from clips; every tensor starts with the batch axis."""

    poses: Float[Tensor, "B T 165"]
    transl: Float[Tensor, "B T 3"]
    expression: Float[Tensor, "B T 52"]
    speech: Float[Tensor, "B heard dim"]
    speaker: Int[Tensor, " B"]
    clips: list[str]
    frames: Int[np.ndarray, "B T"]
    """Rows of the arrays."""

    def rows(self, which: slice) -> "Batch":
        """Some of the windows."""
        return Batch(**{f.name: getattr(self, f.name)[which] for f in fields(self)})


@dataclass(frozen=True)
class PreparedData:
    """All clips of a data folder as arrays of frames."""

    source: Path
    """The recordings, in BEAT2's layout."""
    folder: Path
    """Where the arrays lie; what is made from them may lie beside them."""
    clips: tuple[PreparedClip, ...]
    poses: np.ndarray
    transl: np.ndarray
    expression: np.ndarray
    speech: np.ndarray
    speakers: dict[int, str]

    def home(self, clip: PreparedClip) -> Float[np.ndarray, "3"]:
        """Where a clip's body stands in the mean, on the floor (y = 0); metres."""
        x, _, z = self.transl[clip.start : clip.stop].mean(0)
        return np.array([x, 0.0, z], np.float32)

    def of_split(self, split: str) -> tuple[PreparedClip, ...]:
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
        self,
        clips: tuple[PreparedClip, ...],
        window: int,
        size: int,
        rng: np.random.Generator,
        context: int = 0,
    ) -> Batch:
        """``size`` windows of ``window`` frames, every possible start equally likely.

        Args:
            context: frames of speech before and after each window; past a clip's end it is held.

        Raises:
            DataError: if no clip is as long as a window.
        """
        usable = [clip for clip in clips if clip.num_frames >= window]
        if not usable:
            raise DataError(f"None of the {len(clips)} clips has {window} frames, a window.")
        starts = np.array([clip.num_frames - window + 1 for clip in usable], float)
        chosen = rng.choice(len(usable), size, p=starts / starts.sum())
        first = [usable[c].start + int(rng.integers(starts[c])) for c in chosen]
        frames = np.array(first)[:, None] + np.arange(window)
        return self.batch(frames, [usable[c] for c in chosen], context)

    def batch(
        self, frames: Int[np.ndarray, "B T"], clips: list[PreparedClip], context: int = 0
    ) -> Batch:
        """The rows at ``frames`` (absolute indices) as tensors."""
        heard = frames[:, :1] + np.arange(-context, frames.shape[1] + context)
        first = np.array([clip.start for clip in clips])[:, None]
        last = np.array([clip.stop for clip in clips])[:, None] - 1

        def take(array: np.ndarray, rows: np.ndarray = frames) -> Tensor:
            return torch.from_numpy(array[rows].astype(np.float32))

        return Batch(
            poses=take(self.poses),
            transl=take(self.transl),
            expression=take(self.expression),
            speech=take(self.speech, heard.clip(first, last)),
            speaker=torch.tensor([clip.speaker for clip in clips]),
            clips=[clip.name for clip in clips],
            frames=frames,
        )


def prepare(
    folder: Path, cache: Path, encoder: SpeechEncoder, *, augmented_copies: int = 0
) -> PreparedData:
    """Read ``folder`` once into ``cache`` (kept for the next run), then map it.

    Clips that cannot be read or are shorter than a window are named in the log, counted and left
    out.

    Args:
        cache: begins the name of the folder; what the arrays are made from is added to it, so that
            other recordings never get these.
        augmented_copies: of each training recording, see `augmented_copy`; the other splits have
            none.

    Raises:
        DataError: if nothing usable is left, or the cache was made in another way.
    """
    split = read_split(folder)
    content = fingerprint(folder, split)
    copies = f"-{augmented_copies}-copies" if augmented_copies > 0 else ""
    cache = cache.with_name(f"{cache.name}{copies}-{content[:12]}")
    origin = {
        "format": CACHE_FORMAT,
        "folder": sorted(split.items()),
        "content": content,
        "encoder": encoder.name,
        "dim": encoder.dim,
        "min_frames": MIN_FRAMES,
        "augmented_copies": augmented_copies,
    }
    columns = {**_COLUMNS, "speech": (encoder.dim, np.float16)}
    index_path = cache / "index.json"
    if not index_path.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        read: list[PreparedClip] = []
        _write(cache, columns, _by_clip(folder, encoder, split, augmented_copies, read))
        named = dict(sorted(speaker_of(clip.name) for clip in read))
        told = {"origin": origin, "clips": [*map(vars, read)], "speakers": named}
        write_atomically(index_path, json.dumps(told))
    index = json.loads(index_path.read_text())
    if index["origin"] != json.loads(json.dumps(origin)):
        raise DataError(f"{cache} was made by another version or with another encoder; remove it.")
    clips = tuple(PreparedClip(**clip) for clip in index["clips"])
    speakers = {int(number): name for number, name in index["speakers"].items()}
    arrays = _mapped(cache, columns, clips[-1].stop)
    return PreparedData(folder, cache, clips=clips, speakers=speakers, **arrays)


def arrays_beside(
    data: PreparedData,
    name: str,
    origin: dict,
    columns: Columns,
    by_clip: Iterable[Sequence[np.ndarray]],
) -> list[np.ndarray]:
    """Arrays of all frames that are made of ``data`` and lie beside its own: made clip by clip
    unless they are there already, then mapped.

    Args:
        origin: what they are made by; those of another origin are made anew.
        by_clip: for each clip in turn, its rows of each array.
    """
    index = data.folder / f"{name}.json"
    if not index.is_file() or json.loads(index.read_text()) != origin:
        bar = tqdm(by_clip, desc=name, unit="clip", total=len(data.clips))
        _write(data.folder, columns, (rows for rows in bar))
        write_atomically(index, json.dumps(origin))
    return [*_mapped(data.folder, columns, len(data.poses)).values()]


def _write(folder: Path, columns: Columns, by_clip: Iterable[Sequence[np.ndarray]]) -> None:
    """Write arrays clip by clip, so that memory holds one."""
    with ExitStack() as stack:
        paths = [stack.enter_context(written_atomically(folder / f"{n}.raw")) for n in columns]
        files = [stack.enter_context(path.open("wb")) for path in paths]
        for rows in by_clip:
            for file, array, (_, kind) in zip(files, rows, columns.values(), strict=True):
                file.write(array.astype(kind).tobytes())


def _mapped(folder: Path, columns: Columns, num_frames: int) -> dict[str, np.ndarray]:
    return {
        name: np.memmap(folder / f"{name}.raw", kind, "r", shape=(num_frames, width))
        for name, (width, kind) in columns.items()
    }


def _by_clip(
    folder: Path,
    encoder: SpeechEncoder,
    split: dict[str, str],
    augmented_copies: int,
    read: list[PreparedClip],
) -> Iterator[Sequence[np.ndarray]]:
    """The rows of each clip and of its copies; what they are is added to ``read``."""
    skipped = 0
    for name, kind in tqdm(sorted(split.items()), desc="reading clips", unit="clip"):
        try:
            number, _ = speaker_of(name)
            recording = read_files(folder, name)
            _check_lengths(*recording)
            encoded = encode_clip(*recording, encoder)
        except (MotionError, SpeechError, DataError) as error:
            log.warning("Skipped %s: %s", name, error)
            skipped += 1
            continue
        for copy in range(1 + (augmented_copies if kind == "train" else 0)):
            if copy > 0:
                encoded = encode_clip(*augmented_copy(*recording, name, copy), encoder)
            motion, features = encoded
            start = read[-1].stop if read else 0
            read.append(PreparedClip(name, number, kind, start, motion.num_frames, copy))
            yield motion.poses, motion.trans, face_units(motion), features
    if not read:
        raise DataError(f"{folder} holds no usable clip ({skipped} skipped).")
    if skipped:
        log.warning("%d of %d clips were skipped.", skipped, len(split))


def _check_lengths(motion: Motion, speech: Speech) -> None:
    num_frames = min(motion.num_frames, speech.num_frames)
    if num_frames < MIN_FRAMES:
        raise DataError(f"{num_frames} frames, {MIN_FRAMES} needed.")
    if abs(motion.duration_s - speech.duration_s) > MAX_MISMATCH_S:
        raise DataError(
            f"its motion lasts {motion.duration_s:.1f} s and its sound {speech.duration_s:.1f} s;"
            f" more than {MAX_MISMATCH_S:g} s apart, they hardly belong together."
        )
