"""The adversary: its network, its losses and penalty, and the watch that stops a collapsed
training."""

from dataclasses import dataclass
from itertools import pairwise

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from model.networks.layers import TimeEmbedding
from model.systems.gan.config import DiscriminatorConfig, GeneratorConfig
from model.systems.gan.generator import features_heard
from model.training.run_folder import TrainingError

PATIENCE = 1000
"""Steps in a row that a training may look collapsed."""
SEPARATED = 0.995
"""Share of right verdicts, on real and on fake steps alike, from which on the discriminator tells
all of them apart, and its gradient says nothing more."""
STILL = 0.05
"""Spread of generated motion over the batch, as a share of the recorded, below which all of it is
one motion."""
FAR = 5.0
MEMORY = 0.98
"""Of the running means that these limits hold for: verdicts on one batch come and go."""


def discriminator_loss(real: Float[Tensor, " B"], fake: Float[Tensor, " B"]) -> Float[Tensor, " B"]:
    """Of scores: real ones shall be positive, fake ones negative."""
    return F.softplus(-real) + F.softplus(fake)


def generator_loss(fake: Float[Tensor, " B"]) -> Float[Tensor, " B"]:
    """Non-saturating: the generator shall be taken for real."""
    return F.softplus(-fake)


def gaussian_loss(
    error: Float[Tensor, "*shape"], deviation: Float[Tensor, "*shape"]
) -> Float[Tensor, ""]:
    """Negative log-likelihood of errors under a deviation of each. Errors beyond `FAR` deviations
    count as those, so that few of them do not decide."""
    ratio = (error / deviation).clamp(-FAR, FAR)
    return (deviation.log() + ratio.square() / 2).mean()


def gradient_penalty(
    scores: Float[Tensor, " B"], real: Float[Tensor, "B T C"]
) -> Float[Tensor, " B"]:
    """R1 (Mescheder et al., 2018): half the squared gradient of the scores at real samples."""
    (slope,) = torch.autograd.grad(scores.sum(), real, create_graph=True)
    return slope.square().sum((1, 2)) / 2


@dataclass
class Watch:
    """Tells when generator and discriminator no longer teach each other."""

    accuracy_real: float = 0.5
    accuracy_fake: float = 0.5
    liveliness: float = 1.0
    separated: int = 0
    """Steps in a row in which the discriminator told everything apart."""
    still: int = 0
    """Steps in a row in which the generator made one motion of all noise and speech."""

    def see(self, numbers: dict[str, float], step: int) -> None:
        """Look at a step's log.

        Raises:
            TrainingError: if it has looked collapsed for `PATIENCE` steps.
        """
        for name in ("accuracy_real", "accuracy_fake", "liveliness"):
            setattr(self, name, MEMORY * getattr(self, name) + (1 - MEMORY) * numbers[name])
        apart = min(self.accuracy_real, self.accuracy_fake) > SEPARATED
        self.separated = self.separated + 1 if apart else 0
        self.still = self.still + 1 if self.liveliness < STILL else 0
        if self.separated >= PATIENCE:
            raise TrainingError(
                f"The training has collapsed at step {step}: for {PATIENCE} steps the "
                f"discriminator has told more than {SEPARATED:.1%} of generated steps from real "
                "ones, and teaches nothing more. Lower its learning rate or raise the gradient "
                "penalty; the last saved state is kept."
            )
        if self.still >= PATIENCE:
            raise TrainingError(
                f"The training has collapsed at step {step}: for {PATIENCE} steps generated "
                f"motion has spread less than {STILL:.0%} of recorded motion. Raise the geometric "
                "weight or lower the learning rates; the last saved state is kept."
            )


NUM_LAYERS = 7
TOLD_WIDTH = 64


class Discriminator(nn.Module):
    """Seven layers (linear, SELU, GroupNorm) on both ends of a step, its times, and what the
    generator was told. The first is shared by all frames, the others see the window at once."""

    def __init__(self, config: DiscriminatorConfig, motion: GeneratorConfig) -> None:
        super().__init__()
        self.now, self.before = TimeEmbedding(TOLD_WIDTH), TimeEmbedding(TOLD_WIDTH)
        self.speaker = nn.Embedding(motion.num_speakers, TOLD_WIDTH)
        self.motion = motion
        # x_before, x_now, the seed where there is one, speech
        self.frame = _layer(3 * motion.channels + motion.heard_dim, config.frame_width, config)
        flat = motion.window_frames * config.frame_width + 3 * TOLD_WIDTH
        widths = [flat] + [config.width] * (NUM_LAYERS - 2)
        self.window = nn.Sequential(*(_layer(a, b, config) for a, b in pairwise(widths)))
        self.score = nn.Linear(config.width, 1)

    def forward(
        self,
        x_before: Float[Tensor, "B T C"],
        x_now: Float[Tensor, "B T C"],
        before: Float[Tensor, " B"],
        now: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B heard speech_dim"],
        seed: Float[Tensor, "B S C"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
    ) -> Float[Tensor, " B"]:
        """Scores, positive for steps held for real."""
        context = self.motion.speech_context
        spoken = features_heard(self.motion, speech[:, context : speech.shape[1] - context])
        spoken = spoken * has_speech[:, None, None]
        known = F.pad(seed * has_seed[:, None, None], (0, 0, 0, x_now.shape[1] - seed.shape[1]))
        frames = self.frame(torch.cat([x_before, x_now, known, spoken], dim=-1).flatten(0, 1))
        told = [self.now(now), self.before(before), self.speaker(speaker)]
        flat = frames.view(len(x_now), -1)
        return self.score(self.window(torch.cat([flat, *told], dim=-1)))[:, 0]


def _layer(inputs: int, outputs: int, config: DiscriminatorConfig) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, outputs), nn.SELU(), nn.GroupNorm(config.groups, outputs)
    )
