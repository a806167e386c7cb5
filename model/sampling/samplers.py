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
}
"""What a person calls those that several families have."""


class UnknownNameError(ValueError):
    """A system, speaker or sampler that does not exist; the message lists those that do."""


@dataclass(frozen=True)
class Sampler:
    """A way from noise to motion that a person may choose."""

    name: str
    steps: int
    """Where nothing else is asked for."""
    face_steps: int | None = None
    """Of the face, where that is drawn by steps of its own."""
    title: str = ""
    """What a person calls it; empty for its name."""
    guidance: float | None = None
    """The usual strength of the speech; None where it cannot be chosen, and is that of training."""

    def counts(self, steps: int | None, face_steps: int | None) -> tuple[int, int | None]:
        """Steps of the body and of the face, as asked for or as usual; a face of which nothing is
        asked takes its usual share of the body's."""
        taken = steps or self.steps
        if self.face_steps is None:
            return taken, None
        return taken, face_steps or max(1, round(taken * self.face_steps / self.steps))


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """How motion is drawn, as a user may ask; what is None is as a system usually has it."""

    sampler: str | None = None
    """One of the system's own."""
    steps: int | None = None
    face_steps: int | None = None
    """Of systems that draw the face by steps of its own."""
    guidance: float | None = None
    """Strength of the speech (`model.sampling.flow`): 1 is the network as trained, 0 is deaf. Any
    other than 1 asks the network for a batch of two."""

    def __post_init__(self) -> None:
        for name in ("steps", "face_steps"):
            count = getattr(self, name)
            if count is not None and count < 1:
                raise ValueError(f"{name} is {count}; at least 1 is needed.")
        if self.guidance is not None and not 0 <= self.guidance <= 10:
            raise ValueError(f"guidance is {self.guidance}; it must lie between 0 and 10.")


USUAL = Sampling()


def clip_seed(seed: int, name: str) -> int:
    """The seed of one clip, 0 to 2**31 - 1, from that of the set and the clip's name.

    Systems that get the same one are compared on the same noise; two clips that share noise move
    much alike whatever is said in them.
    """
    digest = hashlib.sha256(f"{seed} {name}".encode()).digest()
    return int.from_bytes(digest[:4], "little") >> 1
