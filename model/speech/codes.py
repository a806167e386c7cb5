"""What our own speech encoder tells of speech, and its shape (`model.networks.speech_codes`)."""

from dataclasses import dataclass

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
