"""What autoencoders are trained, and how."""

from dataclasses import dataclass, field, replace

from model.generation.family import Family
from model.motion.spaces import Representation
from model.networks.config import AutoencoderConfig
from model.training.config import SMOKE, GeometricWeights, TrainConfig

MOTION_VAE = "motion-vae"
FGD_ENCODER, FMD_ENCODER, FED_ENCODER = "fgd-encoder", "fmd-encoder", "fed-encoder"
JUDGE = AutoencoderConfig(
    rotation_space="local", blocks_per_scale=1, scales=(8,), mask_share=0.0, kl_weight=0.0
)
"""Local rotations as EMAGE's; unlike L_m's encoder in space, scale and weights, so that the system
trained with L_m is not judged by its own teacher."""
JUDGES = {
    FGD_ENCODER: JUDGE,
    FMD_ENCODER: replace(JUDGE, face_channels=52),
    FED_ENCODER: replace(JUDGE, motion_channels=0, face_channels=52),
}
"""The encoders of FGD (body), FMD (body and face) and FED (face) by name."""


@dataclass(frozen=True)
class AutoencoderTrainConfig(TrainConfig):
    """One training of an autoencoder."""

    autoencoder: AutoencoderConfig = field(default_factory=AutoencoderConfig)
    representation: Representation = "normalised"
    loss: GeometricWeights = field(default_factory=GeometricWeights)
    window_frames: int = 60


def presets(system: str) -> dict[str, AutoencoderTrainConfig]:
    """Settings for the teacher or a judge by name."""
    config = AutoencoderTrainConfig(system=system, steps=3000, batch_size=32, learning_rate=1e-3)
    if system in JUDGES:
        config = replace(config, autoencoder=JUDGES[system])
    shape = replace(config.autoencoder, width=16, blocks_per_scale=1)
    smoke = replace(config, autoencoder=shape, **SMOKE)
    return {"demo": config, "smoke": smoke}


FAMILY = Family(
    name="autoencoders",
    title="Autoencoders",
    presets=presets,
    package="model.systems.autoencoders",
    place=7,
    helpers=(MOTION_VAE, *JUDGES),
)
