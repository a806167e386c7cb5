"""What every speech encoder offers: features of a waveform at the motion's frame rate; which there
are, by name; and what our own trained one tells of them (`model.networks.speech_codes`).
"""

from dataclasses import dataclass
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


SPEECH_ENCODER = "speech-encoder"
"""Name of its weights."""
PHONES = tuple(
    "aa ae ah ao aw ax ay b ch d dh eh er ey f g hh ih iy jh k l m n ng ow oy p r s sh t th uh uw "
    "v w y z zh".split()
)
"""That can be told apart, in ARPAbet; number 0 is none of them, such as a pause."""
TOLD = ("accent", "strength", "phrase_end", "voice", "struck", "speed")
"""What is told of each frame beside its phone: whether an accent is there, how strong it is,
whether a phrase ends, whether somebody speaks, how often the word that is said gets a stroke, and
the speed of both planned wrists in the tiers' units a second."""


@dataclass(frozen=True)
class CodesConfig:
    """Shape of the network."""

    speech_dim: int = 68
    width: int = 128
    codes: int = 48
    dilations: tuple[int, ...] = (1, 2, 4, 8, 16)
    """Of convolutions over three frames: about a second of speech is heard on either side."""

    @property
    def context(self) -> int:
        """Frames heard on either side."""
        return sum(self.dilations)
