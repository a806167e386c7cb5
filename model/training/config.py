"""What every training run is told; a family's config adds its networks and losses."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrainConfig:
    """One training run, but for what is trained."""

    system: str
    encoder: str = "mel64"
    """Speech encoder by name (`model.speech`)."""
    augment_speech: bool = True
    """Vary level, colour and background noise of the features, as microphones do."""
    mirror: float = 0.0
    """Share of windows seen as in a mirror, left and right exchanged. Where speakers are known by
    the hand they prefer, as in the bundled data, it would blur them."""
    augmented_copies: int = 1
    """Copies of each training recording at another speed, heard by another microphone."""
    steps: int = 8000
    batch_size: int = 16
    learning_rate: float = 4e-4
    warmup_steps: int = 200
    weight_decay: float = 0.01
    clip_norm: float = 1.0
    ema_decay: float = 0.999
    seed_dropout: float = 0.1
    """Share of windows trained without a seed pose, so that a clip can start from nothing."""
    speech_dropout: float = 0.1
    speaker_dropout: float = 0.1
    random_seed: int = 0
    save_every: int = 250
    validate_every: int = 500
