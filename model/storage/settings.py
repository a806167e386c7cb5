"""Settings of networks, losses and training: frozen, validated, saved as JSON with the weights."""

import json
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from typing import Any, Literal, TypeVar, get_args, get_type_hints

T = TypeVar("T")

RotationSpace = Literal["local", "global", "axis-angle"]
RootMotion = Literal["velocity", "place"]
Representation = Literal["normalised", "raw"]


@dataclass(frozen=True)
class NetworkConfig:
    """Shape of the two-branch motion network (GlobalDiff, "Overall Structure")."""

    rotation_space: RotationSpace = "global"
    """Frame of the predicted joint rotations: in the parent, or in the world (GlobalDiff), both as
    row-6D; or in the parent as axis times angle, which is nearest to Gaussian."""
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
    prior: bool = False
    """Stand on the linear-Gaussian denoiser (`model.sampling.prior`); the network adds to it."""
    speech_context: int = 0
    """Frames of speech heard before and after the window; 0 as in the paper."""
    root: RootMotion = "velocity"
    """Horizontal place of the pelvis: as a velocity, or as the way from where the body is at home,
    to which such a body returns."""

    def __post_init__(self) -> None:
        if self.rotation_space not in get_args(RotationSpace):
            raise ValueError(
                f"rotation_space is {self.rotation_space!r}; use local, global or axis-angle."
            )
        if self.prior != (self.rotation_space == "axis-angle"):
            raise ValueError(
                f"prior is {self.prior} with {self.rotation_space} rotations; a prior stands on "
                "axis-angle, and nothing else does."
            )
        if self.root not in get_args(RootMotion):
            raise ValueError(f"root is {self.root!r}; use velocity or place.")
        if self.width % self.num_heads:
            raise ValueError(f"width {self.width} is no multiple of num_heads {self.num_heads}.")
        if not 0 < self.seed_frames < self.window_frames:
            raise ValueError(
                f"seed_frames is {self.seed_frames}; it must lie between 1 and window_frames - 1."
            )

    @property
    def motion_dim(self) -> int:
        """Channels of a motion vector: 55 rotations and the root."""
        return 55 * (3 if self.rotation_space == "axis-angle" else 6) + 3

    @property
    def window_advance(self) -> int:
        """Frames from the start of one window to the start of the next (60 - 8 = 52)."""
        return self.window_frames - self.seed_frames


@dataclass(frozen=True)
class ExpressionConfig:
    """Shape of the expression network: one branch of motion blocks over face units."""

    width: int = 96
    num_blocks: int = 2
    num_heads: int = 3
    feedforward_ratio: int = 2
    conv_kernel: int = 7
    speech_dim: int = 68
    expression_dim: int = 52
    num_speakers: int = 31
    window_frames: int = 60
    seed_frames: int = 8
    speech_context: int = 20
    """Frames of speech heard before and after the window."""


@dataclass(frozen=True)
class AutoencoderConfig:
    """Shape of the motion autoencoders: the variational one of L_m, and the encoder of FGD."""

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

    def __post_init__(self) -> None:
        powers = {2**k for k in range(1, 7)}
        if not self.scales or not set(self.scales) <= powers:
            raise ValueError(f"scales is {self.scales}; use powers of two from 2 to 64.")
        if not 0 <= self.mask_share < 1:
            raise ValueError(f"mask_share is {self.mask_share}; it must lie in [0, 1).")


@dataclass(frozen=True)
class LossConfig:
    """Weights of the training terms; a term of weight 0 is not computed.

    Positions are in metres, differences per frame.
    """

    simple: float = 1.0
    """GlobalDiff eq. 7, on normalised channels."""
    position: float = 10.0
    """L_pos: joint positions through forward kinematics."""
    velocity: float = 100.0
    """First differences of those positions; in the official code, not in the paper."""
    acceleration: float = 100.0
    """Second differences of those positions; in the official code, not in the paper."""
    seed: float = 1.0
    """Extra weight of eq. 7 on the frames that repeat the seed pose."""
    joint: float = 0.0
    """L_j: anchors turned with each joint (GlobalDiff eqs. 8 to 10), metres squared."""
    skeleton: float = 0.0
    """L_s: cosines between bones (GlobalDiff eqs. 11 to 13)."""
    motion: float = 0.0
    """L_m: codes of the frozen variational encoder (GlobalDiff eqs. 14 and 15)."""
    contact: float = 0.0
    """Horizontal steps of feet that stand still in the recording."""
    rooted: bool = False
    """Take positions and their differences with the pelvis in place; the root has its channels."""
    time_weight_floor: float | None = 0.5
    """Weigh a sample by 1 / ((1 - t)^2 + floor), scaled to mean 1, so that late steps of the flow,
    which decide how smooth the motion is, count enough. None: equal weights."""


@dataclass(frozen=True)
class TrainConfig:
    """One training run, complete."""

    system: str = "globaldiff/global"
    network: NetworkConfig = field(default_factory=NetworkConfig)
    expression: ExpressionConfig = field(default_factory=ExpressionConfig)
    autoencoder: AutoencoderConfig = field(default_factory=AutoencoderConfig)
    encoder: str = "mel64"
    """Speech encoder by name (`model.speech`)."""
    augment_speech: bool = True
    """Vary level, colour and background noise of the features, as microphones do."""
    mirror: float = 0.0
    """Share of windows seen as in a mirror, left and right exchanged. Where speakers are known by
    the hand they prefer, as in the bundled data, it would blur them."""
    augmented_copies: int = 0
    """Copies of each training recording at another speed, heard by another microphone."""
    representation: Representation = "normalised"
    """Motion vectors as the network sees them: every body-part group at unit variance, or, as in
    the official GlobalDiff code, raw 6D (the three root channels normalised all the same)."""
    loss: LossConfig = field(default_factory=LossConfig)
    flow_time_power: float = 2.0
    """Flow times are u ** power with u uniform: above 1 there are more early ones, where x_t says
    little and speech has to decide."""
    steps: int = 8000
    batch_size: int = 16
    learning_rate: float = 4e-4
    warmup_steps: int = 200
    weight_decay: float = 0.01
    clip_norm: float = 1.0
    ema_decay: float = 0.999
    seed_dropout: float = 0.1
    """Share of windows trained without a seed pose, so that a clip can start from nothing."""
    speech_dropout: float = 0.1
    speaker_dropout: float = 0.1
    random_seed: int = 0
    save_every: int = 250
    validate_every: int = 500


def to_json(config: Any) -> str:
    """The config as indented JSON, nested dataclasses as objects."""
    return json.dumps(asdict(config), indent=1)


def from_dict(cls: type[T], values: dict[str, Any]) -> T:
    """Rebuild a (nested) config from parsed JSON.

    Raises:
        ValueError: if a field is unknown to this version.
    """
    if not is_dataclass(cls):
        raise TypeError(f"{cls} is no config.")
    known = {f.name for f in fields(cls)}
    unknown = sorted(set(values) - known)
    if unknown:
        raise ValueError(f"{cls.__name__} has no field {', '.join(unknown)}.")
    hints = get_type_hints(cls)
    return cls(**{name: _restored(hints[name], value) for name, value in values.items()})


def _restored(hint: Any, value: Any) -> Any:
    """A field's value as parsed from JSON, in the type that the field has."""
    if is_dataclass(hint):
        return from_dict(hint, value)  # type: ignore[arg-type]
    return tuple(value) if isinstance(value, list) else value
