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
    titles = {
        "posterior": "Drawn from the posterior (few-step generators)",
        "ddim": SAMPLER_TITLES["ddim"],
    }
    return tuple(Sampler(n, steps, title=title, guidance=3.0) for n, title in titles.items())


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
    samplers={name: _samplers(steps) for name, steps in SYSTEMS.items()},
    usual=dict.fromkeys(("steps", "hearing", "hearing-tab", "live"), (_FASTEST,)),
    shared_weights={name: WEIGHTS for name in SYSTEMS if name != WEIGHTS},
)
