"""Systems, samplers and settings of AsynFusion."""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from model.generation.family import Family
from model.motion.spaces import AXIS_ANGLE_MOTION_DIM
from model.networks.config import BranchConfig
from model.sampling.samplers import make_samplers
from model.training.config import PAPER, SMOKE, TrainConfig

DDIM, LCM_SYNC, LCM_ASYNC = "asynfusion/ddim", "asynfusion/lcm-sync", "asynfusion/lcm-async"
SYSTEMS = DDIM, LCM_SYNC, LCM_ASYNC
FACE_SHARE = {DDIM: 1.0, LCM_SYNC: 1.0, LCM_ASYNC: 0.5}
"""Sampling steps of the face as a share of the body's."""

TrainingTarget = Literal["noise", "teacher"]
"""Training target: the noise (eq. 12), or consistency with a teacher."""


@dataclass(frozen=True)
class DualBranchConfig(BranchConfig):
    """Shape of the two branches: as wide and deep as those of the bundled ablation."""

    width: int = 96
    num_blocks: int = 2
    num_heads: int = 3
    speech_context: int = 20

    @property
    def gesture_dim(self) -> int:
        """Channels of the body: 55 rotations as axis-angle, and the root position."""
        return AXIS_ANGLE_MOTION_DIM


@dataclass(frozen=True)
class AsynFusionLossWeights:
    """Weights of the terms of eq. 15."""

    noise: float = 10.0
    velocity: float = 1.0
    huber: float = 1.0
    huber_delta: float = 1.0
    """Error (normalised) at which eq. 14 turns from squared to absolute; not in the paper."""


@dataclass(frozen=True)
class AsynFusionTrainConfig(TrainConfig):
    """Settings of a training of the two branches, by noise or by distillation."""

    network: DualBranchConfig = field(default_factory=DualBranchConfig)
    aim: TrainingTarget = "noise"
    """Training target; the key in weight cards."""
    loss: AsynFusionLossWeights = field(default_factory=AsynFusionLossWeights)
    independent_steps_share: float = 0.5
    """Share of samples with independent steps of the branches, as in sampling the face with fewer
    steps; the paper does not mention it."""
    solver_steps: int = 50
    """Teacher's steps from noise to motion: a student agrees with itself one of them earlier. 1,000
    / 50 is the skipping step of Luo et al. (2023)."""
    teacher_guidance: float = 2.5
    """Guidance scale of the teacher's gesture (as in Luo et al. 2023), which the student learns."""

    def __post_init__(self) -> None:
        if self.aim not in get_args(TrainingTarget):
            raise ValueError(f"aim is {self.aim!r}; use {' or '.join(get_args(TrainingTarget))}.")


def presets(system: str) -> dict[str, AsynFusionTrainConfig]:
    """Return the settings by name; those of `LCM_SYNC` distil `DDIM`."""
    config = AsynFusionTrainConfig(
        system=system,
        batch_size=64,
        steps=9400,
        learning_rate=8e-4,
        ema_decay=0.998,
        save_every=500,
        validate_every=1000,
    )
    if system == LCM_SYNC:
        config = replace(config, aim="teacher", steps=2000, learning_rate=2e-4, speech_dropout=0.0)
    least = replace(config.network, width=32, num_heads=2)
    large = replace(
        config.network, width=512, num_blocks=8, num_heads=8, conv_kernel=0, speech_dim=1024
    )
    return {
        "demo": config,
        "paper": replace(config, network=large, **PAPER),
        "smoke": replace(config, network=least, **SMOKE),
    }


FAMILY = Family(
    name="asynfusion",
    title="AsynFusion: face and body networks that exchange features",
    systems=SYSTEMS,
    descriptions={
        DDIM: "Two networks side by side, one for the face and one for the body; after every block "
        "each attends to the other's features. 25 diffusion steps each.",
        LCM_SYNC: "The networks of asynfusion/ddim, distilled (latent consistency) to 8 steps "
        "instead of 25.",
        LCM_ASYNC: "The networks of asynfusion/lcm-sync. The face takes 4 steps while the body "
        "takes 8; in between, the body uses the face's latest features.",
    },
    presets=presets,
    package="model.systems.asynfusion",
    display_order=3,
    samplers={
        DDIM: make_samplers("ddim", steps=25, guidance=2.5),
        **dict.fromkeys((LCM_SYNC, LCM_ASYNC), make_samplers("lcm", steps=8, guidance=2.5)),
    },
    shared_weights={LCM_ASYNC: LCM_SYNC},
    representatives=dict.fromkeys(("sampling_steps", "speech_effect"), (LCM_ASYNC,)),
)
