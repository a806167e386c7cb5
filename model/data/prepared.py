"""Training data from a folder in BEAT2's layout, read once into memory-mapped arrays.

Poses, root positions, face units and speech features of all clips are concatenated; a window is a
slice. Features are computed once per file, with context, and never per window. Training recordings
may be stored several times, at other speeds and as if recorded by other microphones.
"""

import json
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor
from tqdm import tqdm

from model.data import recordings
from model.data.recordings import DataError
from model.motion.motion import NUM_FACE_UNITS, Motion, arkit_weights_or_zeros
from model.speech.audio import Speech, SpeechError
from model.speech.encoder import SpeechEncoder
from model.storage.files import write_atomically, written_atomically
from model.storage.npz import MotionError

log = logging.getLogger(__name__)

MAX_MISMATCH_S = 5.0
"""Largest difference between the durations of motion and sound (s); some of BEAT2's differ by
seconds at the end."""
CACHE_FORMAT = 2
"""Version of the cached arrays, raised whenever the same folder gives other arrays."""
MIN_FRAMES = 60
Columns = Mapping[str, tuple[int, type]]
"""Number of values per frame and dtype of each array, by the array's name."""
_COLUMNS: Columns = {
    "poses": (165, np.float32),
    "transl": (3, np.float32),
    "expression": (NUM_FACE_UNITS, np.float32),
}


@dataclass(frozen=True)
class PreparedClip:
    """Position of one recording, or of an augmented copy, in the arrays."""

    name: str
    speaker: int
    split: str
    start: int
    num_frames: int
    copy: int = 0
    """Number of the augmented copy, from 1; 0 for the recording itself."""

    @property
    def stop(self) -> int:
        return self.start + self.num_frames


@dataclass(frozen=True)
class Batch:
    """Windows cut from clips; the first axis of every tensor is the batch."""

    poses: Float[Tensor, "B T 165"]
    transl: Float[Tensor, "B T 3"]
    arkit_weights: Float[Tensor, "B T 52"]
    speech: Float[Tensor, "B T_ctx dim"]
    speaker: Int[Tensor, " B"]
    clip_names: list[str]
    frame_rows: Int[np.ndarray, "B T"]
    """Row of each frame (B, T) in the arrays."""

    def part(self, which: slice) -> "Batch":
        """Return a part of the windows."""
        return Batch(**{f.name: getattr(self, f.name)[which] for f in fields(self)})


@dataclass(frozen=True)
class PreparedData:
    """All clips of a data folder as arrays of frames."""

    data_folder: Path
    """Folder of the recordings, in BEAT2's layout."""
    cache_folder: Path
    """Folder of the arrays, which may also hold arrays derived from them."""
    clips: tuple[PreparedClip, ...]
    poses: np.ndarray
    transl: np.ndarray
    arkit_weights: np.ndarray
    speech: np.ndarray
    speaker_names: dict[int, str]
    """Name of each speaker by number."""

    def mean_floor_position(self, clip: PreparedClip) -> Float[np.ndarray, "3"]:
        """Return the body's mean position on the floor (y = 0) in a clip, in metres."""
        x, _, z = self.transl[clip.start : clip.stop].mean(0)
        return np.array([x, 0.0, z], np.float32)

    def clips_of_split(self, split: str) -> tuple[PreparedClip, ...]:
        """Return the clips of train, val, test or additional; raises DataError if none."""
        clips = tuple(clip for clip in self.clips if clip.split == split)
        if not clips:
            splits = ", ".join(sorted({clip.split for clip in self.clips})) or "no clips"
            raise DataError(f"train_test_split.csv lists no usable {split} clip (found: {splits}).")
        return clips

    def draw_windows(
        self,
        clips: tuple[PreparedClip, ...],
        window: int,
        size: int,
        rng: np.random.Generator,
        context: int = 0,
    ) -> Batch:
        """Draw ``size`` windows of ``window`` frames, every possible start equally likely.

        Each has ``context`` frames of speech before and after; at a clip's ends, its ends repeat.
        """
        usable = [clip for clip in clips if clip.num_frames >= window]
        if not usable:
            raise DataError(
                f"None of the {len(clips)} clips is as long as a window ({window} frames)."
            )
        starts = np.array([clip.num_frames - window + 1 for clip in usable], float)
        chosen = rng.choice(len(usable), size, p=starts / starts.sum())
        first = [usable[c].start + int(rng.integers(starts[c])) for c in chosen]
        frames = np.array(first)[:, None] + np.arange(window)
        return self.batch(frames, [usable[c] for c in chosen], context)

    def batch(
        self, frames: Int[np.ndarray, "B T"], clips: list[PreparedClip], context: int = 0
    ) -> Batch:
        """Return the rows at ``frames`` (absolute indices) as tensors."""
        speech_rows = frames[:, :1] + np.arange(-context, frames.shape[1] + context)
        first = np.array([clip.start for clip in clips])[:, None]
        last = np.array([clip.stop for clip in clips])[:, None] - 1

        def take(
            array: Shaped[np.ndarray, "N ..."], rows: Int[np.ndarray, "B W"] = frames
        ) -> Tensor:
            return torch.from_numpy(array[rows].astype(np.float32))

        return Batch(
            poses=take(self.poses),
            transl=take(self.transl),
            arkit_weights=take(self.arkit_weights),
            speech=take(self.speech, speech_rows.clip(first, last)),
            speaker=torch.tensor([clip.speaker for clip in clips]),
            clip_names=[clip.name for clip in clips],
            frame_rows=frames,
        )


def prepare(
    folder: Path, cache_prefix: Path, encoder: SpeechEncoder, *, augmented_copies: int = 0
) -> PreparedData:
    """Read ``folder`` once into a cache (reused by the next run), then map it.

    Clips that cannot be read or are shorter than a window are logged, counted and left out.

    Args:
        cache_prefix: prefix of the cache folder's path; a digest of the sources is appended, so
            that other recordings never use the same cache.
        augmented_copies: number of copies of each training recording, see `augmented_copy`; the
            other splits have none.

    Raises:
        DataError: if nothing usable is left, or the cache was made in another way.
    """
    split = recordings.read_split(folder)
    content = recordings.fingerprint(folder, split)
    copies = f"-{augmented_copies}-copies" if augmented_copies > 0 else ""
    cache = cache_prefix.with_name(f"{cache_prefix.name}{copies}-{content[:12]}")
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
        named = dict(sorted(recordings.parse_speaker(clip.name) for clip in read))
        manifest = {"origin": origin, "clips": [*map(vars, read)], "speakers": named}
        write_atomically(index_path, json.dumps(manifest))
    index = json.loads(index_path.read_text())
    if index["origin"] != json.loads(json.dumps(origin)):
        raise DataError(
            f"{cache} was made by another version of this program or with another encoder; remove "
            "it."
        )
    clips = tuple(PreparedClip(**clip) for clip in index["clips"])
    speakers = {int(number): name for number, name in index["speakers"].items()}
    arrays = _mapped(cache, columns, clips[-1].stop)
    arkit_weights = arrays.pop("expression")
    return PreparedData(
        folder, cache, clips=clips, arkit_weights=arkit_weights, speaker_names=speakers, **arrays
    )


def derived_arrays(
    data: PreparedData,
    name: str,
    origin: dict,
    columns: Columns,
    by_clip: Iterable[Sequence[Shaped[np.ndarray, "T ..."]]],
) -> list[np.ndarray]:
    """Map arrays derived from all frames of ``data``, after making them clip by clip if needed.

    Arrays of another ``origin`` are made again; ``by_clip`` yields each clip's rows of each array.
    """
    index = data.cache_folder / f"{name}.json"
    if not index.is_file() or json.loads(index.read_text()) != origin:
        bar = tqdm(by_clip, desc=name, unit="clip", total=len(data.clips))
        _write(data.cache_folder, columns, (rows for rows in bar))
        write_atomically(index, json.dumps(origin))
    return [*_mapped(data.cache_folder, columns, len(data.poses)).values()]


def _write(
    folder: Path, columns: Columns, by_clip: Iterable[Sequence[Shaped[np.ndarray, "T ..."]]]
) -> None:
    """Write arrays clip by clip, so that memory holds one clip."""
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
    """Yield the rows of each clip and of its copies, and append their positions to ``read``."""
    skipped = 0
    for name, kind in tqdm(sorted(split.items()), desc="reading clips", unit="clip"):
        try:
            number, _ = recordings.parse_speaker(name)
            recording = recordings.read_motion_and_speech(folder, name)
            _check_lengths(*recording)
            encoded = recordings.cut_and_encode_speech(*recording, encoder)
        except (MotionError, SpeechError, DataError) as error:
            log.warning("Skipped %s: %s", name, error)
            skipped += 1
            continue
        for copy in range(1 + (augmented_copies if kind == "train" else 0)):
            if copy > 0:
                encoded = recordings.cut_and_encode_speech(
                    *recordings.augmented_copy(*recording, name, copy), encoder
                )
            motion, features = encoded
            start = read[-1].stop if read else 0
            read.append(PreparedClip(name, number, kind, start, motion.num_frames, copy))
            yield motion.poses, motion.trans, arkit_weights_or_zeros(motion), features
    if not read:
        raise DataError(f"{folder} holds no usable clip ({skipped} skipped).")
    if skipped:
        log.warning("%d of %d clips were skipped.", skipped, len(split))


def _check_lengths(motion: Motion, speech: Speech) -> None:
    num_frames = min(motion.num_frames, speech.num_motion_frames)
    if num_frames < MIN_FRAMES:
        raise DataError(f"it has {num_frames} frames; at least {MIN_FRAMES} are needed.")
    if abs(motion.duration_s - speech.duration_s) > MAX_MISMATCH_S:
        raise DataError(
            f"its motion lasts {motion.duration_s:.1f} s and its sound {speech.duration_s:.1f} s;"
            f" they differ by more than {MAX_MISMATCH_S:g} s, so they may not belong together."
        )
