"""A network that stands on a linear-Gaussian prior; body and face use the same."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from model.networks.branch import ConditionedNetwork, MotionBranch, shown
from model.networks.config import BranchConfig
from model.sampling.prior import GaussianPrior


class PriorNetwork(ConditionedNetwork):
    """Predicts x_1 (components of motion, or of a face) from x_t, time, speech, seed and speaker.

    Args:
        channels: how many components.
        expression_dim: numbers of the face that the body is shown; 0 for the face itself.
    """

    def __init__(
        self,
        config: BranchConfig,
        prior: GaussianPrior,
        *,
        channels: int,
        expression_dim: int,
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
        speech: Float[Tensor, "B heard speech_dim"],
        seed: Float[Tensor, "B S C"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
        expression: Float[Tensor, "B T expression_dim"] | None = None,
        beside: Float[Tensor, "B T width"] | None = None,
    ) -> Float[Tensor, "B T C"]:
        """Clean components x_1; see `model.systems.globaldiff.network`.

        Args:
            beside: what else is known of each frame, as tokens that are added to the speech's.
        """
        tokens = self.hear(speech, has_speech)
        if beside is not None:
            tokens = tokens + beside
        known = self.prior.posterior(x_t, t, seed, has_seed)
        body = known
        if expression is not None:
            body = torch.cat([known, shown(expression, has_speech)], dim=-1)
        unit = self.branch(
            x_t, body, tokens, seed, has_seed, self.condition(t, speaker), self.positions
        )
        return known + self.prior.shaped(unit.to(known.dtype), t, has_seed)
