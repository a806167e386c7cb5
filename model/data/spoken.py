"""What the annotation of prepared data says of its speech, as numbers of each frame."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Int, UInt8
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from torch import Tensor
from tqdm import tqdm

from conventions.rates import FPS
from model.data.plans import Plans, textgrid_of
from model.data.prepared import Batch, Clip, PreparedData
from model.data.recordings import DataError, copy_speed
from model.plan.plan import SIDES
from model.plan.tracks import hand_tracks
from model.speech.codes import PHONES, TOLD
from model.speech.transcript import Transcript, TranscriptError, read_transcript

ACCENT_FRAMES, PHRASE_END_FRAMES = 3, 5
"""Around each, that count as it."""
PAUSE_S = 0.12
"""Between words, from which a phrase ends before it."""
SPEED_FRAMES = 4.0
"""Deviation of the Gaussian over planned speeds."""
_NUMBER = {phone: number for number, phone in enumerate(PHONES, start=1)}


@dataclass(frozen=True)
class Spoken:
    """Annotation of all clips, end to end as `PreparedData` has them."""

    phone: UInt8[np.ndarray, " N"]
    """Place in `PHONES`, from 1; 0 is none of them."""
    told: Float32[np.ndarray, "N told"]
    """`TOLD`; what is a share or a yes is from 0 to 1."""

    def of(self, batch: Batch) -> tuple[Int[Tensor, "B T"], Float32[Tensor, "B T told"]]:
        """Phones and `TOLD` of a batch's windows."""
        phone = torch.from_numpy(self.phone[batch.frames].astype(np.int64))
        return phone, torch.from_numpy(self.told[batch.frames])


def annotated_speech(data: PreparedData, plans: Plans) -> Spoken:
    """Read the annotation beside the recordings.

    Raises:
        DataError: if a clip's words are not annotated, or no clip has phones and accents.
    """
    phone = np.zeros(len(data.poses), np.uint8)
    told = np.zeros((len(data.poses), len(TOLD)), np.float32)
    for clip in tqdm(data.clips, desc="annotation", unit="clip"):
        transcript = _read(data, clip)
        rows = slice(clip.start, clip.stop)
        speed = copy_speed(clip.name, clip.copy)
        phone[rows] = phones_of(transcript, clip.num_frames, speed)
        told[rows, :-1] = told_of(transcript, clip.num_frames, speed, plans)
        told[rows, -1] = wrist_speed(plans.tracks[rows])
    if not phone.any() or not told[:, 0].any():
        missing = "phones" if not phone.any() else "accents"
        raise DataError(f"No TextGrid of {data.source.name} has a tier of {missing}.")
    return Spoken(phone, told)


def phones_of(transcript: Transcript, num_frames: int, speed: float) -> UInt8[np.ndarray, " T"]:
    """The phone of each frame; of unknown ones and of pauses 0."""
    numbers = np.zeros(num_frames, np.uint8)
    for phone in transcript.phones:
        name = phone.text.lower().rstrip("012")
        numbers[_rows(phone.start_s, phone.end_s, speed)] = _NUMBER.get(name, 0)
    return numbers


def told_of(
    transcript: Transcript, num_frames: int, speed: float, plans: Plans
) -> Float32[np.ndarray, "T 5"]:
    """`TOLD` but for the speed."""
    strength, ends, voice, struck = np.zeros((4, num_frames), np.float32)
    for accent in transcript.accents:
        frame = int(accent.time_s / speed * FPS)
        if frame < num_frames:
            strength[frame] = accent.strength
    after = [word.start_s for word in transcript.words[1:]] + [np.inf]
    for word, next_s in zip(transcript.words, after, strict=True):
        rows = _rows(word.start_s, word.end_s, speed)
        voice[rows] = 1
        struck[rows] = plans.table.struck.get(word.text.lower(), 0.0)
        if next_s - word.end_s > PAUSE_S:
            ends[max(0, rows.stop - 1) : rows.stop] = 1
    strength = maximum_filter1d(strength, ACCENT_FRAMES)
    ends = maximum_filter1d(ends, PHRASE_END_FRAMES)
    return np.stack([strength > 0, strength, ends, voice, struck], axis=1).astype(np.float32)


def wrist_speed(tracks: Float32[np.ndarray, "T tracks"]) -> Float32[np.ndarray, " T"]:
    """Of both planned wrists together, in the tiers' units a second, smoothed."""
    goals = [np.asarray(tracks[:, hand_tracks(side)][:, :3], np.float64) for side in SIDES]
    steps = [np.diff(goal, axis=0, prepend=goal[:1]) for goal in goals]
    total = sum(np.linalg.norm(step, axis=1) for step in steps) * FPS
    return gaussian_filter1d(total, SPEED_FRAMES).astype(np.float32)


def _rows(start_s: float, end_s: float, speed: float) -> slice:
    """Frames whose middle lies in it, in a recording that plays so fast."""
    first, stop = (max(0, round(at / speed * FPS)) for at in (start_s, end_s))
    return slice(first, stop)


def _read(data: PreparedData, clip: Clip) -> Transcript:
    try:
        return read_transcript(textgrid_of(data, clip))
    except TranscriptError as error:
        raise DataError(f"{clip.name} has no annotated words: {error}") from error
