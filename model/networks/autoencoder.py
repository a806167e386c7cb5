"""Convolutional motion autoencoder with codes at several time scales.

As L_m's encoder g (GlobalDiff eq. 14) it is variational and trained with masked frames; as the
encoder of a Fréchet distance it is a plain autoencoder, of the body, the face or both. Fully
convolutional and without normalisation over time: codes do not depend on the length of the clip
around them, nor on the batch.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from model.motion.packing import Normaliser, poses_to_vectors
from model.networks.config import AutoencoderConfig
from model.networks.trained import TrainedWeights

CPU = torch.device("cpu")
CodeDistribution = tuple[Float[Tensor, "B _ dim"], Float[Tensor, "B _ dim"]]
"""Mean and log-variance of the codes at one scale, each (B, tokens, dim)."""


class ResidualBlock(nn.Module):
    """Pre-activated residual block of two convolutions over three frames, the first dilated."""

    def __init__(
        self, width: int, dilation: int = 1, ends: Literal["zeros", "replicate"] = "zeros"
    ) -> None:
        super().__init__()
        self.first = nn.Conv1d(
            width, width, 3, padding=dilation, dilation=dilation, padding_mode=ends
        )
        self.second = nn.Conv1d(width, width, 3, padding=1, padding_mode=ends)
        for parameter in self.second.parameters():
            nn.init.zeros_(parameter)

    def forward(self, x: Float[Tensor, "B width T"]) -> Float[Tensor, "B width T"]:
        return x + self.second(F.silu(self.first(F.silu(x))))


def _blocks(config: AutoencoderConfig) -> nn.Sequential:
    return nn.Sequential(*(ResidualBlock(config.width) for _ in range(config.blocks_per_scale)))


class MotionAutoencoder(nn.Module):
    """Autoencoder of frames (motion, blendshapes or both) with codes at ``config.scales``."""

    def __init__(self, config: AutoencoderConfig) -> None:
        super().__init__()
        self.config = config
        width = config.width
        levels = max(config.scales).bit_length() - 1  # halvings of the frame rate
        self.motion_in = nn.Conv1d(config.channels, width, 1)
        self.hidden_frame = nn.Parameter(torch.zeros(width))
        self.down = nn.ModuleList(
            nn.Sequential(nn.Conv1d(width, width, 4, stride=2, padding=1), _blocks(config))
            for _ in range(levels)
        )
        self.to_code = nn.ModuleDict(
            {str(scale): nn.Conv1d(width, 2 * config.latent_dim, 1) for scale in config.scales}
        )
        self.from_code = nn.ModuleDict(
            {str(scale): nn.Conv1d(config.latent_dim, width, 1) for scale in config.scales}
        )
        self.up = nn.ModuleList(
            nn.Sequential(_blocks(config), nn.ConvTranspose1d(width, width, 4, stride=2, padding=1))
            for _ in range(levels)
        )
        self.motion_out = nn.Conv1d(width, config.channels, 3, padding=1)

    def forward(
        self,
        motion: Float[Tensor, "B T channels"],
        is_hidden: Bool[Tensor, "B T"] | None,
        noise: Sequence[Float[Tensor, "B _ dim"]] | None,
    ) -> tuple[Float[Tensor, "B T channels"], list[CodeDistribution]]:
        """Restore motion from its codes (means without noise), and return both."""
        codes = self.encode(motion, is_hidden)
        drawn = [mean for mean, _ in codes]
        if noise is not None:
            drawn = [
                mean + (log_variance / 2).exp() * draw
                for (mean, log_variance), draw in zip(codes, noise, strict=True)
            ]
        return self.decode(drawn), codes

    def encode(
        self, motion: Float[Tensor, "B T channels"], is_hidden: Bool[Tensor, "B T"] | None = None
    ) -> list[CodeDistribution]:
        """Encode motion at each scale, finest first; a learned vector replaces hidden frames.

        T must be a multiple of the largest scale.
        """
        x = self.motion_in(motion.transpose(1, 2))
        if is_hidden is not None:
            x = torch.where(is_hidden[:, None], self.hidden_frame[:, None], x)
        codes = []
        for level, stage in enumerate(self.down, start=1):
            x = stage(x)
            if 2**level in self.config.scales:
                code = self.to_code[str(2**level)](x).transpose(1, 2)
                mean, log_variance = code.chunk(2, dim=-1)
                codes.append((mean, log_variance.clamp(-10, 5)))
        return codes

    def decode(self, codes: Sequence[Float[Tensor, "B _ dim"]]) -> Float[Tensor, "B T channels"]:
        """Decode motion from one code sequence for each scale, finest first as in `encode`."""
        scales = sorted(self.config.scales)
        by_scale = dict(zip(scales, codes, strict=True))
        x: Tensor | None = None
        for level, stage in zip(range(len(self.up), 0, -1), self.up, strict=True):
            scale = 2**level
            if scale in by_scale:
                added = self.from_code[str(scale)](by_scale[scale].transpose(1, 2))
                x = added if x is None else x + added
            x = stage(x)
        assert x is not None  # the config has at least one scale
        return self.motion_out(F.silu(x)).transpose(1, 2)


def autoencoder_input(
    config: AutoencoderConfig,
    poses: Float[Tensor, "B T 165"],
    transl: Float[Tensor, "B T 3"],
    face: Float[Tensor, "B T units"],
) -> Float[Tensor, "B T channels"]:
    """Convert a motion to the input of an autoencoder of this shape, not normalised.

    Poses are local axis-angle (rad), ``transl`` is the root position (m), and ``face`` has ARKit
    blendshape weights, 0 to 1.
    """
    parts = []
    if config.motion_channels > 0:
        parts.append(poses_to_vectors(config.rotation_space, poses, transl))
    if config.face_channels > 0:
        parts.append(face)
    return torch.cat(parts, dim=-1)


@dataclass(frozen=True)
class FrozenMotionEncoder:
    """Trained encoder with the statistics of its input; its weights are constant."""

    network: MotionAutoencoder
    normaliser: Normaliser
    sha256: str

    def codes(self, vectors: Float[Tensor, "B T channels"]) -> list[Float[Tensor, "B _ dim"]]:
        """Compute the mean codes of `autoencoder_input` at each scale, with their gradients."""
        return [mean for mean, _ in self.network.encode(self.normaliser.normalise(vectors))]


def load_motion_encoder(folder: Path, name: str, device: torch.device = CPU) -> FrozenMotionEncoder:
    """Load ``motion-vae`` or the encoder of a Fréchet distance."""
    trained = TrainedWeights.read(folder, name)
    shape = trained.card.config(AutoencoderConfig, "autoencoder")
    network = trained.load_into(MotionAutoencoder(shape)).to(device)
    return FrozenMotionEncoder(network, trained.normaliser.to(device), trained.sha256)
