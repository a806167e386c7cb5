"""What one training step draws at random, the same however many processes share the batch."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from model.training.parallel import Shard


@dataclass(frozen=True)
class Draws:
    """Draws for each sample of the whole batch, and gives the shard's share of them."""

    size: int
    """Samples of the whole batch."""
    generator: torch.Generator
    shard: Shard

    def noise(self, shape: Sequence[int]) -> Float[Tensor, "B ..."]:
        """Standard normal numbers, of this shape for each sample."""
        return self.shard.of(torch.randn(self.size, *shape, generator=self.generator))

    def flow_times(self, power: float) -> Float[Tensor, " B"]:
        """u ** power with u uniform in [0, 1)."""
        return self.shard.of(torch.rand(self.size, generator=self.generator) ** power)

    def keep(self, dropout: float) -> Bool[Tensor, " B"]:
        """False for that share of the samples."""
        return self.shard.of(torch.rand(self.size, generator=self.generator) >= dropout)
