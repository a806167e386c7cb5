"""The GAN's systems, samplers and settings."""

from dataclasses import dataclass, field, replace

from model.generation.family import Family
from model.motion.spaces import AXIS_ANGLE_MOTION_DIM
from model.networks.config import BranchConfig
from model.sampling.samplers import titled
from model.training.config import SMOKE, GeometricWeights, TrainConfig

SYSTEMS: dict[str, int] = {"gan/20": 20, "gan/10": 10, "gan/5": 5}
"""Steps of each; 20 is the paper's demo."""
WEIGHTS = "gan/20"
"""Whose weights all of them move with."""
STEP_COUNTS = (1, 5, 10, 20, 30, 50)
"""Numbers of steps of the paper's Table 4."""


@dataclass(frozen=True)
class GeneratorConfig(BranchConfig):
    """Shape of the generator: the size of a rung of GlobalDiff's bundled ladder."""

    width: int = 96
    num_blocks: int = 2
    num_heads: int = 3
    speech_context: int = 20
    """As much as the face hears, so that it costs no further delay."""
    channels: int = AXIS_ANGLE_MOTION_DIM


@dataclass(frozen=True)
class DiscriminatorConfig:
    """Shape of the discriminator's seven layers."""

    frame_width: int = 64
    """Numbers for each frame after the first layer."""
    width: int = 256
    """Numbers for each window after the others."""
    groups: int = 8


@dataclass(frozen=True)
class GanLoss:
    """What generator and discriminator descend."""

    adversarial: float = 1.0
    geometric: float = 10.0
    """Of the explicit loss on x_0: the paper's lambda. 0 leaves the adversary alone."""
    terms: GeometricWeights = field(
        default_factory=lambda: GeometricWeights(
            simple=1.0, position=5.0, velocity=15.0, acceleration=15.0, contact=0.25, rooted=True
        )
    )
    """Shares of the explicit loss. The paper's is ``simple`` alone, here the Huber error of
    normalised channels; the others are what `workbench/priorflow` trains with."""
    spread: float = 0.1
    """Share of the explicit loss that is the likelihood of x_0 as it is drawn: it fits the
    deviation, and keeps the mean exact where the prior leaves little open, as no other does."""
    time_weight_floor: float | None = 0.1
    """See `model.sampling.flow.time_weight`; by the flow time of a diffusion time."""
    gradient_penalty: float = 0.05
    """R1: half the squared gradient of the score at real samples, times this."""


@dataclass(frozen=True)
class GanConfig(TrainConfig):
    """One training of generator and discriminator."""

    generator: GeneratorConfig = field(default_factory=GeneratorConfig)
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    loss: GanLoss = field(default_factory=GanLoss)
    step_counts: tuple[int, ...] = STEP_COUNTS
    """Each window is denoised as in a sampling of so many steps; every count is as likely."""
    discriminator_learning_rate: float = 1e-3
    betas: tuple[float, float] = (0.5, 0.999)


def presets(system: str) -> dict[str, GanConfig]:
    """Settings by name: ``demo`` trained the bundled weights, ``smoke`` takes a minute."""
    config = GanConfig(
        system=system, steps=3000, batch_size=32, learning_rate=8e-4, clip_norm=10.0,
        ema_decay=0.998, save_every=250, validate_every=1000,
    )  # fmt: skip
    least = replace(config.generator, width=32, num_blocks=1, num_heads=2)
    return {"demo": config, "smoke": replace(config, generator=least, **SMOKE)}


_FASTEST = min(SYSTEMS, key=lambda name: SYSTEMS[name])

FAMILY = Family(
    name="gan",
    title="Few large steps that a discriminator taught",
    systems=tuple(SYSTEMS),
    about={
        name: f"Drawn in {steps} large denoising steps, trained against a discriminator."
        for name, steps in SYSTEMS.items()
    },
    presets=presets,
    package="model.systems.gan",
    place=4,
    samplers={
        name: titled("posterior", "ddim", steps=steps, strength=3.0)
        for name, steps in SYSTEMS.items()
    },
    usual=dict.fromkeys(("steps", "hearing", "hearing-tab", "live"), (_FASTEST,)),
    shared_weights={name: WEIGHTS for name in SYSTEMS if name != WEIGHTS},
)
