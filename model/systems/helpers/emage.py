"""EMAGE's encoder (Liu et al. 2024), used for FGD in papers on BEAT2, if the user has its file.

Nothing of it is bundled. The network is reimplemented from the authors' public evaluation code
(PantoMatrix, ``AESKConv_240_100.bin``): four convolutions over time that halve the frames, each
over the bones within two steps along the skeleton. Between them bones are averaged in pairs. The
file contains the neighbours and pairs of bones, as masks and matrices.
"""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from model.motion.motion import Motion
from model.motion.rotations import rot6d_from_matrix
from model.storage.checkpoint import check_tensors, read_torch_checkpoint

CODE_DIM = 240
"""Size of a code: 12 for each of 20 chains of bones."""
FRAMES_PER_CODE = 16
WHOLE_FRAMES = 32
"""Multiple to which a clip's frames are cut, as in EMAGE's evaluation."""
COVARIANCE_OFFSET = 1e-6
"""Offset on the diagonals of both covariances under the root, as in EMAGE's evaluation."""
_INPUT_DIM = 330
_LEVELS: tuple[tuple[int, int, int | None], ...] = (
    (_INPUT_DIM, 330, 210),
    (210, 210, 120),
    (120, CODE_DIM, None),
    (CODE_DIM, CODE_DIM, None),
)
"""Channels in, out and pooled: 55, 35 and 20 bones of 6, finally 12, each."""
_NUM_GROUPS = 10
_UNUSED = ("decoder.", "fc_mu.", "fc_logvar.")


class MaskedConv(nn.Module):
    """Convolution over time with weights that are zero outside a mask."""

    def __init__(self, channels_in: int, channels_out: int, width: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(channels_out, channels_in, width))
        self.bias = nn.Parameter(torch.zeros(channels_out))
        self.register_buffer("mask", torch.ones(channels_out, channels_in, width))
        self._padding = (width - 1) // 2

    def forward(self, frames: Float[Tensor, "n in_dim T"]) -> Float[Tensor, "n out half"]:
        """Apply the convolution with zero padding; halves the number of frames."""
        weight = self.weight * self.get_buffer("mask")
        return nn.functional.conv1d(frames, weight, self.bias, stride=2, padding=self._padding)


class BonePool(nn.Module):
    """Average pooling of bones by a matrix."""

    def __init__(self, channels: int, pooled: int) -> None:
        super().__init__()
        self.register_buffer("weight", torch.zeros(pooled, channels))

    def forward(self, frames: Float[Tensor, "n in_dim T"]) -> Float[Tensor, "n pooled T"]:
        """Pool the channels of each frame."""
        return self.get_buffer("weight") @ frames


class EmageFgdLevel(nn.Module):
    """Parallel convolutions of four frames and of one, pooled together.

    The first has group normalisation over groups of channels *and all frames of the clip*.
    """

    def __init__(self, channels_in: int, channels_out: int, pooled: int | None) -> None:
        super().__init__()
        self.residual = nn.Sequential(
            MaskedConv(channels_in, channels_out, 4), nn.GroupNorm(_NUM_GROUPS, channels_out)
        )
        self.shortcut = MaskedConv(channels_in, channels_out, 1)
        pools = [] if pooled is None else [BonePool(channels_out, pooled)]
        self.common = nn.Sequential(*pools, nn.Tanh())

    def forward(self, frames: Float[Tensor, "n in_dim T"]) -> Float[Tensor, "n out half"]:
        """Apply the level; halves the number of frames."""
        return self.common(self.residual(frames) + self.shortcut(frames))


class EmageEncoder(nn.Module):
    """Encoder of 6D rotations of the 55 joints to codes, one for every 16 frames."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.ModuleList(nn.Sequential(EmageFgdLevel(*level)) for level in _LEVELS)

    def forward(self, rotations: Float[Tensor, "n T 330"]) -> Float[Tensor, "n codes 240"]:
        """Encode whole clips; the number of frames must be a multiple of 16."""
        frames = rotations.mT
        for level in self.layers:
            frames = level(frames)
        return frames.mT


def load_emage_encoder(path: Path) -> EmageEncoder:
    """Load the encoder from EMAGE's file, which also holds an unused decoder."""
    tensors = read_torch_checkpoint(path)
    network = EmageEncoder()
    wanted = {f"encoder.{key}": tensor for key, tensor in network.state_dict().items()}
    weights = {key: tensor for key, tensor in tensors.items() if not key.startswith(_UNUSED)}
    check_tensors(
        wanted,
        weights,
        path.name,
        "EMAGE's encoder",
        "AESKConv_240_100.bin from EMAGE's evaluation tools",
    )
    network.load_state_dict({key.removeprefix("encoder."): each for key, each in weights.items()})
    return network.eval().requires_grad_(False)


@torch.inference_mode()
def emage_codes(encoder: EmageEncoder, motion: Motion) -> Float[np.ndarray, "codes 240"]:
    """Compute the codes of a clip, cut to a multiple of 32 frames; empty for a shorter one.

    The input is the local rotations of all 55 joints, as the first two rows of each matrix; neither
    translation nor expressions.
    """
    whole = motion.num_frames - motion.num_frames % WHOLE_FRAMES
    if not whole:
        return np.zeros((0, CODE_DIM), np.float32)
    rotations = rot6d_from_matrix(motion.local_rotations()[:whole]).flatten(1)
    return encoder(rotations.float()[None])[0].numpy()
