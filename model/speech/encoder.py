"""What every speech encoder offers: features of a waveform at the motion's frame rate; and which
there are, by name.
"""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float32

WEIGHTS_VARIABLE = "WAVLM_DIR"
"""Names the folder of a speech model's weights."""


class EncoderError(ValueError):
    """A speech encoder that cannot be used here; the message is one sentence for a person."""


@runtime_checkable
class SpeechEncoder(Protocol):
    """Turns 16 kHz mono speech into one feature vector for each motion frame."""

    name: str
    dim: int

    def encode(
        self, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, "num_frames dim"]:
        """Features of frames ``0 .. num_frames - 1``; frame k covers ``[k / 30, (k + 1) / 30)`` s.

        Frames beyond the end of the waveform hold the features of silence.
        """
        ...


def make_encoder(name: str) -> SpeechEncoder:
    """The encoder called ``mel64`` (nothing to download) or ``wavlm`` (needs its weights).

    Raises:
        ValueError: if the name is unknown, or WavLM's weights are not there.
    """
    match name:
        case "mel64":
            from model.speech.features import MelEncoder  # imports torch

            return MelEncoder()
        case "wavlm":
            from model.speech.wavlm import WavLMEncoder  # imports transformers

            return WavLMEncoder()
    raise ValueError(f"There is no speech encoder {name!r}; choose mel64 or wavlm.")
