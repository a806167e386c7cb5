"""The authors' masked variational autoencoders, whose codes their temporal constraint compares."""

from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from model.systems.official.layers import Positions
from model.systems.official.sizes import MOTION_DIM

WIDTH = 256
LATENT_DIM = 128
NUM_LAYERS = 6
NUM_HEADS = 8


class ResidualBlock(nn.Module):
    """Two convolutions over time, each behind a norm, added to what came in."""

    def __init__(self) -> None:
        super().__init__()
        self.bn1 = nn.BatchNorm1d(WIDTH)
        self.bn2 = nn.BatchNorm1d(WIDTH)
        self.conv1 = nn.Conv1d(WIDTH, WIDTH, 3, padding=1)
        self.conv2 = nn.Conv1d(WIDTH, WIDTH, 3, padding=1)

    def forward(self, x: Float[Tensor, "B width T"]) -> Float[Tensor, "B width T"]:
        """As many frames as came in."""
        inner = self.conv1(torch.nn.functional.silu(self.bn1(x)))
        return x + self.conv2(torch.nn.functional.silu(self.bn2(inner)))


def _layers() -> nn.TransformerEncoder:
    layer = nn.TransformerEncoderLayer(WIDTH, NUM_HEADS, 4 * WIDTH, dropout=0.1, batch_first=True)
    return nn.TransformerEncoder(layer, NUM_LAYERS, enable_nested_tensor=False)


def _over_time(
    layers: nn.Module, tokens: Float[Tensor, "B T width"]
) -> Float[Tensor, "B tokens width"]:
    return layers(tokens.transpose(1, 2)).transpose(1, 2)


class Encoder(nn.Module):
    """Frames to means and log variances, fewer of them than frames."""

    def __init__(self, resnets: nn.Sequential) -> None:
        super().__init__()
        self.in_prj = nn.Linear(WIDTH, WIDTH)
        self.pe = Positions(WIDTH)
        self.resnets = resnets
        self.encoders = _layers()
        self.out_prj = nn.Linear(WIDTH, 2 * LATENT_DIM)

    def forward(self, frames: Float[Tensor, "B T width"]) -> Float[Tensor, "B tokens 256"]:
        """Mean, then log variance, of each code."""
        tokens = _over_time(self.resnets, self.in_prj(frames))
        return self.out_prj(self.encoders(self.pe(tokens)))


class Decoder(nn.Module):
    """Codes to motion."""

    def __init__(self, resnets: nn.Sequential) -> None:
        super().__init__()
        self.in_prj = nn.Linear(LATENT_DIM, WIDTH)
        self.pe = Positions(WIDTH)
        self.encoders = _layers()
        self.resnets = resnets
        self.out_prj = nn.Linear(WIDTH, MOTION_DIM)

    def forward(self, codes: Float[Tensor, "B tokens 128"]) -> Float[Tensor, "B T 333"]:
        """Motion of as many frames as the codes stand for."""
        tokens = self.encoders(self.pe(self.in_prj(codes)))
        return self.out_prj(_over_time(self.resnets, tokens))


class OfficialMaskedVAE(nn.Module):
    """Motion to codes and back; frames can be hidden from it.

    Args:
        kind: 2 has half as many codes as frames, 3 a quarter.
    """

    def __init__(self, kind: Literal[2, 3]) -> None:
        super().__init__()
        stages, blocks = (1, 3) if kind == 2 else (2, 2)
        down: list[nn.Module] = []
        up: list[nn.Module] = []
        for _ in range(stages):
            down += [*(ResidualBlock() for _ in range(blocks)), nn.MaxPool1d(2)]
            up += [nn.Upsample(scale_factor=2), *(ResidualBlock() for _ in range(blocks))]
        self.mask_val = nn.Parameter(torch.randn(1, 1, WIDTH))
        self.E = Encoder(nn.Sequential(*down))
        self.D = Decoder(nn.Sequential(*up))
        self.in_prj = nn.Linear(MOTION_DIM, WIDTH)

    def encode(
        self, motion: Float[Tensor, "B T 333"], hidden: Bool[Tensor, "B T"] | None = None
    ) -> Float[Tensor, "B tokens 256"]:
        """Mean, then log variance, of each code.

        Args:
            hidden: frames that it does not see.
        """
        frames = self.in_prj(motion)
        if hidden is not None:
            frames = torch.where(hidden[..., None], self.mask_val, frames)
        return self.E(frames)

    def forward(
        self, motion: Float[Tensor, "B T 333"], hidden: Bool[Tensor, "B T"] | None = None
    ) -> Float[Tensor, "B T 333"]:
        """The motion as its mean codes tell it."""
        return self.D(self.encode(motion, hidden)[..., :LATENT_DIM])
