"""Settings of every training; a family's config adds its networks and losses."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TrainConfig:
    """Settings of one training, without those of the network."""

    system: str
    encoder: str = "mel64"
    """Name of the speech encoder (`model.speech`)."""
    augment_speech: bool = True
    """True to vary level, colour and background noise of the features, as microphones do."""
    throats: tuple[float, float] | None = None
    """Range of vocal tract length factors, which stretch the mel bands for unknown voices."""
    augmented_copies: int = 1
    """Number of copies of each training recording at another speed and with another microphone."""
    steps: int = 8000
    batch_size: int = 16
    learning_rate: float = 4e-4
    warmup_steps: int = 200
    weight_decay: float = 0.01
    betas: tuple[float, float] = (0.9, 0.999)
    """AdamW's decay rates of the moments."""
    clip_norm: float = 1.0
    ema_decay: float = 0.999
    seed_dropout: float = 0.1
    """Share of windows trained without a seed pose, so that a clip can start without one."""
    speech_dropout: float = 0.1
    speaker_dropout: float = 0.1
    random_seed: int = 0
    save_every: int = 250
    validate_every: int = 500


SMOKE: dict[str, Any] = {
    "augmented_copies": 0,
    "steps": 40,
    "batch_size": 4,
    "warmup_steps": 5,
    "save_every": 20,
    "validate_every": 20,
}
"""Fields of a training that takes a minute, for any network."""
VOCAL_TRACT_RANGE = (0.84, 1.2)
"""`TrainConfig.throats` of men, women and children."""
PAPER: dict[str, Any] = {
    "encoder": "wavlm",
    "augment_speech": False,
    "augmented_copies": 0,
    "steps": 200_000,
    "batch_size": 128,
    "learning_rate": 1e-4,
    "warmup_steps": 1000,
    "save_every": 1000,
    "validate_every": 5000,
}
"""Fields of a training as long as the paper's."""


@dataclass(frozen=True)
class GeometricWeights:
    """Weights of the terms in `model.training.losses` (metres, per frame); 0 skips a term."""

    simple: float = 1.0
    """Weight of GlobalDiff eq. 7, on normalised channels."""
    position: float = 10.0
    """Weight of L_pos: joint positions through forward kinematics."""
    velocity: float = 100.0
    """Weight of first differences of those positions; in the official code, not in the paper."""
    acceleration: float = 100.0
    """Weight of second differences of those positions; in the official code, not in the paper."""
    contact: float = 0.0
    """Weight of horizontal steps of feet that stand still in the recording."""
    rooted: bool = False
    """True to align positions and their differences to the pelvis; the root has its channels."""
