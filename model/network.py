"""The motion network: two branches (hands, torso) that predict clean motion x_1 from noisy x_t."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from model.config import NetworkConfig
from model.layers import MotionBlock, TimeEmbedding, sinusoidal_positions
from model.packing import HAND_CHANNELS, MOTION_DIM, TORSO_CHANNELS


class MotionBranch(nn.Module):
    """One region's stack of motion generation blocks.

    Its input fuses x_t of the region, x_t of the whole body with the expression, and speech
    (GlobalDiff eq. 6; each is projected first, as in the official code).
    """

    def __init__(self, config: NetworkConfig, num_channels: int) -> None:
        super().__init__()
        width = config.width
        self.region_in = nn.Linear(num_channels, width)
        self.body_in = nn.Linear(MOTION_DIM + config.expression_dim, width)
        self.fuse = nn.Linear(3 * width, width)
        self.seed_in = nn.Linear(num_channels, width)
        self.no_seed = nn.Parameter(0.02 * torch.randn(config.seed_frames, width))
        self.seed_to_condition = nn.Linear(width, width)
        self.blocks = nn.ModuleList(
            MotionBlock(width, config.num_heads, config.feedforward_ratio, config.conv_kernel)
            for _ in range(config.num_blocks)
        )
        self.norm_out = nn.LayerNorm(width)
        self.out = nn.Linear(width, num_channels)
        nn.init.zeros_(self.out.weight)  # start at the mean pose, which normalisation puts at zero
        nn.init.zeros_(self.out.bias)

    def forward(
        self,
        region: Float[Tensor, "B T channels"],
        body: Float[Tensor, "B T all_channels"],
        speech: Float[Tensor, "B T width"],
        seed: Float[Tensor, "B S channels"],
        has_seed: Bool[Tensor, " B"],
        condition: Float[Tensor, "B width"],
        positions: Float[Tensor, "T width"],
    ) -> Float[Tensor, "B T channels"]:
        x = self.fuse(torch.cat([self.region_in(region), self.body_in(body), speech], dim=-1))
        x = x + positions
        seed_tokens = torch.where(has_seed[:, None, None], self.seed_in(seed), self.no_seed)
        seed_tokens = seed_tokens + positions[: seed.shape[1]]
        condition = condition + self.seed_to_condition(seed_tokens.mean(1))
        for block in self.blocks:
            x = block(x, seed_tokens, condition)
        return self.out(self.norm_out(x))


class MotionNetwork(nn.Module):
    """Predicts x_1 (normalised motion) from x_t, time, speech, expression, seed and speaker."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        width = config.width
        self.time = TimeEmbedding(width)
        self.speaker = nn.Embedding(config.num_speakers, 64)
        self.condition = nn.Sequential(
            nn.Linear(width + 64, width), nn.SiLU(), nn.Linear(width, width)
        )
        self.speech = nn.Sequential(
            nn.Linear(config.speech_dim, width), nn.SiLU(), nn.Linear(width, width)
        )
        self.no_speech = nn.Parameter(torch.zeros(config.speech_dim))
        self.hands = MotionBranch(config, len(HAND_CHANNELS))
        self.torso = MotionBranch(config, len(TORSO_CHANNELS))
        self.register_buffer(
            "positions", sinusoidal_positions(config.window_frames, width), persistent=False
        )

    def forward(
        self,
        x_t: Float[Tensor, "B T 333"],
        t: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B T speech_dim"],
        expression: Float[Tensor, "B T expression_dim"],
        seed: Float[Tensor, "B S 333"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T 333"]:
        """Clean motion x_1.

        Args:
            t: flow time, 0 (noise) to 1 (data).
            seed: the clean first ``S`` frames; ignored where ``has_seed`` is false.
            speaker: index into the speaker table; 0 is "no speaker".
            has_speech: false hides speech and expression (for guidance).
        """
        visible = has_speech[:, None, None]
        speech = torch.where(visible, speech, self.no_speech)
        expression = torch.where(visible, expression, torch.zeros_like(expression))
        condition = self.condition(torch.cat([self.time(t), self.speaker(speaker)], dim=-1))
        speech_tokens = self.speech(speech)
        body = torch.cat([x_t, expression], dim=-1)
        x_1 = torch.empty_like(x_t)
        for branch, channels in ((self.hands, HAND_CHANNELS), (self.torso, TORSO_CHANNELS)):
            predicted = branch(
                x_t[..., channels],
                body,
                speech_tokens,
                seed[..., channels],
                has_seed,
                condition,
                self.positions,
            )
            x_1[..., channels] = predicted.to(x_1.dtype)  # it is bf16 under autocast
        return x_1
