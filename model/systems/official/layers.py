"""Parts that the authors' networks share. Attributes are named as in their files."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from model.systems.official.sizes import NUM_SPEAKERS, SPEAKER_DIM


class _Frequencies(nn.Module):
    """What a file holds of a positional encoding."""

    inv_freq: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        powers = torch.arange(0, width, 2).float() / width
        self.register_buffer("inv_freq", 1.0 / 10000.0**powers)


class Positions(nn.Module):
    """Sinusoids of the frame's number: sine in the even channels, cosine in the odd ones."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.penc = _Frequencies(width)

    def forward(self, tokens: Float[Tensor, "B T width"]) -> Float[Tensor, "B T width"]:
        """The tokens with their positions added, from 0."""
        inv_freq = self.penc.inv_freq
        number = torch.arange(tokens.shape[1], device=tokens.device, dtype=inv_freq.dtype)
        angle = number[:, None] * inv_freq
        return tokens + torch.stack([angle.sin(), angle.cos()], dim=-1).flatten(-2)


class SpeakerEmbedding(nn.Module):
    """A speaker's number to a vector; 0 is no speaker."""

    def __init__(self) -> None:
        super().__init__()
        self.mlp = nn.Sequential(
            nn.Linear(NUM_SPEAKERS, 2 * SPEAKER_DIM),
            nn.SiLU(),
            nn.Linear(2 * SPEAKER_DIM, SPEAKER_DIM),
        )

    def forward(self, speaker: Int[Tensor, " B"]) -> Float[Tensor, "B 64"]:
        """One vector for each speaker."""
        one_hot = torch.nn.functional.one_hot(speaker, NUM_SPEAKERS)
        return self.mlp(one_hot.to(self.mlp.get_parameter("0.weight")))
