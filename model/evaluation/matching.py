"""Does a motion fit its own speech better than other speech? By a judge, and by the wrong-speech
test.

GENEA's question to its raters (Kucherenko et al. 2023), put to a judge that was trained on recorded
motion alone (`model.systems.matching.network`): it is given 10 s of motion and two speeches of 10
s. Chance is .5. Pieces are cut from where speech begins to where it ends, so that silence before
and after it tells nothing.
"""

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from conventions.rates import FPS, SAMPLE_RATE
from model.measures.face import lagged_correlation, wrist_speed
from model.motion.motion import Motion
from model.speech.features import NUM_MELS
from model.systems.matching import HEARING_JUDGE
from model.systems.matching.network import MatchingJudge, agreement

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


def frame_loudness(
    waveform: Float[np.ndarray, " N"], num_frames: int
) -> Float[np.ndarray, " num_frames"]:
    """Level of each motion frame in dB, not below -60 dB of full scale; silence after the end."""
    edges = (np.arange(num_frames + 1) * SAMPLE_RATE / FPS).astype(int)
    energy = np.concatenate([[0.0], np.cumsum(waveform.astype(np.float64) ** 2)])
    total = np.diff(energy[edges.clip(max=len(waveform))])
    return 10 * np.log10(total / np.diff(edges) + 1e-6)


def coupling(positions: Float[np.ndarray, "T 55 3"], loudness: Float[np.ndarray, " T2"]) -> float:
    """How far the speed of the wrists goes with the loudness of speech: their correlation at the
    best lag within half a second, both smoothed over 0.3 s. The choice of the lag raises it above
    0 for any two signals: compare with shifted speech.
    """
    return lagged_correlation(wrist_speed(positions), loudness)
