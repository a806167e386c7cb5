"""A second family, as small as one can be: a network that hears a frame and strikes a pose."""

from dataclasses import dataclass

from model.generation.family import Family, Sampler
from model.training.config import TrainConfig

NAME = "toy/puppet"
LIVELY = "toy/lively"


@dataclass(frozen=True)
class ToyConfig(TrainConfig):
    """One training of the puppet."""

    width: int = 8


def named_config(preset: str, system: str) -> ToyConfig:
    """There is only one preset."""
    if preset != "tiny":
        raise ValueError(f"There is no config {preset!r}; choose tiny.")
    return ToyConfig(system, augmented_copies=0, steps=6, batch_size=2, save_every=3,
                     validate_every=6, learning_rate=1e-2)  # fmt: skip


FAMILY = Family(
    name="toy",
    title="A toy",
    systems=(NAME, LIVELY),
    about={
        NAME: "A puppet that strikes the pose it was shown with each sound.",
        LIVELY: "The same puppet in livelier hands.",
    },
    samplers=(Sampler("once", 1), Sampler("often", 3)),
    presets=("tiny",),
    config=named_config,
    package="tests.toy_family",
    own_samplers={LIVELY: (Sampler("often", 3),)},
    shared_weights={LIVELY: NAME},
)
