"""Speech encoders by name, as configs and weight cards spell them."""

from model.speech.encoder import SpeechEncoder
from model.speech.features import MelEncoder


def make_encoder(name: str) -> SpeechEncoder:
    """The encoder called ``mel64`` (nothing to download) or ``wavlm`` (needs its weights).

    Raises:
        ValueError: if the name is unknown, or WavLM's weights are not there.
    """
    match name:
        case "mel64":
            return MelEncoder()
        case "wavlm":
            from model.speech.wavlm import WavLMEncoder  # imports transformers

            return WavLMEncoder()
    raise ValueError(f"There is no speech encoder {name!r}; choose mel64 or wavlm.")
