"""The systems of the paper's Table 2 as data, their settings, and our own system's."""

from dataclasses import dataclass, field, replace
from typing import get_args

from model.motion.spaces import Representation, RootMotion, RotationSpace
from model.networks.config import BranchConfig
from model.training.config import PAPER, SMOKE, GeometricWeights, TrainConfig


@dataclass(frozen=True)
class NetworkConfig(BranchConfig):
    """Shape of the two-branch motion network (GlobalDiff, "Overall Structure")."""

    rotation_space: RotationSpace = "global"
    """Global is GlobalDiff's; axis-angle is nearest to Gaussian."""
    prior: bool = False
    """Stand on the linear-Gaussian denoiser (`model.sampling.prior`); the network adds to it."""
    root: RootMotion = "velocity"
    """A body with a place returns to where it is at home."""

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
        super().__post_init__()

    @property
    def motion_dim(self) -> int:
        """Channels of a motion vector: 55 rotations and the root."""
        return 55 * (3 if self.rotation_space == "axis-angle" else 6) + 3


@dataclass(frozen=True)
class GlobalDiffLoss(GeometricWeights):
    """Weights of the training terms; a term of weight 0 is not computed."""

    seed: float = 1.0
    """Extra weight of eq. 7 on the frames that repeat the seed pose."""
    joint: float = 0.0
    """L_j: anchors turned with each joint (GlobalDiff eqs. 8 to 10), metres squared."""
    skeleton: float = 0.0
    """L_s: cosines between bones (GlobalDiff eqs. 11 to 13)."""
    motion: float = 0.0
    """L_m: codes of the frozen variational encoder (GlobalDiff eqs. 14 and 15)."""
    time_weight_floor: float | None = 0.5
    """Weigh a sample by 1 / ((1 - t)^2 + floor), scaled to mean 1, so that late steps of the flow,
    which decide how smooth the motion is, count enough. None: equal weights."""


@dataclass(frozen=True)
class GlobalDiffConfig(TrainConfig):
    """One training of a rung of the ladder, or of our own system."""

    system: str = "globaldiff/global"
    network: NetworkConfig = field(default_factory=NetworkConfig)
    representation: Representation = "normalised"
    loss: GlobalDiffLoss = field(default_factory=GlobalDiffLoss)
    flow_time_power: float = 2.0
    """Flow times are u ** power with u uniform: above 1 there are more early ones, where x_t says
    little and speech has to decide."""


@dataclass(frozen=True)
class Rung:
    """One row of the paper's Table 2: what its training has beyond L_simple and L_pos."""

    rotation_space: RotationSpace
    constraints: tuple[str, ...] = ()
    """Fields of `GlobalDiffLoss` that get their weight from `CONSTRAINT_WEIGHTS`."""


LADDER: dict[str, Rung] = {
    "globaldiff/local": Rung("local"),
    "globaldiff/global": Rung("global"),
    "globaldiff/joint": Rung("global", ("joint",)),
    "globaldiff/skeleton": Rung("global", ("joint", "skeleton")),
    "globaldiff/full": Rung("global", ("joint", "skeleton", "motion")),
}
"""In the order of the paper's Table 2; a rung adds one thing to the one before."""

BEST = "workbench/priorflow"
"""Our own system: the paper's network on a linear-Gaussian prior (`model.sampling.prior`)."""

SYSTEMS: tuple[str, ...] = (BEST, *LADDER)
"""Every motion system there is, in the order in which they are shown."""

CONSTRAINT_WEIGHTS: dict[str, float] = {"joint": 900.0, "skeleton": 5.0, "motion": 0.14}
"""Each gives its constraint a gradient 0.4 times as long as that of the other terms together,
measured on a trained `globaldiff/global`. The official weights suit raw errors, and the paper gives
none; eq. 10 is in metres squared at 5 cm, hence its large factor."""

PAPER_REGIME_WEIGHTS: dict[str, float] = {"joint": 900.0, "skeleton": 3.0, "motion": 0.045}
"""The same rule in the paper's regime, measured there."""


def presets(system: str) -> dict[str, GlobalDiffConfig]:
    """Settings of one system by name: ``paper-regime`` is how the bundled ladder was trained,
    ``demo`` the regime with normalised channels and differences of positions, each also as
    ``-small``; ``paper`` is the size of the paper and the official code, ``smoke`` trains for a
    minute."""
    config = GlobalDiffConfig(system=system)
    if system == BEST:
        config = _best(config)
    else:
        rung = LADDER[system]
        weights = {constraint: CONSTRAINT_WEIGHTS[constraint] for constraint in rung.constraints}
        config = replace(
            config,
            network=replace(config.network, rotation_space=rung.rotation_space),
            loss=replace(config.loss, **weights),
        )
    large = replace(
        config.network, width=384, num_blocks=6, num_heads=8, conv_kernel=0, speech_dim=1024
    )
    least = replace(config.network, width=48, num_blocks=1, num_heads=2)
    found = {"demo": config, "demo-small": _small(config)}
    if system in LADDER:
        regime = _paper_regime(config)
        found |= {"paper-regime": regime, "paper-regime-small": _small(regime)}
    return found | {
        "paper": replace(config, network=large, **PAPER),
        "smoke": replace(config, network=least, **SMOKE),
    }


def _paper_regime(config: GlobalDiffConfig) -> GlobalDiffConfig:
    """The paper's losses and the official code's representation: raw 6D under unit noise, L_simple
    and L_pos, flow times uniform and equal in weight. At a size and length that a processor trains
    from nothing in half an hour: 600,000 windows."""
    rung = LADDER[config.system]
    weights = {name: PAPER_REGIME_WEIGHTS[name] for name in rung.constraints}
    return replace(
        config,
        representation="raw",
        network=replace(config.network, width=96, num_blocks=2, num_heads=3),
        loss=replace(
            config.loss, velocity=0.0, acceleration=0.0, time_weight_floor=None, **weights
        ),
        flow_time_power=1.0,
        batch_size=64,
        steps=9400,
        learning_rate=8e-4,
        save_every=500,
        validate_every=1000,
    )


def _small(config: GlobalDiffConfig) -> GlobalDiffConfig:
    """A size and length of which several training seeds are affordable: 48,000 windows."""
    return replace(
        config,
        network=replace(config.network, width=64, num_blocks=2, num_heads=2),
        batch_size=32,
        steps=1500,
        learning_rate=8e-4,
        ema_decay=0.998,
        save_every=750,
        validate_every=750,
    )


def _best(config: GlobalDiffConfig) -> GlobalDiffConfig:
    """Everything that was found to help; see docs/experiments/priorflow.md."""
    return replace(
        config,
        network=replace(
            config.network, rotation_space="axis-angle", num_blocks=4, prior=True,
            speech_context=40, root="place",
        ),
        loss=replace(
            config.loss, velocity=30.0, acceleration=30.0, contact=0.5, rooted=True, seed=0.0,
            time_weight_floor=0.1,
        ),
        batch_size=64,
        steps=7000,
        learning_rate=1e-3,
        ema_decay=0.998,
        save_every=500,
        validate_every=1000,
    )  # fmt: skip
