"""Whose manner a motion takes on: what the speaker decides of it.

One speech, moved by several speakers under several noise seeds. As `model.measures.hearing` asks of
speech: two motions that share the speaker and not the noise, less two that share neither, are alike
in what the speaker decides. And of a calm speaker and a lively one: how much less the calm one
moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from model.diagnostics.diagnostics import track_points
from model.measures.face.face_and_hands import wrist_speed
from model.measures.hearing import Grid, arm_rotations_same_noise, decided
from model.motion.motion import Motion
from model.motion.skeleton import open_body_skeleton


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
