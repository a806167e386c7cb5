"""A network that stands on a linear-Gaussian prior; body and face use the same."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from model.networks.layers import sinusoidal_positions
from model.sampling.prior import GaussianPrior
from model.storage.settings import ExpressionConfig, NetworkConfig
from model.systems.globaldiff.network import Condition, MotionBranch, SpeechTokens


class PriorNetwork(nn.Module):
    """Predicts x_1 (components of motion, or of a face) from x_t, time, speech, seed and speaker.

    Args:
        channels: how many components.
        expression_dim: numbers of the face that the body is shown; 0 for the face itself.
    """

    def __init__(
        self,
        config: NetworkConfig | ExpressionConfig,
        prior: GaussianPrior,
        *,
        channels: int,
        expression_dim: int,
    ) -> None:
        super().__init__()
        self.config = config
        self.prior = prior
        width = config.width
        self.condition = Condition(config.num_speakers, width)
        self.speech = SpeechTokens(config.speech_dim, width, config.speech_context)
        self.no_speech = nn.Parameter(torch.zeros(config.speech_dim))
        self.branch = MotionBranch(
            config, inputs=channels, body_inputs=channels + expression_dim, channels=channels
        )
        self.register_buffer(
            "positions", sinusoidal_positions(config.window_frames, width), persistent=False
        )

    def forward(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B heard speech_dim"],
        seed: Float[Tensor, "B S C"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
        expression: Float[Tensor, "B T expression_dim"] | None = None,
    ) -> Float[Tensor, "B T C"]:
        """Clean components x_1; see `MotionNetwork.forward`."""
        visible = has_speech[:, None, None]
        tokens = self.speech(torch.where(visible, speech, self.no_speech))
        known = self.prior.posterior(x_t, t, seed, has_seed)
        body = known
        if expression is not None:
            seen = torch.where(visible, expression, torch.zeros_like(expression))
            body = torch.cat([known, seen], dim=-1)
        unit = self.branch(
            x_t, body, tokens, seed, has_seed, self.condition(t, speaker), self.positions
        )
        return known + self.prior.shaped(unit.to(known.dtype), t, has_seed)
