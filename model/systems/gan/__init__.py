"""Conditional-GAN few-step denoising; may import the face and what systems may."""

from model.generation.family import Family, Sampler
from model.systems.gan.config import (
    PRESETS,
    SAMPLER,
    SOLVERS,
    SYSTEMS,
    WEIGHTS,
    named_config,
)

FAMILY = Family(
    name="gan",
    title="Few large steps that a discriminator taught",
    systems=tuple(SYSTEMS),
    about={
        name: f"Drawn in {steps} large denoising steps, trained against a discriminator."
        for name, steps in SYSTEMS.items()
    },
    samplers=(Sampler(SAMPLER, SYSTEMS[WEIGHTS]),),
    presets=PRESETS,
    config=named_config,
    package="model.systems.gan",
    own_samplers={
        name: tuple(Sampler(way, steps) for way in (SAMPLER, *SOLVERS))
        for name, steps in SYSTEMS.items()
    },
    guidance=dict.fromkeys(SYSTEMS, 3.0),
    shared_weights={name: WEIGHTS for name in SYSTEMS if name != WEIGHTS},
)
