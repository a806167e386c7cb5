"""Judges of motion: does it fit its own speech better than other speech, whose manner does it take
on, what does the speaker decide of it, and does it rest where speech does?

Matched speech is GENEA's question to its raters (Kucherenko et al. 2023), put to a judge that was
trained on recorded motion alone (`model.systems.helpers.matching`): it is given 10 s of motion and
two speeches of 10 s. Chance is .5. Pieces are cut from where speech begins to where it ends, so
that silence before and after it tells nothing.

The judge of speakers is Fisher's linear discriminant, fitted to recorded motion of the training
split alone: to each piece of 10 s it assigns one of the speakers. Chance is one over their number.
It sees mean and spread of the rotations from pelvis to wrists, where the wrists are, and how fast
all of it moves; no speech.

What the speaker decides is asked of one speech, moved by several speakers under several noise
seeds. As `model.measures.hearing` asks of speech: two motions that share the speaker and not the
noise, less two that share neither, are alike in what the speaker decides. And of a calm speaker and
a lively one: how much less the calm one moves. Both take motions of their own and are asked on a
few clips only: the first seconds of a clip's speech and then silence.
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
from model.data.recordings import DataError, read_files, read_split, speaker_of
from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.measures.face import wrist_speed
from model.measures.hearing import (
    LEAST_FRAMES,
    SILENCE_S,
    Grid,
    arm_rotations_same_noise,
    decided,
    speed_in_silence,
)
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import track_points
from model.sampling.samplers import Sampling, clip_seed
from model.speech.audio import Speech, SpeechError
from model.speech.features import NUM_MELS
from model.storage.npz import MotionError
from model.systems.helpers.config import HEARING_JUDGE
from model.systems.helpers.matching import MatchingJudge, agreement

NO_HEARING_JUDGE = (
    f"Matched speech is left out: its judge {HEARING_JUDGE} is not among the weights."
)
PIECE_FRAMES = 300
MEASURES: Mapping[str, tuple[str, ...]] = {
    "matched": ("arms", "trunk"),
    "matched_arms": ("arms",),
    "matched_face": ("face",),
}
"""Measures, and the parts of the body that the judge sees for them: lips, which decide all where
they move, have a measure of their own."""
ALIKE = 1e-3
"""Agreements nearer to each other than that are a tie."""
_VOICING = NUM_MELS + 3
"""The column of `MelEncoder` that tells whether there is a voice."""

_Heard = Float[np.ndarray, "_ 68"]


def voiced(features: _Heard) -> Bool[np.ndarray, " _"]:
    """Whether there is a voice in each frame."""
    return features[:, _VOICING] > 0.5


def spoken(features: _Heard) -> slice:
    """From the first frame with a voice to the last; empty where there is none."""
    heard = np.flatnonzero(voiced(features))
    return slice(int(heard[0]), int(heard[-1]) + 1) if len(heard) else slice(0, 0)


def pieces(rows: Float[np.ndarray, "T C"]) -> Float[Tensor, "N 300 C"]:
    """As `cut`, for the judge."""
    return torch.from_numpy(cut(rows).astype(np.float32))


def cut(rows: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "N 300 C"]:
    """Pieces of 10 s one after the other; a rest is left out."""
    count = len(rows) // PIECE_FRAMES
    return rows[: count * PIECE_FRAMES].reshape(count, PIECE_FRAMES, rows.shape[1])


def matched(judge: MatchingJudge, motion: Motion, own: _Heard, foreign: _Heard) -> dict[str, float]:
    """For each of `MEASURES`, in which share of comparisons the judge prefers the motion's own
    speech: every piece of the motion with its speech, against every piece of the foreign one. A tie
    counts half. And ``arm_speed_heard``: the correlation of the arms' log speed with the one that
    is told from the speech alone, mean over pieces. Nothing of less than 10 s."""
    shared = min(motion.num_frames, len(own))
    spoke = spoken(own[:shared])
    poses, right, wrong = (
        pieces(rows) for rows in (motion.poses[spoke], own[spoke], foreign[spoken(foreign)])
    )
    if len(right) == 0 or len(wrong) == 0:
        return {}
    found = {}
    for measure, parts in MEASURES.items():
        agreed = judge.agreements(poses, torch.cat([right, wrong]), parts)
        found[measure] = preferred(agreed[:, : len(right)].diagonal(), agreed[:, len(right) :])
    moved, told = judge.arm_speeds(poses, right)
    found["arm_speed_heard"] = float(agreement(told, moved).diagonal().mean())
    return found


def preferred(own: Float[Tensor, " N"], others: Float[Tensor, "N M"]) -> float:
    """The share of others that a piece's own speech beats; a tie counts half."""
    lead = own[:, None] - others
    wins = (lead > ALIKE).double() + 0.5 * (lead.abs() <= ALIKE)
    return float(wins.mean())


def frame_loudness(
    waveform: Float[np.ndarray, " N"], num_frames: int
) -> Float[np.ndarray, " num_frames"]:
    """Level of each motion frame in dB, not below -60 dB of full scale; silence after the end."""
    edges = (np.arange(num_frames + 1) * SAMPLE_RATE / FPS).astype(int)
    energy = np.concatenate([[0.0], np.cumsum(waveform.astype(np.float64) ** 2)])
    total = np.diff(energy[edges.clip(max=len(waveform))])
    return 10 * np.log10(total / np.diff(edges) + 1e-6)


RECORDINGS = 6
"""Of each speaker, at most."""
SHRINKAGE = 0.1
"""Of the covariance within speakers towards equal variances."""
ARMS = [
    f"{side}_{part}"
    for side in ("left", "right")
    for part in ("collar", "shoulder", "elbow", "wrist")
]
JOINTS = [JOINT_INDEX[name] for name in ("spine1", "spine2", "spine3", "neck", "head", *ARMS)]
WRISTS = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]
NO_SPEAKER_JUDGE = (
    "Speakers are not told apart: fewer than two of those in the test clips have recordings of 10 s"
    " in the training split."
)
NUM_CLIPS = 6
SPEECH_S = 10.0
"""Of each clip, at most."""
NOISE_SEEDS = 2
UNKNOWN_SPEAKERS = "Speakers are not compared: not every system knows those that were asked for."


@dataclass(frozen=True)
class SpeakerJudge:
    """A linear discriminant over `manner_numbers`."""

    speakers: tuple[str, ...]
    weights: Float64[np.ndarray, "speakers numbers"]
    bias: Float64[np.ndarray, " speakers"]

    def share_right(self, motion: Motion, speaker: str) -> float | None:
        """The share of a motion's pieces that are assigned to the speaker; None for a speaker that
        the judge does not know, or a motion of less than 10 s."""
        numbers = manner_numbers(motion)
        if speaker not in self.speakers or not len(numbers):
            return None
        told = (numbers @ self.weights.T + self.bias).argmax(1)
        return float((told == self.speakers.index(speaker)).mean())

    def measures(self, motions: Sequence[Motion], speaker: str) -> dict[str, float]:
        """``speaker_told``, mean over motions; nothing where it cannot be told."""
        shares = [self.share_right(motion, speaker) for motion in motions]
        known = [share for share in shares if share is not None]
        return {"speaker_told": float(np.mean(known))} if known else {}


def judge_of(folder: Path, speakers: Sequence[str]) -> SpeakerJudge | None:
    """The judge of some speakers, by their first recordings in the training split; None where
    fewer than two have any that can be used."""
    own: dict[str, list[str]] = {speaker: [] for speaker in sorted(set(speakers))}
    for name, kind in sorted(read_split(folder).items()):
        if kind == "train" and (speaker := speaker_of(name)[1]) in own:
            own[speaker].append(name)
    found = {}
    for speaker, names in own.items():
        motions = (motion for name in names if (motion := _motion(folder, name)) is not None)
        pieces = [*islice(filter(len, map(manner_numbers, motions)), RECORDINGS)]
        if pieces:
            found[speaker] = np.concatenate(pieces)
    return discriminant(found) if len(found) > 1 else None


def discriminant(numbers: dict[str, Float64[np.ndarray, "_ numbers"]]) -> SpeakerJudge:
    """Fisher's, all speakers equally likely, by pieces of each."""
    means = np.stack([own.mean(0) for own in numbers.values()])
    within = np.concatenate([own - own.mean(0) for own in numbers.values()])
    scale = within.std(0) + 1e-6
    correlation = (within / scale).T @ (within / scale) / len(within)
    shrunk = (1 - SHRINKAGE) * correlation + SHRINKAGE * np.eye(len(scale))
    weights = np.linalg.solve(shrunk, (means / scale).T).T / scale
    return SpeakerJudge(tuple(numbers), weights, -0.5 * (weights * means).sum(1))


def manner_numbers(motion: Motion) -> Float64[np.ndarray, "pieces numbers"]:
    """Of each piece of 10 s: mean and log of the spread of rotation vectors and of the wrists'
    places, and the log of mean speeds."""
    if motion.num_frames < PIECE_FRAMES:
        return np.zeros((0, 0))
    points = track_points(motion, open_body_skeleton()).joints
    wrists = points[:, WRISTS] - points[:, :1]
    poses = motion.poses.reshape(len(motion.poses), -1, 3)[:, JOINTS]
    told = np.concatenate([poses, wrists], axis=1)
    speed = np.linalg.norm(np.diff(told, axis=0, prepend=told[:1]), axis=-1) * FPS
    places, moved = cut(told.reshape(len(told), -1)).astype(float), cut(speed).astype(float)
    spread = np.log(places.std(1) + 1e-3)
    return np.concatenate([places.mean(1), spread, np.log(moved.mean(1) + 1e-3)], axis=1)


def manner_of(motions: Grid) -> dict[str, float]:
    """What the speaker decides of the arms, of one speech by speaker and noise seed: the share of
    their speed, and the correlation of their rotations between other speakers with the same noise;
    near 1, another speaker gives the same gestures."""
    return {
        "by_speaker": decided(motions)["arms"].by_speech,
        "arm_rotations_same_noise": arm_rotations_same_noise(motions),
    }


def wrist_speeds(motions: Grid, speakers: tuple[str, str]) -> dict[str, float]:
    """Of both wrists together, with the pelvis in place, mean over the motions of a calm speaker
    and of a lively one; m/s."""
    speeds: dict[str, list[float]] = {speaker: [] for speaker in speakers}
    for (speaker, _), motion in motions.items():
        joints = track_points(motion, open_body_skeleton()).joints
        speeds[speaker].append(float(wrist_speed(joints - joints[:, :1]).mean()))
    calm, lively = (float(np.mean(speeds[speaker])) for speaker in speakers)
    return {"calm_wrist_m_s": calm, "lively_wrist_m_s": lively}


@dataclass(frozen=True)
class FewClips:
    """Which clips, and who moves in them."""

    names: tuple[str, ...]
    speakers: tuple[str, str] | None
    """A calm one and a lively one; None where not every system knows them: then each clip's own
    speaker moves, and manner is left out."""
    recorded: Mapping[str, tuple[str, str]]
    """By clip, a recording of the calm speaker and one of the lively."""

    @staticmethod
    def choose(
        folder: Path,
        clips: Sequence[str],
        systems: Sequence[System],
        speakers: tuple[str, str],
    ) -> "FewClips":
        """The first of the clips, and recordings of the speakers from any split."""
        names = tuple(clips[:NUM_CLIPS])
        if not all(speaker in system.speakers for system in systems for speaker in speakers):
            return FewClips(names, None, {})
        calm, lively = (_recordings(folder, speaker, len(names)) for speaker in speakers)
        recorded = dict(zip(names, zip(calm, lively, strict=False), strict=False))
        return FewClips(names, speakers, recorded)

    def recorded_measures(self, folder: Path, name: str) -> dict[str, float]:
        """Wrist speeds of the recordings that go with clip ``name``; nothing where there are
        none."""
        if name not in self.recorded or self.speakers is None:
            return {}
        pairs = zip(self.speakers, self.recorded[name], strict=True)
        motions = {(speaker, 0): read_files(folder, clip)[0] for speaker, clip in pairs}
        return wrist_speeds(motions, self.speakers)

    def measures(
        self, system: System, name: str, speech: Speech, asked: Sampling
    ) -> dict[str, float]:
        """Of a system, on clip ``name``; nothing on a clip that is not among the few."""
        if name not in self.names:
            return {}
        heard = with_silence(speech)
        spoken = heard.num_frames - round(SILENCE_S * FPS)
        speakers = self.speakers or (speaker_of(name)[1],)
        moved = {
            speaker: generate_motion(
                system,
                heard,
                GenerateOptions(
                    speaker, seed=clip_seed(0, name), samples=NOISE_SEEDS, **vars(asked)
                ),
            )
            for speaker in speakers
        }
        motions = [motion for own in moved.values() for motion in own]
        voiced = np.arange(heard.num_frames) < spoken
        silences = [speed_in_silence(motion, voiced) for motion in motions]
        found = mean_of(silences)
        if self.speakers is None or spoken < LEAST_FRAMES:
            return found
        speaking = {
            (speaker, seed): first_frames(motion, spoken)
            for speaker, own in moved.items()
            for seed, motion in enumerate(own)
        }
        manner = manner_of(speaking)
        return found | {
            "arms_by_speaker": manner["by_speaker"],
            "arm_rotations_other_speaker": manner["arm_rotations_same_noise"],
            **wrist_speeds(speaking, self.speakers),
        }


def mean_of(found: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Averages, such as over noise seeds; a measure that any of them lacks is left out."""
    names = [name for name in found[0] if all(name in one for one in found)]
    return {name: float(np.mean([one[name] for one in found])) for name in names}


def with_silence(speech: Speech) -> Speech:
    """The first `SPEECH_S` of a speech, and `SILENCE_S` of digital silence after it."""
    said = speech.waveform[: round(SPEECH_S * SAMPLE_RATE)]
    silence = np.zeros(round(SILENCE_S * SAMPLE_RATE), np.float32)
    return replace(speech, waveform=np.concatenate([said, silence]))


def _recordings(folder: Path, speaker: str, count: int) -> list[str]:
    """Names of a speaker's first recordings that can be read."""
    own = (name for name in sorted(read_split(folder)) if speaker_of(name)[1] == speaker)
    return list(islice((name for name in own if _motion(folder, name) is not None), count))


def _motion(folder: Path, name: str) -> Motion | None:
    """Of a recording; None where it cannot be read."""
    try:
        return read_files(folder, name)[0]
    except (DataError, MotionError, SpeechError):
        return None
