"""Annotations of the prepared data, gesture plans and speech, as numbers per frame."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32, Int, Shaped, UInt8
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from torch import Tensor
from tqdm import tqdm

from conventions.rates import FPS
from model.data.prepared import Batch, PreparedClip, PreparedData, derived_arrays
from model.data.recordings import DataError, augmentation_speed
from model.plan.files import read_corpus_textgrid
from model.plan.kinds import KindTable, kind_numbers
from model.plan.plan import SIDES, GesturePlan, PlanError
from model.plan.plan_features import (
    NUM_TRACKS,
    TIERS,
    EventOnset,
    chain_states,
    hand_tracks,
    plan_to_chains,
    plan_tracks,
    tier_sampling_inputs,
)
from model.speech.encoder import PHONES, SPEECH_LABELS
from model.speech.transcript import Transcript, TranscriptError, read_textgrid_transcript

PLANS_FORMAT = 1


@dataclass(frozen=True)
class PlanEventBatch:
    """Training targets and inputs of a planner for a batch of windows, by tier."""

    chain_states: dict[str, Float[Tensor, "B T _"]]
    """State of the tier's event chain and of the coupled tier's chain (B, T, _)."""
    event: dict[str, Int[Tensor, "B T"]]
    mark: dict[str, Float[Tensor, "B T _"]]

    def to(self, device: torch.device) -> "PlanEventBatch":
        """Return the same events on a device."""
        parts = (self.chain_states, self.event, self.mark)
        return PlanEventBatch(
            *({name: one.to(device) for name, one in part.items()} for part in parts)
        )


@dataclass(frozen=True)
class PlanAnnotations:
    """Plans of all clips, concatenated in the order of `PreparedData`."""

    data: PreparedData
    tracks: np.ndarray
    """Plan tracks (N, tracks), see `model.plan.plan_features`."""
    chains: tuple[dict[str, list[EventOnset]], ...]
    """Event chains of each clip, by tier."""
    kinds: np.ndarray
    """Gesture type numbers (N, 2) of the left and the right hand (`KindTable.number_or_zero`)."""
    kind_table: KindTable

    def tracks_and_kinds(
        self, batch: Batch, context: int
    ) -> tuple[Float[Tensor, "B T_context tracks"], Int[Tensor, "B T_context 2"]]:
        """Return a batch's plans with ``context`` frames on either side, held at a clip's ends."""
        frames = batch.frame_rows
        rows = frames[:, :1] + np.arange(-context, frames.shape[1] + context)
        which = np.searchsorted(self._starts, frames[:, 0], side="right") - 1
        first, stop = self._starts[which], self._stops[which]
        rows = rows.clip(first[:, None], stop[:, None] - 1)
        return (
            torch.from_numpy(self.tracks[rows].astype(np.float32)),
            torch.from_numpy(self.kinds[rows].astype(np.int64)),
        )

    def events(self, batch: Batch) -> PlanEventBatch:
        """Return the events that begin in a batch's windows."""
        which = np.searchsorted(self._starts, batch.frame_rows[:, 0], side="right") - 1
        windows = [
            {
                tier.name: chain_states(
                    tier, self.chains[clip][tier.name], rows - self._starts[clip]
                )
                for tier in TIERS
            }
            for clip, rows in zip(which, batch.frame_rows, strict=True)
        ]

        def stacked(
            parts: Sequence[Mapping[str, Shaped[np.ndarray, "T ..."]]],
        ) -> dict[str, Tensor]:
            return {
                tier.name: torch.from_numpy(np.stack([part[tier.name] for part in parts]))
                for tier in TIERS
            }

        return PlanEventBatch(
            stacked([tier_sampling_inputs(window) for window in windows]),
            stacked([{name: one.event for name, one in window.items()} for window in windows]),
            stacked([{name: one.mark for name, one in window.items()} for window in windows]),
        )

    @cached_property
    def _starts(self) -> np.ndarray:
        return np.array([clip.start for clip in self.data.clips])

    @cached_property
    def _stops(self) -> np.ndarray:
        return np.array([clip.stop for clip in self.data.clips])


def load_plan_annotations(data: PreparedData, num_speakers: int) -> PlanAnnotations:
    """Read the annotation of the recordings once, then map the arrays."""
    plans = [_annotated_plan(data, clip) for clip in data.clips]
    learned = [
        (plan, clip)
        for clip, plan in zip(data.clips, plans, strict=True)
        if clip.copy == 0 and clip.split == "train"
    ]
    word_counts = Counter(
        word for _, clip in learned for word in _annotation_words(textgrid_path(data, clip))
    )
    table = KindTable.fit(
        ((plan, clip.speaker) for plan, clip in learned), num_speakers, word_counts
    )
    tracks, kinds = derived_arrays(
        data,
        "plans",
        {"format": PLANS_FORMAT, "tracks": NUM_TRACKS},
        {"plan-tracks": (NUM_TRACKS, np.float32), "plan-kinds": (2, np.uint8)},
        (
            (plan_tracks(plan, clip.num_frames), kind_numbers(plan, clip.num_frames, table))
            for clip, plan in zip(data.clips, plans, strict=True)
        ),
    )
    return PlanAnnotations(data, tracks, tuple(map(plan_to_chains, plans)), kinds, table)


def textgrid_path(data: PreparedData, clip: PreparedClip) -> Path:
    """Return the path of a clip's annotation."""
    return data.data_folder / "textgrid" / f"{clip.name}.TextGrid"


def _annotation_words(path: Path) -> list[str]:
    """Return the lower-case words of an annotation; none if it holds plans only."""
    try:
        return [word.text.lower() for word in read_textgrid_transcript(path).words]
    except TranscriptError:
        return []


def _annotated_plan(data: PreparedData, clip: PreparedClip) -> GesturePlan:
    try:
        plan = read_corpus_textgrid(textgrid_path(data, clip))
    except (PlanError, OSError) as error:
        raise DataError(f"{clip.name} has no annotated plan: {error}") from error
    return plan.at_speed(augmentation_speed(clip.name, clip.copy))


ACCENT_FRAMES, PHRASE_END_FRAMES = 3, 5
"""Lengths of the windows around an accent and a phrase end that are labelled as such (frames)."""
PAUSE_S = 0.12
"""Shortest pause between words that ends a phrase (s)."""
SPEED_FRAMES = 4.0
"""Standard deviation of the Gaussian that smooths planned speeds (frames)."""
_NUMBER = {phone: number for number, phone in enumerate(PHONES, start=1)}


@dataclass(frozen=True)
class SpeechLabels:
    """Speech annotation of all clips, concatenated in the order of `PreparedData`."""

    phones: UInt8[np.ndarray, " N"]
    """Number of the phone (N,) in `PHONES`, from 1; 0 is none of them."""
    labels: Float32[np.ndarray, "N labels"]
    """Values of `SPEECH_LABELS` (N, 6); fractions and flags lie between 0 and 1."""

    def phones_and_labels(
        self, batch: Batch
    ) -> tuple[Int[Tensor, "B T"], Float32[Tensor, "B T labels"]]:
        """Return the phones and the values of `SPEECH_LABELS` of a batch's windows."""
        phone = torch.from_numpy(self.phones[batch.frame_rows].astype(np.int64))
        return phone, torch.from_numpy(self.labels[batch.frame_rows])


def load_speech_labels(data: PreparedData, plans: PlanAnnotations) -> SpeechLabels:
    """Read words, phones and accents of the recordings; raises DataError if any kind is missing."""
    phone = np.zeros(len(data.poses), np.uint8)
    labels = np.zeros((len(data.poses), len(SPEECH_LABELS)), np.float32)
    for clip in tqdm(data.clips, desc="annotation", unit="clip"):
        transcript = _read(data, clip)
        rows = slice(clip.start, clip.stop)
        speed = augmentation_speed(clip.name, clip.copy)
        phone[rows] = frame_phones(transcript, clip.num_frames, speed)
        labels[rows, :-1] = annotated_labels(transcript, clip.num_frames, speed, plans)
        labels[rows, -1] = summed_wrist_speed(plans.tracks[rows])
    if not phone.any() or not labels[:, 0].any():
        missing = "phones" if not phone.any() else "accents"
        raise DataError(f"No TextGrid of {data.data_folder.name} has a tier of {missing}.")
    return SpeechLabels(phone, labels)


def frame_phones(
    transcript: Transcript, num_frames: int, playback_speed: float
) -> UInt8[np.ndarray, " T"]:
    """Return the number of each frame's phone; 0 for unknown phones and pauses."""
    numbers = np.zeros(num_frames, np.uint8)
    for phone in transcript.phones:
        name = phone.text.lower().rstrip("012")
        numbers[_rows(phone.start_s, phone.end_s, playback_speed)] = _NUMBER.get(name, 0)
    return numbers


def annotated_labels(
    transcript: Transcript, num_frames: int, playback_speed: float, plans: PlanAnnotations
) -> Float32[np.ndarray, "T 5"]:
    """Return the values of `SPEECH_LABELS` of each frame, except the wrist speed."""
    strength, ends, voice, struck = np.zeros((4, num_frames), np.float32)
    for accent in transcript.accents:
        frame = int(accent.time_s / playback_speed * FPS)
        if frame < num_frames:
            strength[frame] = accent.strength
    after = [word.start_s for word in transcript.words[1:]] + [np.inf]
    for word, next_s in zip(transcript.words, after, strict=True):
        rows = _rows(word.start_s, word.end_s, playback_speed)
        voice[rows] = 1
        struck[rows] = plans.kind_table.stroke_shares_by_word.get(word.text.lower(), 0.0)
        if next_s - word.end_s > PAUSE_S:
            ends[max(0, rows.stop - 1) : rows.stop] = 1
    strength = maximum_filter1d(strength, ACCENT_FRAMES)
    ends = maximum_filter1d(ends, PHRASE_END_FRAMES)
    return np.stack([strength > 0, strength, ends, voice, struck], axis=1).astype(np.float32)


def summed_wrist_speed(tracks: Float32[np.ndarray, "T tracks"]) -> Float32[np.ndarray, " T"]:
    """Return the smoothed sum of both planned wrists' speeds, in the tiers' units per second."""
    goals = [np.asarray(tracks[:, hand_tracks(side)][:, :3], np.float64) for side in SIDES]
    steps = [np.diff(goal, axis=0, prepend=goal[:1]) for goal in goals]
    total = sum(np.linalg.norm(step, axis=1) for step in steps) * FPS
    return gaussian_filter1d(total, SPEED_FRAMES).astype(np.float32)


def _rows(start_s: float, end_s: float, playback_speed: float) -> slice:
    """Return the frames with their centre inside an interval of a recording at another speed."""
    first, stop = (max(0, round(at / playback_speed * FPS)) for at in (start_s, end_s))
    return slice(first, stop)


def _read(data: PreparedData, clip: PreparedClip) -> Transcript:
    try:
        return read_textgrid_transcript(textgrid_path(data, clip))
    except TranscriptError as error:
        raise DataError(f"{clip.name} has no annotated words: {error}") from error
