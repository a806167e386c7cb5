"""The speech encoder's settings."""

from dataclasses import dataclass, field, replace

from model.generation.family import Family
from model.speech.codes import SPEECH_ENCODER, CodesConfig
from model.training.config import SMOKE, THROATS, TrainConfig


@dataclass(frozen=True)
class SpeechEncoderConfig(TrainConfig):
    """One training of the speech encoder."""

    codes: CodesConfig = field(default_factory=CodesConfig)
    window_frames: int = 300


def presets(system: str) -> dict[str, SpeechEncoderConfig]:
    """Settings by name."""
    config = SpeechEncoderConfig(
        system=system, steps=4000, batch_size=16, learning_rate=3e-3, ema_decay=0.995,
        save_every=500, validate_every=1000, throats=THROATS,
    )  # fmt: skip
    shape = replace(config.codes, width=16, codes=8, dilations=(1, 2))
    smoke = replace(config, codes=shape, window_frames=60, **SMOKE)
    return {"demo": config, "smoke": smoke}


FAMILY = Family(
    name="speech-encoder",
    title="The speech encoder",
    presets=presets,
    package="model.systems.speech_encoder",
    place=9,
    helpers=(SPEECH_ENCODER,),
)
