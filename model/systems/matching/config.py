"""Settings of the judge of matched and mismatched speech."""

from dataclasses import dataclass, field, replace

from model.networks.config import MatchingConfig
from model.training.config import SMOKE, TrainConfig

PRESETS = ("demo", "smoke")
HEARING_JUDGE = "hearing-judge"


@dataclass(frozen=True)
class MatchingTrainConfig(TrainConfig):
    """One training of the judge."""

    matching: MatchingConfig = field(default_factory=MatchingConfig)
    piece_frames: int = 300
    """Of one piece of speech or motion that is told from others."""
    pieces: int = 4
    """Cut one after the other from each window, so that others of the same clip, with the same
    voice and the same habits, are among the wrong ones."""
    arm_speed_weight: float = 0.3
    """Of the error of the arms' log speed told from speech alone, beside the contrastive loss."""


def named_config(preset: str, system: str) -> MatchingTrainConfig:
    """The settings called ``preset``.

    Raises:
        ValueError: if there are none.
    """
    config = MatchingTrainConfig(
        system=system, steps=300, batch_size=16, learning_rate=1e-3, warmup_steps=30, ema_decay=0.98
    )
    match preset:
        case "demo":
            return config
        case "smoke":
            shape = replace(config.matching, speech_width=8, motion_width=8, dilations=(1,))
            return replace(config, matching=shape, piece_frames=60, pieces=2, **SMOKE)
    raise ValueError(f"There is no config {preset!r}; choose one of {', '.join(PRESETS)}.")
