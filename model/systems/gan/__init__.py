"""Conditional-GAN few-step denoising; may import the face and what systems may."""

from model.generation.family import Family
from model.sampling.samplers import SAMPLER_TITLES, Sampler
from model.systems.gan.config import (
    SYSTEMS,
    WEIGHTS,
    presets,
)

_FASTEST = min(SYSTEMS, key=lambda name: SYSTEMS[name])


def _samplers(steps: int) -> tuple[Sampler, ...]:
    """As they were taught, x_0 is drawn and a step from its posterior; DDIM follows the mean."""
    return (
        Sampler("posterior", steps, title="Drawn from the posterior (few-step generators)"),
        Sampler("ddim", steps, title=SAMPLER_TITLES["ddim"]),
    )


FAMILY = Family(
    name="gan",
    title="Few large steps that a discriminator taught",
    systems=tuple(SYSTEMS),
    about={
        name: f"Drawn in {steps} large denoising steps, trained against a discriminator."
        for name, steps in SYSTEMS.items()
    },
    presets=presets,
    package="model.systems.gan",
    place=4,
    own_samplers={name: _samplers(steps) for name, steps in SYSTEMS.items()},
    guidance=dict.fromkeys(SYSTEMS, 3.0),
    usual=dict.fromkeys(("steps", "hearing", "hearing-tab", "live"), (_FASTEST,)),
    shared_weights={name: WEIGHTS for name in SYSTEMS if name != WEIGHTS},
)
