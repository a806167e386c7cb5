"""Settings of networks, losses and training: frozen, validated, saved as JSON with the weights."""

import json
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal, TypeVar, get_args, get_type_hints

T = TypeVar("T")

RotationSpace = Literal["local", "global"]


@dataclass(frozen=True)
class NetworkConfig:
    """Shape of the two-branch motion network (GlobalDiff, "Overall Structure")."""

    rotation_space: RotationSpace = "global"
    """Frame of the predicted joint rotations: in the parent, or in the world (GlobalDiff)."""
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

    def __post_init__(self) -> None:
        if self.rotation_space not in get_args(RotationSpace):
            raise ValueError(f"rotation_space is {self.rotation_space!r}; use local or global.")
        if self.width % self.num_heads:
            raise ValueError(f"width {self.width} is no multiple of num_heads {self.num_heads}.")
        if not 0 < self.seed_frames < self.window_frames:
            raise ValueError(
                f"seed_frames is {self.seed_frames}; it must lie between 1 and window_frames - 1."
            )

    @property
    def window_advance(self) -> int:
        """Frames from the start of one window to the start of the next (60 - 8 = 52)."""
        return self.window_frames - self.seed_frames


@dataclass(frozen=True)
class ExpressionConfig:
    """Shape of the expression network: a shallow Transformer encoder over speech and speaker."""

    width: int = 128
    num_layers: int = 3
    num_heads: int = 4
    conv_kernel: int = 9
    speech_dim: int = 68
    expression_dim: int = 52
    num_speakers: int = 31
    window_frames: int = 60


@dataclass(frozen=True)
class LossConfig:
    """Weights of the training terms. Positions are in metres, differences per frame."""

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
    time_weight_floor: float | None = 0.1
    """Weigh a sample by 1 / ((1 - t)^2 + floor), scaled to mean 1, so that late steps of the flow,
    which decide how smooth the motion is, count as much as early ones. None: equal weights."""


@dataclass(frozen=True)
class TrainConfig:
    """One training run, complete."""

    system: str = "globaldiff/global"
    network: NetworkConfig = field(default_factory=NetworkConfig)
    expression: ExpressionConfig = field(default_factory=ExpressionConfig)
    encoder: str = "mel64"
    """Speech encoder by name (`model.speech`)."""
    augment_speech: bool = True
    """Vary level, colour and background noise of the features, as microphones do."""
    loss: LossConfig = field(default_factory=LossConfig)
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
    nested = {
        name: from_dict(hints[name], value) if is_dataclass(hints[name]) else value
        for name, value in values.items()
    }
    return cls(**nested)


def named_config(name: str, system: str) -> TrainConfig:
    """The settings called ``name`` for one system of the ladder or the ``expression`` network.

    Args:
        name: ``demo`` is the bundled size, ``smoke`` trains for a minute.

    Raises:
        ValueError: if either name is unknown; the message lists the valid ones.
    """
    if system not in SYSTEMS and system != "expression":
        raise ValueError(
            f"There is no system {system!r}; choose one of {', '.join(SYSTEMS)}, expression."
        )
    config = TrainConfig(system=system)
    if system == "expression":
        config = replace(config, steps=3000, batch_size=32, learning_rate=1e-3)
    else:
        config = replace(config, network=replace(config.network, rotation_space=SYSTEMS[system]))
    match name:
        case "demo":
            return config
        case "smoke":
            network = replace(config.network, width=48, num_blocks=1, num_heads=2)
            expression = replace(config.expression, width=32, num_layers=1, num_heads=2)
            return replace(
                config,
                network=network,
                expression=expression,
                steps=40,
                batch_size=4,
                warmup_steps=5,
                save_every=20,
                validate_every=20,
            )
    raise ValueError(f"There is no config {name!r}; choose one of demo, smoke.")


SYSTEMS: dict[str, RotationSpace] = {
    "globaldiff/local": "local",
    "globaldiff/global": "global",
}
"""Rotation space of each system, in the order in which the paper's Table 2 builds them up."""
