"""The motion network: two branches (hands, torso) that predict clean motion x_1 from noisy x_t."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from model.motion.packing import HAND_CHANNELS, MOTION_DIM, TORSO_CHANNELS
from model.networks.branch import ConditionedNetwork, MotionBranch, PriorNetwork, shown
from model.sampling.prior import GaussianPrior
from model.systems.globaldiff.config import NetworkConfig


class MotionNetwork(ConditionedNetwork):
    """Predicts x_1 (normalised motion) from x_t, time, speech, expression, seed and speaker."""

    prior = None
    """It stands on none; `PriorNetwork` does."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.config = config
        self.hands, self.torso = (
            MotionBranch(
                config,
                inputs=len(channels),
                body_inputs=MOTION_DIM + config.expression_dim,
                channels=len(channels),
            )
            for channels in (HAND_CHANNELS, TORSO_CHANNELS)
        )

    def forward(
        self,
        x_t: Float[Tensor, "B T 333"],
        t: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B heard speech_dim"],
        expression: Float[Tensor, "B T expression_dim"],
        seed: Float[Tensor, "B S 333"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T 333"]:
        """Clean motion x_1 from x_t at flow time t, 0 (noise) to 1 (data).

        Args:
            speech: features of the window and of ``speech_context`` frames before and after it.
            seed: the clean first ``S`` frames; ignored where ``has_seed`` is false.
            speaker: 0 is "no speaker".
            has_speech: false hides speech and expression.
        """
        condition = self.condition(t, speaker)
        speech_tokens = self.hear(speech, has_speech)
        body = torch.cat([x_t, shown(expression, has_speech)], dim=-1)
        x_1 = torch.empty_like(x_t)
        for branch, channels in ((self.hands, HAND_CHANNELS), (self.torso, TORSO_CHANNELS)):
            region, known = x_t[..., channels], seed[..., channels]
            predicted = branch(region, body, speech_tokens, known, has_seed, condition)
            x_1[..., channels] = predicted.to(x_1.dtype)  # it is bf16 under autocast
        return x_1

    @torch.no_grad()
    def start_at(self, x_1: Float[Tensor, "333"]) -> None:
        """Let the untrained network predict this vector in every frame: with raw 6D, zero is no
        rotation, and its gradient through Gram-Schmidt has no bound."""
        self.hands.out.bias.copy_(x_1[HAND_CHANNELS])
        self.torso.out.bias.copy_(x_1[TORSO_CHANNELS])


def make_network(
    config: NetworkConfig, prior: GaussianPrior | None
) -> MotionNetwork | PriorNetwork:
    """An untrained network; one that stands on a prior is given it."""
    if prior is None:
        return MotionNetwork(config)
    return PriorNetwork(
        config, prior, channels=config.motion_dim, expression_dim=config.expression_dim
    )
