"""What every speech encoder offers: features of a waveform at the motion's frame rate."""

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
