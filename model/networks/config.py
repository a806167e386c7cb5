"""Validated configurations of networks that several families use."""

from dataclasses import dataclass

from model.motion.spaces import RotationSpace


@dataclass(frozen=True)
class BranchConfig:
    """Shape of a stack of motion blocks and of its inputs."""

    width: int = 192
    num_blocks: int = 3
    num_heads: int = 6
    feedforward_ratio: int = 2
    conv_kernel: int = 7
    """Kernel of each block's temporal convolution (frames); 0 omits it, as in the paper. It lets a
    small network learn smooth motion in few steps."""
    speech_dim: int = 68
    expression_dim: int = 52
    num_speakers: int = 31
    """Size of the speaker table; 0 stands for "no speaker"."""
    window_frames: int = 60
    seed_frames: int = 8
    speech_context: int = 0
    """Frames of speech before and after the window; 0 as in the paper."""

    def __post_init__(self) -> None:
        if self.width % self.num_heads:
            raise ValueError(f"width {self.width} is not a multiple of num_heads {self.num_heads}.")


@dataclass(frozen=True)
class AutoencoderConfig:
    """Shape of an autoencoder: the variational one of L_m, or that of a Fréchet distance."""

    motion_channels: int = 333
    """Motion channels of each frame; 0 for a network of faces only."""
    face_channels: int = 0
    """Blendshapes of each frame, after the motion."""
    rotation_space: RotationSpace = "global"
    width: int = 96
    blocks_per_scale: int = 2
    latent_dim: int = 32
    """Size of each code vector."""
    scales: tuple[int, ...] = (2, 4)
    """Frames under each code vector, one entry for each level of codes; powers of two."""
    mask_share: float = 0.3
    """Share of frames hidden from the encoder in training, so that it learns to continue motion."""
    kl_weight: float = 1e-4
    """Weight of the codes' KL divergence; 0 makes a plain autoencoder without noise."""

    @property
    def channels(self) -> int:
        """Number of channels of each frame."""
        return self.motion_channels + self.face_channels


@dataclass(frozen=True)
class MatchingConfig:
    """Shape of the classifier of matched and mismatched speech."""

    speech_dim: int = 68
    speech_width: int = 96
    motion_width: int = 64
    dilations: tuple[int, ...] = (1, 2, 4, 8)
    """Dilation of each block of a tower, in vectors of its track (15 per second)."""
    track_dim: int = 16
    """Dimension of the vectors over time (tracks) that both towers return."""
