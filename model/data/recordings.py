"""Reading, encoding and augmentation of single recordings in a data folder of BEAT2's layout."""

import csv
import hashlib
import zlib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from model.motion.motion import Motion, first_frames, load_motion
from model.motion.transforms import change_motion_speed
from model.speech.audio import Speech, SpeechReadOptions, load_speech
from model.speech.augment import (
    apply_recording_conditions,
    perturb_speed,
    sample_recording_conditions,
)
from model.speech.encoder import SpeechEncoder

SPEED_PERCENT = (90, 111)
"""Lowest speed of an augmented copy (percent), and one above the highest."""
FINGERPRINT_BYTES = 4096
SPEECH_LIMITS = SpeechReadOptions(max_s=3600, max_bytes=2**31)


class DataError(ValueError):
    """A data folder that cannot be used; the message says what is missing and what to do."""


def read_split(folder: Path) -> dict[str, str]:
    """Read each clip's split from BEAT2's csv; raises DataError if it is missing or differs."""
    path = folder / "train_test_split.csv"
    if not path.is_file():
        raise DataError(f"{path} is missing; the folder is not laid out as BEAT2.")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows or not {"id", "type"} <= set(rows[0]):
        raise DataError(f"{path} must have the columns id and type.")
    return {row["id"]: row["type"] for row in rows}


def fingerprint(folder: Path, names: Iterable[str]) -> str:
    """Compute a digest that identifies a folder's recordings, independent of its path.

    It reads little: of every file its size, and pieces of its start, middle and end, where an npz
    stores the checksums of its arrays. Missing files are skipped.
    """
    digest = hashlib.sha256()
    for name in sorted(names):
        for path in (folder / "smplxflame_30" / f"{name}.npz", folder / "wave16k" / f"{name}.wav"):
            digest.update(path.name.encode())
            if not path.is_file():
                continue
            size = path.stat().st_size
            digest.update(size.to_bytes(8, "big"))
            with path.open("rb") as file:
                for place in (0, size // 2, max(0, size - FINGERPRINT_BYTES)):
                    file.seek(place)
                    digest.update(file.read(FINGERPRINT_BYTES))
    return digest.hexdigest()


def parse_speaker(clip_name: str) -> tuple[int, str]:
    """Parse number and name of the speaker from a name like 2_scott_0_1_1; raises DataError."""
    number, _, rest = clip_name.partition("_")
    if not number.isdigit() or not rest:
        raise DataError(f"{clip_name} does not start with a speaker number and name.")
    return int(number), rest.split("_")[0]


def read_motion_and_speech(folder: Path, name: str) -> tuple[Motion, Speech]:
    """Read the motion and the sound of one recording, each with its original length."""
    motion = load_motion(folder / "smplxflame_30" / f"{name}.npz")
    return motion, load_speech(folder / "wave16k" / f"{name}.wav", SPEECH_LIMITS)


def cut_and_encode_speech(
    motion: Motion, speech: Speech, encoder: SpeechEncoder
) -> tuple[Motion, Float[np.ndarray, "T dim"]]:
    """Return the motion and its speech features, both cut to the shorter of the two."""
    num_frames = min(motion.num_frames, speech.num_motion_frames)
    cut = first_frames(motion, num_frames)
    return cut, encoder.encode(speech.waveform, num_frames)


def augmentation_speed(name: str, copy: int) -> float:
    """Return the playback speed of an augmented copy; 1 for copy 0, the recording itself."""
    return 1.0 if copy == 0 else _draws(name, copy)[1]


def augmented_copy(motion: Motion, speech: Speech, name: str, copy: int) -> tuple[Motion, Speech]:
    """Return a recording at another speed, its speech as if recorded by another microphone."""
    rng, speed = _draws(name, copy)
    waveform = apply_recording_conditions(
        perturb_speed(speech.waveform, speed), sample_recording_conditions(rng), rng
    )
    return change_motion_speed(motion, speed), replace(speech, waveform=waveform)


def _draws(name: str, copy: int) -> tuple[np.random.Generator, float]:
    """Return the random generator of a copy, and the copy's speed, which is drawn first."""
    rng = np.random.default_rng([zlib.crc32(name.encode()), copy])
    return rng, int(rng.integers(*SPEED_PERCENT)) / 100
