"""Systems, samplers and settings of the GAN."""

from dataclasses import dataclass, field, replace

from model.generation.family import Family
from model.motion.spaces import AXIS_ANGLE_MOTION_DIM
from model.networks.config import BranchConfig
from model.sampling.samplers import make_samplers
from model.training.config import SMOKE, GeometricWeights, TrainConfig

STEPS_BY_SYSTEM: dict[str, int] = {"gan/20": 20, "gan/10": 10, "gan/5": 5}
"""Sampling steps of each system; 20 is the paper's demo."""
WEIGHTS = "gan/20"
"""Name of the weights that all of them use."""
TRAINING_STEP_COUNTS = (1, 5, 10, 20, 30, 50)
"""Numbers of steps in the paper's Table 4."""


@dataclass(frozen=True)
class GeneratorConfig(BranchConfig):
    """Shape of the generator: the size of a network in GlobalDiff's bundled ablation."""

    width: int = 96
    num_blocks: int = 2
    num_heads: int = 3
    speech_context: int = 20
    """Frames of speech around the window: as many as for the face, so that they add no delay."""
    channels: int = AXIS_ANGLE_MOTION_DIM


@dataclass(frozen=True)
class DiscriminatorConfig:
    """Shape of the discriminator's seven layers."""

    frame_width: int = 64
    """Channels of each frame after the first layer."""
    width: int = 256
    """Channels of each window after the other layers."""
    groups: int = 8


@dataclass(frozen=True)
class GanLossWeights:
    """Weights of the losses of generator and discriminator."""

    adversarial: float = 1.0
    geometric: float = 10.0
    """Weight of the explicit loss on x_0, the paper's lambda; 0 leaves the adversarial loss alone.
    """
    terms: GeometricWeights = field(
        default_factory=lambda: GeometricWeights(
            simple=1.0, position=5.0, velocity=15.0, acceleration=15.0, contact=0.25, rooted=True
        )
    )
    """Shares of the explicit loss. The paper's is ``simple`` alone, here a Huber error of
    normalised channels; the others are those of `workbench/priorflow`."""
    spread: float = 0.1
    """Weight of the likelihood of sampled x_0 in the explicit loss: it fits the deviation, and
    keeps the mean exact where the prior leaves little open."""
    time_weight_floor: float | None = 0.1
    """Constant in the denominator of `model.sampling.flow.flow_loss_weight`, taken at the flow time
    of a diffusion time; None: equal weights."""
    gradient_penalty: float = 0.05
    """Weight of R1: half the squared gradient of the score at real samples."""


@dataclass(frozen=True)
class GanTrainConfig(TrainConfig):
    """Settings of a training of generator and discriminator."""

    generator: GeneratorConfig = field(default_factory=GeneratorConfig)
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    loss: GanLossWeights = field(default_factory=GanLossWeights)
    step_counts: tuple[int, ...] = TRAINING_STEP_COUNTS
    """Numbers of sampling steps for which windows are denoised, each as likely."""
    discriminator_learning_rate: float = 1e-3
    betas: tuple[float, float] = (0.5, 0.999)
    """AdamW's decay rates of the moments."""


def presets(system: str) -> dict[str, GanTrainConfig]:
    """Return the settings by name: ``demo`` in the size of the bundled weights, or ``smoke``.

    How the bundled weights were trained is in docs/experiments/training.md.
    """
    config = GanTrainConfig(
        system=system, steps=3000, batch_size=32, learning_rate=8e-4, clip_norm=10.0,
        ema_decay=0.998, save_every=250, validate_every=1000,
    )  # fmt: skip
    least = replace(config.generator, width=32, num_blocks=1, num_heads=2)
    return {"demo": config, "smoke": replace(config, generator=least, **SMOKE)}


_FASTEST = min(STEPS_BY_SYSTEM, key=lambda name: STEPS_BY_SYSTEM[name])

FAMILY = Family(
    name="gan",
    title="Conditional GAN that denoises in a few large steps",
    systems=tuple(STEPS_BY_SYSTEM),
    descriptions={
        name: f"Takes {steps} large denoising steps; trained against a discriminator."
        for name, steps in STEPS_BY_SYSTEM.items()
    },
    presets=presets,
    package="model.systems.gan",
    display_order=4,
    samplers={
        name: make_samplers("posterior", "ddim", steps=steps, guidance=3.0)
        for name, steps in STEPS_BY_SYSTEM.items()
    },
    representatives=dict.fromkeys(("sampling_steps", "speech_effect", "streaming"), (_FASTEST,)),
    shared_weights={name: WEIGHTS for name in STEPS_BY_SYSTEM if name != WEIGHTS},
)
