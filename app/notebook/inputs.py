"""What a notebook hands over: sound and motion as files or as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from app.errors import RunError
from model.formats.read import read_any_motion
from model.formats.reading import read_told
from model.motion.motion import Motion, save_motion
from model.plan.plan import GesturePlan
from model.speech.audio import Speech, load_speech, write_wav

SpeechLike = str | Path | Speech | tuple[np.ndarray, int]
"""A sound file; speech that was read; or samples, (N,) or (N, channels), and their rate in Hz."""
MotionLike = str | Path | Motion
PlanLike = str | Path | GesturePlan


def read_speech(speech: SpeechLike) -> Speech:
    """Sound as the systems hear it: 16 kHz, mono.

    Raises:
        SpeechError: with one sentence, if it cannot be used.
    """
    if isinstance(speech, Speech):
        return speech
    with TemporaryDirectory() as folder:
        return load_speech(speech_in(Path(folder), speech))


def read_motion(motion: MotionLike, assume: str = "") -> Motion:
    """Anyone's motion: BEAT2, AMASS and SMPL-X files (.npz), rotations (.npy), .bvh.

    Args:
        assume: how it is to be read, such as "up=z,rate=25".

    Returns:
        ``poses`` (T, 165), local axis-angle of the 55 SMPL-X joints in radians; ``trans`` (T, 3) in
        metres, y up; ``expressions`` (T, 100); at 30 frames per second.

    Raises:
        MotionError: with one sentence, if it cannot be read.
    """
    if isinstance(motion, Motion):
        return motion
    return read_any_motion(motion, read_told(assume)).motion


def named_motions(motions: MotionLike | Mapping[str, MotionLike]) -> dict[str, Motion]:
    """By name; a file alone is called as it is, a motion alone "motion".

    Raises:
        RunError: of none.
        MotionError: as `read_motion`.
    """
    if isinstance(motions, str | Path):
        motions = {Path(motions).stem: motions}
    elif isinstance(motions, Motion):
        motions = {"motion": motions}
    if not motions:
        raise RunError("There is no motion; give at least one.")
    return {name: read_motion(motion) for name, motion in motions.items()}


def speech_in(folder: Path, speech: SpeechLike) -> Path:
    """The sound as a file, which is made in the folder where it is none."""
    path = folder / "speech.wav"
    if isinstance(speech, str | Path):
        return Path(speech)
    if isinstance(speech, Speech):
        write_wav(path, speech.waveform)
        return path
    from scipy.io import wavfile

    samples, rate = np.asarray(speech[0]), speech[1]
    if samples.ndim not in (1, 2) or not np.issubdtype(samples.dtype, np.number):
        raise RunError(
            "Speech as an array is numbers of the shape (N,) or (N, channels); it is "
            f"{samples.dtype} of the shape {samples.shape}."
        )
    if samples.dtype not in (np.int16, np.int32, np.uint8):
        samples = samples.astype(np.float32)
    wavfile.write(path, int(rate), samples)
    return path


def motion_in(folder: Path, motion: MotionLike) -> Path:
    """The motion as a file of BEAT2's form in the folder."""
    path = folder / "motion.npz"
    save_motion(read_motion(motion), path)
    return path


def plan_in(folder: Path, plan: PlanLike) -> Path:
    """The plan as a file, which is made in the folder where it is none."""
    path = folder / "plan.json"
    if not isinstance(plan, GesturePlan):
        return Path(plan)
    plan.write(path)
    return path
