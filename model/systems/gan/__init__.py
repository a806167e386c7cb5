"""Conditional-GAN few-step denoising; may import the face and what systems may."""

from model.generation.family import Family
from model.sampling.samplers import SAMPLER_TITLES, Sampler
from model.systems.gan.config import (
    PRESETS,
    SAMPLER,
    SOLVERS,
    SYSTEMS,
    WEIGHTS,
    named_config,
)

_FASTEST = min(SYSTEMS, key=lambda name: SYSTEMS[name])
_TITLES = SAMPLER_TITLES | {
    SAMPLER: "Drawn from the posterior (few-step generators)",
    "dpm-solver++": "DPM-Solver++ (first order)",
    "dpm-solver++-2m": "DPM-Solver++ 2M (second order)",
}

FAMILY = Family(
    name="gan",
    title="Few large steps that a discriminator taught",
    systems=tuple(SYSTEMS),
    about={
        name: f"Drawn in {steps} large denoising steps, trained against a discriminator."
        for name, steps in SYSTEMS.items()
    },
    samplers=(Sampler(SAMPLER, SYSTEMS[WEIGHTS], title=_TITLES[SAMPLER]),),
    presets=PRESETS,
    config=named_config,
    package="model.systems.gan",
    place=4,
    own_samplers={
        name: tuple(Sampler(way, steps, title=_TITLES[way]) for way in (SAMPLER, *SOLVERS))
        for name, steps in SYSTEMS.items()
    },
    guidance=dict.fromkeys(SYSTEMS, 3.0),
    usual=dict.fromkeys(("steps", "hearing", "hearing-tab", "live"), (_FASTEST,)),
    shared_weights={name: WEIGHTS for name in SYSTEMS if name != WEIGHTS},
)
