"""Whose manner a motion takes on: what the speaker decides of it, and a judge of speakers.

The judge is Fisher's linear discriminant, fitted to recorded motion of the training split alone: to
each piece of 10 s it assigns one of the speakers. Chance is one over their number. It sees mean and
spread of the rotations from pelvis to wrists, where the wrists are, and how fast all of it moves;
no speech.

What the speaker decides is asked of one speech, moved by several speakers under several noise
seeds. As `model.measures.hearing` asks of speech: two motions that share the speaker and not the
noise, less two that share neither, are alike in what the speaker decides. And of a calm speaker and
a lively one: how much less the calm one moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.data.recordings import DataError, read_files, read_split, speaker_of
from model.evaluation.matching import PIECE_FRAMES, cut
from model.measures.face import wrist_speed
from model.measures.hearing import Grid, arm_rotations_same_noise, decided
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import track_points
from model.speech.audio import SpeechError
from model.storage.npz import MotionError

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
LEFT_OUT = (
    "Speakers are not told apart: fewer than two of those in the test clips have recordings of 10 s"
    " in the training split."
)


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
        pieces = [*islice(filter(len, (_numbers(folder, name) for name in names)), RECORDINGS)]
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


def _numbers(folder: Path, name: str) -> Float64[np.ndarray, "pieces numbers"]:
    try:
        return manner_numbers(read_files(folder, name)[0])
    except (DataError, MotionError, SpeechError):
        return np.zeros((0, 0))


def left_out(judge: SpeakerJudge | None) -> list[str]:
    """A sentence where nobody is told apart."""
    return [] if judge else [LEFT_OUT]


@dataclass(frozen=True)
class Manner:
    """What the speaker decides of the arms."""

    by_speaker: float
    """The share of their speed."""
    arm_rotations_same_noise: float
    """Correlation of their rotations between other speakers with the same noise; near 1, another
    speaker gives the same gestures."""


def manner_of(motions: Grid) -> Manner:
    """Of one speech.

    Args:
        motions: by speaker and noise seed.

    Raises:
        ValueError: see `model.measures.hearing.decided`.
    """
    return Manner(decided(motions)["arms"].by_speech, arm_rotations_same_noise(motions))


def wrist_speed_m_s(motion: Motion) -> float:
    """Of both wrists together, with the pelvis in place; mean over the motion, m/s."""
    joints = track_points(motion, open_body_skeleton()).joints
    return float(wrist_speed(joints - joints[:, :1]).mean())


def calm_over_lively(calm: Sequence[Motion], lively: Sequence[Motion]) -> float:
    """Mean `wrist_speed_m_s` of a calm speaker's motions over that of a lively one's."""
    slow, fast = (np.mean([wrist_speed_m_s(motion) for motion in own]) for own in (calm, lively))
    return float(slow / fast)
