"""The discriminator: whether a step from x_t to an earlier x was the data's."""

from itertools import pairwise

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from model.networks.layers import TimeEmbedding
from model.systems.gan.config import DiscriminatorConfig, GeneratorConfig
from model.systems.gan.generator import features_heard

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
