"""Settings of the networks that systems and evaluation use."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from model.generation.family import Family
from model.motion.spaces import VectorScaling
from model.networks.config import AutoencoderConfig, MatchingConfig
from model.speech.encoder import SPEECH_ENCODER, SpeechEncoderConfig
from model.training.config import SMOKE, VOCAL_TRACT_RANGE, GeometricWeights, TrainConfig

MOTION_VAE = "motion-vae"
FGD_ENCODER, FMD_ENCODER, FED_ENCODER = "fgd-encoder", "fmd-encoder", "fed-encoder"
MATCHING_NETWORK = "hearing-judge"
"""Name of the weights of the classifier of matched speech and motion."""
EVALUATION_ENCODER = AutoencoderConfig(
    rotation_space="local", blocks_per_scale=1, scales=(8,), mask_share=0.0, kl_weight=0.0
)
"""Shape of the Fréchet distances' encoders. It differs from L_m's encoder in space (local, as
EMAGE's), scale and weights, so that a system trained with L_m is not measured by its teacher."""
AUTOENCODERS = {
    MOTION_VAE: AutoencoderConfig(),
    FGD_ENCODER: EVALUATION_ENCODER,
    FMD_ENCODER: replace(EVALUATION_ENCODER, face_channels=52),
    FED_ENCODER: replace(EVALUATION_ENCODER, motion_channels=0, face_channels=52),
}
"""L_m's encoder, and the encoders of FGD (body), FMD (body and face) and FED (face) by name."""


@dataclass(frozen=True)
class AutoencoderTrainConfig(TrainConfig):
    """Settings of a training of an autoencoder."""

    autoencoder: AutoencoderConfig = field(default_factory=AutoencoderConfig)
    representation: VectorScaling = "normalised"
    loss: GeometricWeights = field(default_factory=GeometricWeights)
    window_frames: int = 60


@dataclass(frozen=True)
class MatchingTrainConfig(TrainConfig):
    """Settings of a training of the classifier of matched speech."""

    matching: MatchingConfig = field(default_factory=MatchingConfig)
    piece_frames: int = 300
    """Length of a piece of speech or motion (frames)."""
    pieces: int = 4
    """Number of successive pieces per window; mismatches thus include the same voice and habits."""
    arm_speed_weight: float = 0.3
    """Weight of the arms' log speed error, added to the contrastive loss."""


@dataclass(frozen=True)
class SpeechEncoderTrainConfig(TrainConfig):
    """Settings of a training of the speech encoder."""

    codes: SpeechEncoderConfig = field(default_factory=SpeechEncoderConfig)
    window_frames: int = 300


def presets(system: str) -> Mapping[str, TrainConfig]:
    """Return the settings by name."""
    if system == MATCHING_NETWORK:
        judge = MatchingTrainConfig(
            system=system, steps=300, batch_size=16, learning_rate=1e-3, warmup_steps=30,
            ema_decay=0.98,
        )  # fmt: skip
        tiny = replace(judge.matching, speech_width=8, motion_width=8, dilations=(1,))
        smoke = replace(judge, matching=tiny, piece_frames=60, pieces=2, **SMOKE)
        return {"demo": judge, "smoke": smoke}
    if system == SPEECH_ENCODER:
        encoder = SpeechEncoderTrainConfig(
            system=system, steps=4000, batch_size=16, learning_rate=3e-3, ema_decay=0.995,
            save_every=500, validate_every=1000, throats=VOCAL_TRACT_RANGE,
        )  # fmt: skip
        small = replace(encoder.codes, width=16, codes=8, dilations=(1, 2))
        return {"demo": encoder, "smoke": replace(encoder, codes=small, window_frames=60, **SMOKE)}
    config = AutoencoderTrainConfig(
        system=system, autoencoder=AUTOENCODERS[system], steps=3000, batch_size=32,
        learning_rate=1e-3,
    )  # fmt: skip
    shape = replace(config.autoencoder, width=16, blocks_per_scale=1)
    return {"demo": config, "smoke": replace(config, autoencoder=shape, **SMOKE)}


FAMILY = Family(
    name="helpers",
    title="Networks that the systems use",
    presets=presets,
    package="model.systems.helpers",
    display_order=7,
    helper_networks=(*AUTOENCODERS, MATCHING_NETWORK, SPEECH_ENCODER),
)
