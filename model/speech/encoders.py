"""Speech encoders by name."""

from model.speech.encoder import SpeechEncoder
from model.speech.features import MelEncoder
from model.speech.wavlm import WavLMEncoder


def make_encoder(name: str) -> SpeechEncoder:
    """Make the encoder ``mel64`` or ``wavlm``; raises ValueError if unknown or without weights."""
    match name:
        case "mel64":
            return MelEncoder()
        case "wavlm":
            return WavLMEncoder()
    raise ValueError(f"There is no speech encoder {name!r}; choose mel64 or wavlm.")
