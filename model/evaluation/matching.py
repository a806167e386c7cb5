"""Matched or mismatched: does a motion fit its own speech better than somebody else's?

GENEA's question to its raters (Kucherenko et al. 2023), put to a judge that was trained on recorded
motion alone (`model.networks.matching`): it is given 10 s of motion and two speeches of 10 s.
Chance is .5. Pieces are cut from where speech begins to where it ends, so that silence before and
after it tells nothing.
"""

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from model.motion.motion import Motion
from model.networks.matching import MatchingJudge, agreement
from model.speech.features import NUM_MELS
from model.systems.matching.config import HEARING_JUDGE

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

Features = Float[np.ndarray, "_ 68"]


def left_out(judge: MatchingJudge | None) -> list[str]:
    """A sentence where nobody is there to judge."""
    if judge is not None:
        return []
    return [f"Matched speech is left out: its judge {HEARING_JUDGE} is not among the weights."]


def voiced(features: Features) -> Bool[np.ndarray, " _"]:
    """Whether there is a voice in each frame."""
    return features[:, _VOICING] > 0.5


def spoken(features: Features) -> slice:
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


def matched(
    judge: MatchingJudge, motion: Motion, own: Features, foreign: Features
) -> dict[str, float]:
    """For each of `MEASURES`, in which share of comparisons the judge prefers the motion's own
    speech: every piece of the motion with its speech, against every piece of the foreign one. A tie
    counts half.

    And ``arm_speed_heard``: the correlation of the arms' log speed with the one that is told from
    the speech alone, mean over pieces.

    Args:
        own: features of the motion's speech (`MelEncoder`), from its first frame on.
        foreign: those of another speech.

    Returns:
        Nothing where either speech, or the motion under it, lasts less than 10 s.
    """
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
