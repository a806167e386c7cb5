"""The ways from noise to motion that a person may choose, and the seed of that noise, known without
torch.
"""

import hashlib
from dataclasses import dataclass
from typing import Literal, get_args

FlowSampler = Literal["euler", "heun", "reinterpolate"]
FLOW_SAMPLERS: tuple[FlowSampler, ...] = get_args(FlowSampler)
"""As `model.sampling.flow.sample` defines them."""
SAMPLER_TITLES = {
    "euler": "Euler (first order)",
    "heun": "Heun (second order)",
    "reinterpolate": "Official re-interpolation",
    "ddim": "DDIM",
    "posterior": "Drawn from the posterior (few-step generators)",
    "lcm": "LCM",
}
"""What a person calls those of the families here."""


class UnknownNameError(ValueError):
    """A system, speaker or sampler that does not exist; the message lists those that do."""


@dataclass(frozen=True)
class Sampler:
    """A way from noise to motion that a person may choose."""

    name: str
    steps: int
    """Where nothing else is asked for."""
    title: str = ""
    """What a person calls it; empty for its name."""
    guidance: float | None = None
    """The usual strength of the speech; None where it cannot be chosen, and is that of training."""


def titled(*names: str, steps: int, strength: float | None = None) -> tuple[Sampler, ...]:
    """Samplers of one system, which takes as many steps by each and hears as strongly."""
    return tuple(Sampler(name, steps, SAMPLER_TITLES[name], strength) for name in names)


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """How motion is drawn, as a user may ask; what is None is as a system usually has it."""

    sampler: str | None = None
    """One of the system's own."""
    steps: int | None = None
    guidance: float | None = None
    """Strength of the speech (`model.sampling.flow`): 1 is the network as trained, 0 is deaf. Any
    other than 1 asks the network for a batch of two."""

    def __post_init__(self) -> None:
        if self.steps is not None and self.steps < 1:
            raise ValueError(f"steps is {self.steps}; at least 1 is needed.")
        if self.guidance is not None and not 0 <= self.guidance <= 10:
            raise ValueError(f"guidance is {self.guidance}; it must lie between 0 and 10.")


USUAL = Sampling()


def clip_seed(seed: int, name: str) -> int:
    """Compute the noise seed of one clip, 0 to 2**31 - 1, from the seed asked for and what names
    the clip: the SHA-256 of its speech file in a run, its name in studies and evaluations.

    Systems with the same noise seed are compared on the same noise; two clips that share noise move
    much alike whatever is said in them. Neither the other clips nor their order play a part.
    """
    digest = hashlib.sha256(f"{seed} {name}".encode()).digest()
    return int.from_bytes(digest[:4], "little") >> 1
