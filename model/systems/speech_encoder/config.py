"""Settings of the speech encoder's training."""

from dataclasses import dataclass, field, replace

from model.speech.codes import CodesConfig
from model.training.config import SMOKE, THROATS, TrainConfig

PRESETS = ("demo", "smoke")


@dataclass(frozen=True)
class SpeechEncoderConfig(TrainConfig):
    """One training of the speech encoder."""

    codes: CodesConfig = field(default_factory=CodesConfig)
    window_frames: int = 300


def named_config(preset: str, system: str) -> SpeechEncoderConfig:
    """The settings called ``preset``.

    Raises:
        ValueError: if there are none.
    """
    config = SpeechEncoderConfig(
        system=system, steps=4000, batch_size=16, learning_rate=3e-3, ema_decay=0.995,
        save_every=500, validate_every=1000, throats=THROATS,
    )  # fmt: skip
    match preset:
        case "demo":
            return config
        case "smoke":
            shape = replace(config.codes, width=16, codes=8, dilations=(1, 2))
            return replace(config, codes=shape, window_frames=60, **SMOKE)
    raise ValueError(f"There is no config {preset!r}; choose one of {', '.join(PRESETS)}.")
