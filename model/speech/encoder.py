"""Interface of the speech encoders, their names, and the outputs of the trained one.

An encoder computes features of a waveform at the motion's frame rate; the trained one is
`model.networks.speech_codes`.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float32

WEIGHTS_VARIABLE = "WAVLM_DIR"
"""Environment variable with the folder of a speech model's weights."""


class EncoderError(ValueError):
    """A speech encoder that cannot be used here; the message is one sentence for the user."""


@runtime_checkable
class SpeechEncoder(Protocol):
    """An encoder of 16 kHz mono speech into one feature vector per motion frame."""

    name: str
    dim: int

    def encode(
        self, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, "num_frames dim"]:
        """Return features of ``num_frames`` frames; frame k covers ``[k / 30, (k + 1) / 30)`` s.

        Frames beyond the end of the waveform hold the features of silence.
        """
        ...


SPEECH_ENCODER = "speech-encoder"
"""Name of the encoder's weights."""
PHONES = tuple(
    "aa ae ah ao aw ax ay b ch d dh eh er ey f g hh ih iy jh k l m n ng ow oy p r s sh t th uh uw "
    "v w y z zh".split()
)
"""Phones that are classified, in ARPAbet; class 0 is none of them, such as a pause."""
SPEECH_LABELS = ("accent", "strength", "phrase_end", "voice", "struck", "speed")
"""Names of the outputs of a frame besides its phone: whether there is an accent, its strength,
whether a phrase ends, whether somebody speaks, how often the current word has a stroke, and the
speed of both planned wrists in the tiers' units per second."""


@dataclass(frozen=True)
class SpeechEncoderConfig:
    """Shape of the trained speech encoder's network."""

    speech_dim: int = 68
    width: int = 128
    codes: int = 48
    """Dimension of the continuous code of each frame."""
    dilations: tuple[int, ...] = (1, 2, 4, 8, 16)
    """Dilations of the convolutions of width three: a context of about one second on each side."""

    @property
    def context_frames_per_side(self) -> int:
        """Number of frames of context on either side."""
        return sum(self.dilations)
