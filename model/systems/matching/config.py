"""The judge's settings."""

from dataclasses import dataclass, field, replace

from model.generation.family import Family
from model.networks.config import MatchingConfig
from model.training.config import SMOKE, TrainConfig

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


def presets(system: str) -> dict[str, MatchingTrainConfig]:
    """Settings by name."""
    config = MatchingTrainConfig(
        system=system, steps=300, batch_size=16, learning_rate=1e-3, warmup_steps=30, ema_decay=0.98
    )
    shape = replace(config.matching, speech_width=8, motion_width=8, dilations=(1,))
    smoke = replace(config, matching=shape, piece_frames=60, pieces=2, **SMOKE)
    return {"demo": config, "smoke": smoke}


FAMILY = Family(
    name="matching",
    title="The judge of matched speech",
    presets=presets,
    package="model.systems.matching",
    place=8,
    helpers=(HEARING_JUDGE,),
)
