"""Networks over windows of frames, from embeddings and attention to a branch with a prior."""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor, nn

from model.networks.config import BranchConfig
from model.sampling.prior import GaussianPrior


def sinusoidal_positions(length: int, width: int) -> Float[Tensor, "length width"]:
    """Return the Transformer's sine and cosine table."""
    position = torch.arange(length, dtype=torch.float32)[:, None]
    frequency = torch.exp(torch.arange(0, width, 2) * (-math.log(10_000.0) / width))
    table = torch.zeros(length, width)
    table[:, 0::2] = torch.sin(position * frequency)
    table[:, 1::2] = torch.cos(position * frequency)
    return table


FREQUENCIES = 16


class TimeEmbedding(nn.Module):
    """Embedding of the flow time t in [0, 1]: Fourier features and a small MLP."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.frequencies: Tensor
        self.register_buffer(
            "frequencies", math.pi * 2.0 ** torch.linspace(-1, 5, FREQUENCIES), persistent=False
        )
        self.mlp = nn.Sequential(
            nn.Linear(2 * FREQUENCIES, width), nn.SiLU(), nn.Linear(width, width)
        )

    def forward(self, t: Float[Tensor, " B"]) -> Float[Tensor, "B width"]:
        angle = t[:, None] * self.frequencies
        return self.mlp(torch.cat([angle.sin(), angle.cos()], dim=-1))


class Attention(nn.Module):
    """Multi-head attention of ``x`` to ``memory`` (self-attention if they are the same)."""

    def __init__(self, width: int, num_heads: int) -> None:
        super().__init__()
        self.num_heads = num_heads
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(
        self, x: Float[Tensor, "B T width"], memory: Float[Tensor, "B S width"]
    ) -> Float[Tensor, "B T width"]:
        query = self.query(x).unflatten(-1, (self.num_heads, -1)).transpose(1, 2)
        key, value = (
            part.unflatten(-1, (self.num_heads, -1)).transpose(1, 2)
            for part in self.key_value(memory).chunk(2, dim=-1)
        )
        # Written out: for windows this short, torch's fused kernel for CPUs loses more time in its
        # backward pass than it saves.
        scores = query @ key.transpose(-1, -2) * query.shape[-1] ** -0.5  # (B, heads, T, S)
        mixed = scores.softmax(-1).to(value.dtype) @ value  # (B, heads, T, width / heads)
        return self.out(mixed.transpose(1, 2).flatten(-2))


class TemporalConv(nn.Module):
    """Depthwise convolution over frames: a learned filter for each channel."""

    def __init__(self, width: int, kernel: int) -> None:
        super().__init__()
        self.depthwise = nn.Conv1d(width, width, kernel, padding=kernel // 2, groups=width)
        self.mix = nn.Linear(width, width)

    def forward(self, x: Float[Tensor, "B T width"]) -> Float[Tensor, "B T width"]:
        return self.mix(F.silu(self.depthwise(x.transpose(1, 2)).transpose(1, 2)))


class MotionBlock(nn.Module):
    """Motion generation block (GlobalDiff, after DiT).

    Seed cross-attention, self-attention, a temporal convolution and a feed-forward layer, each
    residual and, but for the first, FiLM modulated by the conditioning vector.
    """

    def __init__(
        self, width: int, num_heads: int, feedforward_ratio: int, conv_kernel: int
    ) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width, elementwise_affine=False)
        self.seed_norm = nn.LayerNorm(width)
        self.seed_attention = Attention(width, num_heads)
        self.attention = Attention(width, num_heads)
        self.conv = TemporalConv(width, conv_kernel) if conv_kernel else None
        inner = feedforward_ratio * width
        self.feedforward = nn.Sequential(
            nn.Linear(width, inner), nn.GELU(), nn.Linear(inner, width)
        )
        film = nn.Linear(width, (9 if self.conv else 6) * width)
        nn.init.zeros_(film.weight)
        nn.init.zeros_(film.bias)
        self.modulation = nn.Sequential(nn.SiLU(), film)

    def forward(
        self,
        x: Float[Tensor, "B T width"],
        seed: Float[Tensor, "B S width"],
        condition: Float[Tensor, "B width"],
    ) -> Float[Tensor, "B T width"]:
        films = iter(self.modulation(condition)[:, None].chunk(9 if self.conv else 6, dim=-1))

        def film(layer, x: Float[Tensor, "B T dim"]) -> Tensor:
            scale, shift, gate = next(films), next(films), next(films)
            return x + (1 + gate) * layer(self.norm(x) * (1 + scale) + shift)

        x = x + self.seed_attention(self.seed_norm(x), seed)
        x = film(lambda h: self.attention(h, h), x)
        if self.conv is not None:
            x = film(self.conv, x)
        return film(self.feedforward, x)


SPEAKER_WIDTH = 64


class SpeechTokenEncoder(nn.Module):
    """Encoder of speech to one token per frame; dilated convolutions add the context."""

    def __init__(self, speech_dim: int, width: int, context: int) -> None:
        super().__init__()
        self.context = context
        self.frames = nn.Sequential(
            nn.Linear(speech_dim, width), nn.SiLU(), nn.Linear(width, width)
        )
        self.around = nn.ModuleList(
            nn.Conv1d(width, width, 5, padding=2 * dilation, dilation=dilation)
            for dilation in ((1, 3, 9) if context else ())
        )

    def forward(self, speech: Float[Tensor, "B T_ctx dim"]) -> Float[Tensor, "B T width"]:
        x = self.frames(speech)
        for convolution in self.around:
            x = x + convolution(F.silu(x).transpose(1, 2)).transpose(1, 2)
        return x[:, self.context : x.shape[1] - self.context]


class ExtraConditionEncoder(nn.Module):
    """Encoder of further conditions to tokens added to the speech's; zero before training."""

    def __init__(self, dim: int, width: int, context: int) -> None:
        super().__init__()
        self.frames = SpeechTokenEncoder(dim, width, context)
        self.out = nn.Linear(width, width)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self, inputs: Float[Tensor, "B T_ctx dim"], has_condition: Bool[Tensor, " B"]
    ) -> Float[Tensor, "B T width"]:
        return self.out(self.frames(inputs)) * has_condition[:, None, None]


class TimeSpeakerEmbedding(nn.Module):
    """Embedding of flow time and speaker: the vector that modulates every block."""

    def __init__(self, num_speakers: int, width: int) -> None:
        super().__init__()
        self.time = TimeEmbedding(width)
        self.speaker = nn.Embedding(num_speakers, SPEAKER_WIDTH)
        self.mix = nn.Sequential(
            nn.Linear(width + SPEAKER_WIDTH, width), nn.SiLU(), nn.Linear(width, width)
        )

    def forward(
        self, t: Float[Tensor, " B"], speaker: Int[Tensor, " B"]
    ) -> Float[Tensor, "B width"]:
        return self.mix(torch.cat([self.time(t), self.speaker(speaker)], dim=-1))


class MotionBranch(nn.Module):
    """Stack of motion generation blocks for one region of the body.

    Its input fuses x_t of the region, x_t of the whole body with the expression, and speech
    (GlobalDiff eq. 6; each is projected first, as in the official code).
    """

    def __init__(
        self, config: BranchConfig, *, inputs: int, body_inputs: int, channels: int
    ) -> None:
        super().__init__()
        width = config.width
        self.positions: Tensor
        positions = sinusoidal_positions(config.window_frames, width)
        self.register_buffer("positions", positions, persistent=False)
        self.region_in = nn.Linear(inputs, width)
        self.body_in = nn.Linear(body_inputs, width)
        self.fuse = nn.Linear(3 * width, width)
        self.seed_in = nn.Linear(channels, width)
        self.no_seed = nn.Parameter(0.02 * torch.randn(config.seed_frames, width))
        self.seed_to_condition = nn.Linear(width, width)
        shape = width, config.num_heads, config.feedforward_ratio, config.conv_kernel
        self.blocks = nn.ModuleList(MotionBlock(*shape) for _ in range(config.num_blocks))
        self.norm_out = nn.LayerNorm(width)
        self.out = nn.Linear(width, channels)
        nn.init.zeros_(self.out.weight)  # start at the mean pose, which normalisation puts at zero
        nn.init.zeros_(self.out.bias)

    def forward(self, *inputs: Shaped[Tensor, "B ..."]) -> Float[Tensor, "B T channels"]:
        """Predict the region's channels; the arguments are those of `embed`."""
        x, seed_tokens, condition = self.embed(*inputs)
        for block in self.blocks:
            x = block(x, seed_tokens, condition)
        return self.project(x)

    def embed(
        self,
        region: Float[Tensor, "B T inputs"],
        body: Float[Tensor, "B T body_inputs"],
        speech: Float[Tensor, "B T width"],
        seed: Float[Tensor, "B S channels"],
        has_seed: Bool[Tensor, " B"],
        condition: Float[Tensor, "B width"],
    ) -> tuple[Float[Tensor, "B T width"], Float[Tensor, "B S width"], Float[Tensor, "B width"]]:
        """Compute the input of the blocks: frame tokens, seed tokens and conditioning vector."""
        x = self.fuse(torch.cat([self.region_in(region), self.body_in(body), speech], dim=-1))
        x = x + self.positions
        seed_tokens = torch.where(has_seed[:, None, None], self.seed_in(seed), self.no_seed)
        seed_tokens = seed_tokens + self.positions[: seed.shape[1]]
        return x, seed_tokens, condition + self.seed_to_condition(seed_tokens.mean(1))

    def project(self, x: Float[Tensor, "B T width"]) -> Float[Tensor, "B T channels"]:
        """Project the last block's frames to the region's channels."""
        return self.out(self.norm_out(x))


class ConditionedNetwork(nn.Module):
    """Common part of all networks that are conditioned on speech; subclasses add the branches."""

    def __init__(self, config: BranchConfig) -> None:
        super().__init__()
        width = config.width
        self.condition = TimeSpeakerEmbedding(config.num_speakers, width)
        self.speech = SpeechTokenEncoder(config.speech_dim, width, config.speech_context)
        self.no_speech = nn.Parameter(torch.zeros(config.speech_dim))

    def speech_tokens(
        self, speech: Float[Tensor, "B T_ctx speech_dim"], has_speech: Bool[Tensor, " B"]
    ) -> Float[Tensor, "B T width"]:
        """Compute speech tokens, or those of absent speech where ``has_speech`` is false."""
        return self.speech(torch.where(has_speech[:, None, None], speech, self.no_speech))


def mask_expression(
    expression: Float[Tensor, "B T E"], has_speech: Bool[Tensor, " B"]
) -> Float[Tensor, "B T E"]:
    """Return the expressions that condition the body: zero without speech, which they reveal."""
    return torch.where(has_speech[:, None, None], expression, torch.zeros_like(expression))


class PriorResidualNetwork(ConditionedNetwork):
    """Network that predicts x_1 as its prior's posterior mean plus a learned residual.

    It takes x_t (motion or face), time, speech, seed and speaker; the prior is fitted, not trained.

    Args:
        expression_dim: size of the face that conditions the body; 0 for a network of the face.
    """

    def __init__(
        self, config: BranchConfig, prior: GaussianPrior, *, channels: int, expression_dim: int
    ) -> None:
        super().__init__(config)
        self.config = config
        self.prior = prior
        self.branch = MotionBranch(
            config, inputs=channels, body_inputs=channels + expression_dim, channels=channels
        )

    def forward(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B T_ctx speech_dim"],
        seed: Float[Tensor, "B S C"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
        expression: Float[Tensor, "B T expression_dim"] | None = None,
        extra_tokens: Float[Tensor, "B T width"] | None = None,
    ) -> Float[Tensor, "B T C"]:
        """Predict the clean components x_1, with the inputs of `globaldiff.system.MotionNetwork`.

        ``extra_tokens``: tokens of further frame-wise conditions, which are added to the speech's.
        """
        tokens = self.speech_tokens(speech, has_speech)
        if extra_tokens is not None:
            tokens = tokens + extra_tokens
        prior_mean = self.prior.posterior_mean(x_t, t, seed, has_seed)
        body = prior_mean
        if expression is not None:
            body = torch.cat([prior_mean, mask_expression(expression, has_speech)], dim=-1)
        unit = self.branch(x_t, body, tokens, seed, has_seed, self.condition(t, speaker))
        return prior_mean + self.prior.scale_by_posterior(unit.to(prior_mean.dtype), t, has_seed)
