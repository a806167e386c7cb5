"""The autoencoders, L_m's teacher and the judges of distances: may import what systems may."""

from model.generation.family import Family
from model.systems.autoencoders.config import JUDGES, MOTION_VAE, PRESETS, named_config

FAMILY = Family(
    name="autoencoders",
    title="Autoencoders",
    presets=PRESETS,
    config=named_config,
    package="model.systems.autoencoders",
    place=7,
    helpers=(MOTION_VAE, *JUDGES),
)
