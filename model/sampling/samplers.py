"""Names and options of samplers, and the noise seed of a clip, without an import of torch."""

import hashlib
from dataclasses import dataclass
from typing import Literal, get_args

FlowSampler = Literal["euler", "heun", "reinterpolate"]
FLOW_SAMPLERS: tuple[FlowSampler, ...] = get_args(FlowSampler)
"""Flow samplers, defined in `model.sampling.flow.sample`."""
SAMPLER_TITLES = {
    "euler": "Euler (first order)",
    "heun": "Heun (second order)",
    "reinterpolate": "Re-interpolation (official GlobalDiff)",
    "ddim": "DDIM",
    "posterior": "Posterior sampling (few-step generators)",
    "lcm": "LCM",
}
"""Names of the samplers for users."""


class UnknownNameError(ValueError):
    """A system, speaker or sampler that does not exist; the message lists those that do."""


@dataclass(frozen=True)
class SamplerChoice:
    """A sampler that a user may choose for a system, with the defaults of its options.

    Example:
        >>> heun, euler = make_samplers("heun", "euler", steps=8, guidance=1.5)
        >>> heun.title, heun.default_steps, heun.default_guidance
        ('Heun (second order)', 8, 1.5)
    """

    name: str
    default_steps: int
    title: str = ""
    """Name for users; empty to use ``name``."""
    default_guidance: float | None = None
    """Default guidance scale of speech; None if it cannot be chosen, and is that of training."""


def make_samplers(
    *names: str, steps: int, guidance: float | None = None
) -> tuple[SamplerChoice, ...]:
    """Make the samplers of one system, with the same default steps and guidance scale."""
    return tuple(SamplerChoice(name, steps, SAMPLER_TITLES[name], guidance) for name in names)


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """Sampling options of a user; None stands for the system's default."""

    sampler: str | None = None
    """Name of one of the system's samplers."""
    steps: int | None = None
    guidance: float | None = None
    """Guidance scale of the speech (`model.sampling.flow`): 1 is the network as trained, 0 ignores
    speech. Any value other than 1 doubles the batch of the network."""

    def __post_init__(self) -> None:
        if self.steps is not None and self.steps < 1:
            raise ValueError(f"steps is {self.steps}; at least 1 is needed.")
        if self.guidance is not None and not 0 <= self.guidance <= 10:
            raise ValueError(f"guidance is {self.guidance}; it must lie between 0 and 10.")


DEFAULT_SAMPLING = Sampling()


def noise_seed_of_clip(user_seed: int, key: str) -> int:
    """Compute the noise seed of a clip, 0 to 2**31 - 1, from the user's seed and a key.

    The key is the clip's name, or the SHA-256 of a run's speech file. All systems have the same
    seed for a clip; two clips that share noise move much alike whatever their speech. The seed
    depends neither on other clips nor on their order.
    """
    digest = hashlib.sha256(f"{user_seed} {key}".encode()).digest()
    return int.from_bytes(digest[:4], "little") >> 1
