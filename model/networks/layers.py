"""Building blocks of the networks: time and position embeddings, attention, the motion block."""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn


def sinusoidal_positions(length: int, width: int) -> Float[Tensor, "length width"]:
    """The Transformer's sine and cosine table."""
    position = torch.arange(length, dtype=torch.float32)[:, None]
    frequency = torch.exp(torch.arange(0, width, 2) * (-math.log(10_000.0) / width))
    table = torch.zeros(length, width)
    table[:, 0::2] = torch.sin(position * frequency)
    table[:, 1::2] = torch.cos(position * frequency)
    return table


class TimeEmbedding(nn.Module):
    """Fourier features of the flow time t in [0, 1], then a small MLP."""

    def __init__(self, width: int, num_frequencies: int = 16) -> None:
        super().__init__()
        self.frequencies: Tensor
        self.register_buffer(
            "frequencies", math.pi * 2.0 ** torch.linspace(-1, 5, num_frequencies), persistent=False
        )
        self.mlp = nn.Sequential(
            nn.Linear(2 * num_frequencies, width), nn.SiLU(), nn.Linear(width, width)
        )

    def forward(self, t: Float[Tensor, " B"]) -> Float[Tensor, "B width"]:
        angle = t[:, None] * self.frequencies
        return self.mlp(torch.cat([angle.sin(), angle.cos()], dim=-1))


class Attention(nn.Module):
    """Multi-head attention of ``x`` to ``memory`` (to itself when memory is ``x``)."""

    def __init__(self, width: int, num_heads: int) -> None:
        super().__init__()
        self.num_heads = num_heads
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(
        self, x: Float[Tensor, "B T width"], memory: Float[Tensor, "B S width"]
    ) -> Float[Tensor, "B T width"]:
        query = self.query(x).unflatten(-1, (self.num_heads, -1)).transpose(1, 2)
        key, value = (
            part.unflatten(-1, (self.num_heads, -1)).transpose(1, 2)
            for part in self.key_value(memory).chunk(2, dim=-1)
        )
        # Written out: for windows this short, torch's fused kernel for CPUs loses more time in its
        # backward pass than it saves.
        scores = query @ key.transpose(-1, -2) * query.shape[-1] ** -0.5  # (B, heads, T, S)
        mixed = scores.softmax(-1).to(value.dtype) @ value  # (B, heads, T, width / heads)
        return self.out(mixed.transpose(1, 2).flatten(-2))


class TemporalConv(nn.Module):
    """Depthwise convolution over frames: a learned filter for each channel."""

    def __init__(self, width: int, kernel: int) -> None:
        super().__init__()
        if kernel % 2 == 0:
            raise ValueError(f"kernel is {kernel}; it must be odd, so that a frame is its centre.")
        self.depthwise = nn.Conv1d(width, width, kernel, padding=kernel // 2, groups=width)
        self.mix = nn.Linear(width, width)

    def forward(self, x: Float[Tensor, "B T width"]) -> Float[Tensor, "B T width"]:
        return self.mix(F.silu(self.depthwise(x.transpose(1, 2)).transpose(1, 2)))


class MotionBlock(nn.Module):
    """Motion generation block (GlobalDiff, after DiT): seed cross-attention, self-attention, a
    temporal convolution and a feed-forward layer, each residual and, but for the first, FiLM
    modulated by the conditioning vector."""

    def __init__(
        self, width: int, num_heads: int, feedforward_ratio: int, conv_kernel: int
    ) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width, elementwise_affine=False)
        self.seed_norm = nn.LayerNorm(width)
        self.seed_attention = Attention(width, num_heads)
        self.attention = Attention(width, num_heads)
        self.conv = TemporalConv(width, conv_kernel) if conv_kernel else None
        inner = feedforward_ratio * width
        self.feedforward = nn.Sequential(
            nn.Linear(width, inner), nn.GELU(), nn.Linear(inner, width)
        )
        film = nn.Linear(width, (9 if self.conv else 6) * width)
        nn.init.zeros_(film.weight)
        nn.init.zeros_(film.bias)
        self.modulation = nn.Sequential(nn.SiLU(), film)

    def forward(
        self,
        x: Float[Tensor, "B T width"],
        seed: Float[Tensor, "B S width"],
        condition: Float[Tensor, "B width"],
    ) -> Float[Tensor, "B T width"]:
        films = iter(self.modulation(condition)[:, None].chunk(9 if self.conv else 6, dim=-1))

        def film(layer, x: Tensor) -> Tensor:
            scale, shift, gate = next(films), next(films), next(films)
            return x + (1 + gate) * layer(self.norm(x) * (1 + scale) + shift)

        x = x + self.seed_attention(self.seed_norm(x), seed)
        x = film(lambda h: self.attention(h, h), x)
        if self.conv is not None:
            x = film(self.conv, x)
        return film(self.feedforward, x)
