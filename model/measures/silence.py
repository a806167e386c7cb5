"""Does motion come to rest where speech does? Speeds in a silence over those while speaking."""

from itertools import pairwise

import numpy as np
from jaxtyping import Bool

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.measures.hearing import ARMS, turning
from model.motion.motion import Motion

SILENCE_S = 5.0
"""What is looked at after speech; who pauses for less is still speaking."""
PARTS = {"arms": ARMS, "jaw": [JOINT_INDEX["jaw"]]}


def spoken_and_silent(
    voiced: Bool[np.ndarray, " T"],
) -> tuple[Bool[np.ndarray, " T"], Bool[np.ndarray, " T"]]:
    """Frames of speaking, and of the first `SILENCE_S` of each silence after it.

    A silence is a stretch without voice of `SILENCE_S` or more. What lies before the first voice,
    the rest of a long silence, and an end too short to tell, is neither.
    """
    spoken, silent = np.zeros(len(voiced), bool), np.zeros(len(voiced), bool)
    wanted = round(SILENCE_S * FPS)
    heard = np.flatnonzero(voiced)
    spoken[heard] = True
    for this, following in pairwise([*heard, len(voiced)]):
        if following - this > wanted:
            silent[this + 1 : this + 1 + wanted] = True
        elif following < len(voiced):
            spoken[this:following] = True
    return spoken, silent


def speed_in_silence(motion: Motion, voiced: Bool[np.ndarray, " T"]) -> dict[str, float]:
    """``arms_in_silence`` and ``jaw_in_silence``: mean angular speed in the silences after speech
    over that while speaking, 0 where all rests.

    Args:
        voiced: whether there is a voice, from the motion's first frame on.

    Returns:
        Nothing where there is no such silence, or what does not move even while speaking.
    """
    frames = min(motion.num_frames, len(voiced))
    spoken, silent = spoken_and_silent(voiced[:frames])
    if not silent.any():
        return {}
    found = {}
    for part, joints in PARTS.items():
        speed = turning(motion, joints)[: frames - 1]
        speaking = speed[spoken[1:]].mean()
        if speaking > 0:
            found[f"{part}_in_silence"] = float(speed[silent[1:]].mean() / speaking)
    return found
