"""Shapes of networks that several families build on: frozen and validated."""

from dataclasses import dataclass

from model.motion.spaces import RotationSpace


@dataclass(frozen=True)
class BranchConfig:
    """Shape of a stack of motion blocks, and what it is told."""

    width: int = 192
    num_blocks: int = 3
    num_heads: int = 6
    feedforward_ratio: int = 2
    conv_kernel: int = 7
    """Frames seen by the depthwise temporal convolution of each block; 0 leaves it out, as in the
    paper. It lets a small network learn smooth motion in few steps."""
    speech_dim: int = 68
    expression_dim: int = 52
    num_speakers: int = 31
    """Size of the speaker table; 0 stands for "no speaker"."""
    window_frames: int = 60
    seed_frames: int = 8
    speech_context: int = 0
    """Frames of speech heard before and after the window; 0 as in the paper."""

    def __post_init__(self) -> None:
        if self.width % self.num_heads:
            raise ValueError(f"width {self.width} is no multiple of num_heads {self.num_heads}.")


@dataclass(frozen=True)
class AutoencoderConfig:
    """Shape of the motion autoencoders: the variational one of L_m, and the encoders of Fréchet
    distances."""

    motion_channels: int = 333
    """Numbers of each frame that tell the motion; 0 for a network that sees faces only."""
    face_channels: int = 0
    """Face units of each frame, after the motion."""
    rotation_space: RotationSpace = "global"
    width: int = 96
    blocks_per_scale: int = 2
    latent_dim: int = 32
    """Numbers for each code vector."""
    scales: tuple[int, ...] = (2, 4)
    """Frames under each code vector, one entry for each level of codes; powers of two."""
    mask_share: float = 0.3
    """Share of frames hidden from the encoder in training, so that it learns how motion goes on."""
    kl_weight: float = 1e-4
    """Pull of the codes to a standard normal; 0 makes a plain autoencoder without noise."""

    @property
    def channels(self) -> int:
        """Numbers of each frame."""
        return self.motion_channels + self.face_channels


@dataclass(frozen=True)
class MatchingConfig:
    """Shape of the judge of matched and mismatched speech."""

    speech_dim: int = 68
    speech_width: int = 96
    motion_width: int = 64
    dilations: tuple[int, ...] = (1, 2, 4, 8)
    """One for each block of a tower, in vectors of its track (15 a second)."""
    track_dim: int = 16
    """Numbers of a track at each time."""
