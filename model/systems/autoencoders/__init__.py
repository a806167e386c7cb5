"""The motion autoencoders, L_m's teacher and the judge of FGD: may import what systems may."""

from model.systems.autoencoders.config import FGD_ENCODER, MOTION_VAE, PRESETS, named_config
from model.systems.family import Family

FAMILY = Family(
    name="autoencoders",
    systems=(),
    about={},
    samplers=(),
    presets=PRESETS,
    config=named_config,
    package="model.systems.autoencoders",
    helpers=(MOTION_VAE, FGD_ENCODER),
)
