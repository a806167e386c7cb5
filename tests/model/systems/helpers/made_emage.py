"""A file as EMAGE's evaluation has it, of seeded numbers."""

import torch
from torch import Tensor

LEVELS = (330, 330, 210), (210, 210, 120), (120, 240, 0), (240, 240, 0)
"""Channels in, out, and averaged to."""


def emage_tensors(seed: int) -> dict[str, Tensor]:
    """By the names of the public code. Which channels see each other, and which two are averaged,
    is drawn: the file alone tells it."""
    rng = torch.Generator().manual_seed(seed)

    def drawn(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=rng)

    tensors: dict[str, Tensor] = {}
    for place, (into, out, pooled) in enumerate(LEVELS):
        name = f"encoder.layers.{place}.0."
        near = (torch.rand(out, into, 1, generator=rng) < 0.3).float()
        for part, width in (("residual.0.", 4), ("shortcut.", 1)):
            tensors[f"{name}{part}weight"] = drawn(out, into, width) / (width * 60) ** 0.5
            tensors[f"{name}{part}bias"] = 0.1 * drawn(out)
            tensors[f"{name}{part}mask"] = near.repeat(1, 1, width)
        tensors[f"{name}residual.1.weight"] = 0.5 + 0.1 * drawn(out)
        tensors[f"{name}residual.1.bias"] = 0.1 * drawn(out)
        if pooled:
            two = torch.rand(pooled, out, generator=rng).topk(2).indices
            tensors[f"{name}common.0.weight"] = torch.zeros(pooled, out).scatter_(1, two, 0.5)
    tensors["decoder.main.0.model.0.weight"] = drawn(240, 240, 3)
    tensors["fc_mu.bias"] = drawn(240)
    return tensors
