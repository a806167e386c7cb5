"""Does motion follow its speech? The wrong-speech test, on predictions and on finished motion."""

import numpy as np
from jaxtyping import Float

from conventions.rates import FPS, SAMPLE_RATE
from model.generation.base import Features
from model.measures.face.face_and_hands import SHIFT_S, wrist_speed
from model.measures.lagged_correlation import lagged_correlation


def speech_tracks(right: Features, foreign: Features) -> dict[str, Features]:
    """The clip's own speech, the same shifted by 4 s in a circle, and another clip's."""
    return {
        "right": right,
        "shifted": np.roll(right, round(SHIFT_S * FPS), axis=0),
        "foreign": np.resize(foreign, right.shape),
    }


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
