"""Classifiers and metrics of matched speech, speaker style and rest in silence.

Matched speech is GENEA's question to its raters (Kucherenko et al. 2023), answered by a network
trained on recorded motion alone (`model.systems.helpers.matching`): it compares 10 s of motion with
two speeches of 10 s. Chance is .5. Pieces are cut from the start of the speech to its end, so that
silence before and after it is not a cue.

The speaker classifier is Fisher's linear discriminant, fitted to recorded motion of the training
split alone: it assigns each piece of 10 s to one of the speakers. Chance is one over their number.
Its input is mean and spread of the rotations from pelvis to wrists and of the wrist positions, and
the speed of both; no speech.

The effect of the speaker is measured on one speech, generated for several speakers with several
noise seeds, as `model.metrics.speech_effect` does for speech: the correlation of motions that
share the speaker but not the noise, less that of motions that share neither. A calm and a lively
speaker are compared by the speed of the wrists. Both need extra motions and use a few clips only:
the first seconds of a clip's speech and then silence.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS, SAMPLE_RATE
from model.data.recordings import DataError, parse_speaker, read_motion_and_speech, read_split
from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.metrics import speech_effect
from model.metrics.face import wrist_speed_sum
from model.metrics.speech_effect import LEAST_FRAMES, MEASURED_SILENCE_S, Grid
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import track_points
from model.sampling.samplers import Sampling, noise_seed_of_clip
from model.speech.audio import Speech, SpeechError
from model.speech.features import NUM_MELS
from model.storage.npz import MotionError
from model.systems.helpers.config import MATCHING_NETWORK
from model.systems.helpers.matching import SpeechMotionMatcher, agreement

NO_MATCHING_CLASSIFIER = (
    f"Matched-speech accuracy is omitted: the classifier {MATCHING_NETWORK} is not installed."
)
PIECE_FRAMES = 300
BODY_PARTS_OF_METRIC: Mapping[str, tuple[str, ...]] = {
    "matched": ("arms", "trunk"),
    "matched_arms": ("arms",),
    "matched_face": ("face",),
}
"""Metrics, and the body parts in their agreements: lips, which would dominate, have their own."""
TIE_MARGIN = 1e-3
"""Difference of two agreements below which they are a tie."""
_VOICING = NUM_MELS + 3
"""Column of `MelEncoder` for voicing."""

_MelFeatures = Float[np.ndarray, "_ 68"]


def voiced_frames(features: _MelFeatures) -> Bool[np.ndarray, " _"]:
    """Check whether each frame has a voice."""
    return features[:, _VOICING] > 0.5


def speech_span(features: _MelFeatures) -> slice:
    """Return the range from the first to the last voiced frame; empty without any."""
    voiced = np.flatnonzero(voiced_frames(features))
    return slice(int(voiced[0]), int(voiced[-1]) + 1) if len(voiced) else slice(0, 0)


def piece_tensors(rows: Float[np.ndarray, "T C"]) -> Float[Tensor, "N 300 C"]:
    """Cut `rows` as `split_into_pieces` does, into float32 tensors for the classifier."""
    return torch.from_numpy(split_into_pieces(rows).astype(np.float32))


def split_into_pieces(rows: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "N 300 C"]:
    """Cut consecutive pieces of 10 s; the rest is left out."""
    count = len(rows) // PIECE_FRAMES
    return rows[: count * PIECE_FRAMES].reshape(count, PIECE_FRAMES, rows.shape[1])


def matched_speech_metrics(
    matcher: SpeechMotionMatcher, motion: Motion, own: _MelFeatures, foreign: _MelFeatures
) -> dict[str, float]:
    """Compute how often the classifier prefers the motion's own speech (`BODY_PARTS_OF_METRIC`).

    Every piece of the motion is compared with its speech and every piece of the foreign one; a tie
    counts half. ``arm_speed_heard`` is the mean correlation of the arms' log speed with its
    prediction from speech alone. Empty for less than 10 s.
    """
    shared = min(motion.num_frames, len(own))
    spoke = speech_span(own[:shared])
    poses, right, wrong = (
        piece_tensors(rows)
        for rows in (motion.poses[spoke], own[spoke], foreign[speech_span(foreign)])
    )
    if len(right) == 0 or len(wrong) == 0:
        return {}
    scores = {}
    for measure, parts in BODY_PARTS_OF_METRIC.items():
        agreed = matcher.agreements(poses, torch.cat([right, wrong]), parts)
        scores[measure] = win_rate(agreed[:, : len(right)].diagonal(), agreed[:, len(right) :])
    moved, predicted = matcher.measured_and_predicted_log_arm_speed(poses, right)
    scores["arm_speed_heard"] = float(agreement(moved, predicted).diagonal().mean())
    return scores


def win_rate(own: Float[Tensor, " N"], others: Float[Tensor, "N M"]) -> float:
    """Compute the share of ``others`` below a piece's own speech; a tie counts half."""
    lead = own[:, None] - others
    wins = (lead > TIE_MARGIN).double() + 0.5 * (lead.abs() <= TIE_MARGIN)
    return float(wins.mean())


def frame_loudness_db(
    waveform: Float[np.ndarray, " N"], num_frames: int
) -> Float[np.ndarray, " num_frames"]:
    """Compute the level of each motion frame in dB, at least -60 dB of full scale."""
    edges = (np.arange(num_frames + 1) * SAMPLE_RATE / FPS).astype(int)
    energy = np.concatenate([[0.0], np.cumsum(waveform.astype(np.float64) ** 2)])
    total = np.diff(energy[edges.clip(max=len(waveform))])
    return 10 * np.log10(total / np.diff(edges) + 1e-6)


RECORDINGS = 6
"""Largest number of recordings of each speaker."""
SHRINKAGE = 0.1
"""Shrinkage of the covariance within speakers towards equal variances."""
ARMS = [
    f"{side}_{part}"
    for side in ("left", "right")
    for part in ("collar", "shoulder", "elbow", "wrist")
]
JOINTS = [JOINT_INDEX[name] for name in ("spine1", "spine2", "spine3", "neck", "head", *ARMS)]
WRISTS = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]
NO_SPEAKER_CLASSIFIER = (
    "Speaker classification is omitted: fewer than two speakers of the test clips have 10 s of "
    "recordings in the training split."
)
NUM_CLIPS = 6
SPEECH_S = 10.0
"""Longest speech of each clip (s)."""
NOISE_SEEDS = 2
SPEAKERS_NOT_COMPARED = (
    "Speakers are not compared: not every system was trained on both requested speakers."
)


@dataclass(frozen=True)
class SpeakerClassifier:
    """Linear discriminant over `style_features`."""

    speakers: tuple[str, ...]
    weights: Float64[np.ndarray, "speakers numbers"]
    bias: Float64[np.ndarray, " speakers"]

    def accuracy_of_speaker(self, motion: Motion, speaker: str) -> float | None:
        """Compute the share of pieces assigned to the speaker; None if unknown or too short."""
        numbers = style_features(motion)
        if speaker not in self.speakers or not len(numbers):
            return None
        predicted = (numbers @ self.weights.T + self.bias).argmax(1)
        return float((predicted == self.speakers.index(speaker)).mean())

    def measures(self, motions: Sequence[Motion], speaker: str) -> dict[str, float]:
        """Compute ``speaker_told``, the mean accuracy over motions; empty if it is unknown."""
        shares = [self.accuracy_of_speaker(motion, speaker) for motion in motions]
        finite = [share for share in shares if share is not None]
        return {"speaker_told": float(np.mean(finite))} if finite else {}


def fit_speaker_classifier(folder: Path, speakers: Sequence[str]) -> SpeakerClassifier | None:
    """Fit the classifier to the speakers' first training recordings; None for fewer than two."""
    own: dict[str, list[str]] = {speaker: [] for speaker in sorted(set(speakers))}
    for name, kind in sorted(read_split(folder).items()):
        if kind == "train" and (speaker := parse_speaker(name)[1]) in own:
            own[speaker].append(name)
    features = {}
    for speaker, names in own.items():
        motions = (motion for name in names if (motion := _motion(folder, name)) is not None)
        pieces = [*islice(filter(len, map(style_features, motions)), RECORDINGS)]
        if pieces:
            features[speaker] = np.concatenate(pieces)
    return fit_discriminant(features) if len(features) > 1 else None


def fit_discriminant(numbers: dict[str, Float64[np.ndarray, "_ numbers"]]) -> SpeakerClassifier:
    """Fit Fisher's linear discriminant to pieces of each speaker, with equal priors."""
    means = np.stack([own.mean(0) for own in numbers.values()])
    within = np.concatenate([own - own.mean(0) for own in numbers.values()])
    scale = within.std(0) + 1e-6
    correlation = (within / scale).T @ (within / scale) / len(within)
    shrunk = (1 - SHRINKAGE) * correlation + SHRINKAGE * np.eye(len(scale))
    weights = np.linalg.solve(shrunk, (means / scale).T).T / scale
    return SpeakerClassifier(tuple(numbers), weights, -0.5 * (weights * means).sum(1))


def style_features(motion: Motion) -> Float64[np.ndarray, "pieces numbers"]:
    """Compute mean and log spread of rotations and wrists, and log speeds, for pieces of 10 s."""
    if motion.num_frames < PIECE_FRAMES:
        return np.zeros((0, 0))
    points = track_points(motion, open_body_skeleton()).joints
    wrists = points[:, WRISTS] - points[:, :1]
    poses = motion.poses.reshape(len(motion.poses), -1, 3)[:, JOINTS]
    tracks = np.concatenate([poses, wrists], axis=1)
    speed = np.linalg.norm(np.diff(tracks, axis=0, prepend=tracks[:1]), axis=-1) * FPS
    places = split_into_pieces(tracks.reshape(len(tracks), -1)).astype(float)
    speeds = split_into_pieces(speed).astype(float)
    spread = np.log(places.std(1) + 1e-3)
    return np.concatenate([places.mean(1), spread, np.log(speeds.mean(1) + 1e-3)], axis=1)


def arm_speaker_effect(motions: Grid) -> dict[str, float]:
    """Compute the effect of the speaker on the arms for one speech, by speaker and noise seed.

    ``arm_rotations_same_noise`` near 1: another speaker has the same gestures.
    """
    return {
        "by_speaker": speech_effect.speech_and_noise_shares(motions)["arms"].by_speech,
        "arm_rotations_same_noise": speech_effect.arm_rotation_correlation_same_noise(motions),
    }


def calm_and_lively_wrist_speeds(motions: Grid, speakers: tuple[str, str]) -> dict[str, float]:
    """Compute the mean wrist speed (m/s), pelvis-aligned, of a calm and of a lively speaker."""
    speeds: dict[str, list[float]] = {speaker: [] for speaker in speakers}
    for (speaker, _), motion in motions.items():
        joints = track_points(motion, open_body_skeleton()).joints
        speeds[speaker].append(float(wrist_speed_sum(joints - joints[:, :1]).mean()))
    calm, lively = (float(np.mean(speeds[speaker])) for speaker in speakers)
    return {"calm_wrist_m_s": calm, "lively_wrist_m_s": lively}


@dataclass(frozen=True)
class SpeakerComparisonClips:
    """Clips and speakers of the metrics that use a few clips only."""

    names: tuple[str, ...]
    speakers: tuple[str, str] | None
    """A calm and a lively speaker; None if a system lacks one: then each clip's own is used."""
    calm_and_lively_recordings: Mapping[str, tuple[str, str]]
    """Names of a recording of the calm speaker and one of the lively for each clip."""

    @staticmethod
    def choose(
        folder: Path, clips: Sequence[str], systems: Sequence[System], speakers: tuple[str, str]
    ) -> "SpeakerComparisonClips":
        """Choose the first clips, and recordings of the speakers from any split."""
        names = tuple(clips[:NUM_CLIPS])
        if not all(speaker in system.speakers for system in systems for speaker in speakers):
            return SpeakerComparisonClips(names, None, {})
        calm, lively = (_recordings(folder, speaker, len(names)) for speaker in speakers)
        recorded = dict(zip(names, zip(calm, lively, strict=False), strict=False))
        return SpeakerComparisonClips(names, speakers, recorded)

    def recorded_wrist_speeds(self, folder: Path, name: str) -> dict[str, float]:
        """Compute wrist speeds of the recordings that go with clip ``name``; empty without any."""
        if name not in self.calm_and_lively_recordings or self.speakers is None:
            return {}
        pairs = zip(self.speakers, self.calm_and_lively_recordings[name], strict=True)
        motions = {(speaker, 0): read_motion_and_speech(folder, clip)[0] for speaker, clip in pairs}
        return calm_and_lively_wrist_speeds(motions, self.speakers)

    def few_clip_metrics(
        self, system: System, name: str, speech: Speech, sampling: Sampling
    ) -> dict[str, float]:
        """Compute a system's metrics on clip ``name``; empty if it is not among the few."""
        if name not in self.names:
            return {}
        audio = cut_and_append_silence(speech)
        spoken = audio.num_motion_frames - round(MEASURED_SILENCE_S * FPS)
        speakers = self.speakers or (parse_speaker(name)[1],)
        moved = {
            speaker: generate_motion(
                system,
                audio,
                GenerateOptions(
                    speaker,
                    seed=noise_seed_of_clip(0, name),
                    num_samples=NOISE_SEEDS,
                    **vars(sampling),
                ),
            )
            for speaker in speakers
        }
        motions = [motion for own in moved.values() for motion in own]
        voiced = np.arange(audio.num_motion_frames) < spoken
        silences = [speech_effect.silence_speed_ratio(motion, voiced) for motion in motions]
        averages = average_metrics(silences)
        if self.speakers is None or spoken < LEAST_FRAMES:
            return averages
        speaking = {
            (speaker, seed): first_frames(motion, spoken)
            for speaker, own in moved.items()
            for seed, motion in enumerate(own)
        }
        manner = arm_speaker_effect(speaking)
        return averages | {
            "arms_by_speaker": manner["by_speaker"],
            "arm_rotations_other_speaker": manner["arm_rotations_same_noise"],
            **calm_and_lively_wrist_speeds(speaking, self.speakers),
        }


def average_metrics(samples: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Average each metric, for example over noise seeds, without those that any of them lacks."""
    names = [name for name in samples[0] if all(name in one for one in samples)]
    return {name: float(np.mean([one[name] for one in samples])) for name in names}


def cut_and_append_silence(speech: Speech) -> Speech:
    """Return the first `SPEECH_S` of a speech, then `MEASURED_SILENCE_S` of digital silence."""
    spoken = speech.waveform[: round(SPEECH_S * SAMPLE_RATE)]
    silence = np.zeros(round(MEASURED_SILENCE_S * SAMPLE_RATE), np.float32)
    return replace(speech, waveform=np.concatenate([spoken, silence]))


def _recordings(folder: Path, speaker: str, count: int) -> list[str]:
    """Return the names of a speaker's first readable recordings."""
    own = (name for name in sorted(read_split(folder)) if parse_speaker(name)[1] == speaker)
    return list(islice((name for name in own if _motion(folder, name) is not None), count))


def _motion(folder: Path, name: str) -> Motion | None:
    """Read the motion of a recording; None if that fails."""
    try:
        return read_motion_and_speech(folder, name)[0]
    except (DataError, MotionError, SpeechError):
        return None
