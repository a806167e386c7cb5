"""The motion network on a linear-Gaussian prior, told a plan besides."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from model.networks.branch import SpeechTokens
from model.networks.prior_network import PriorNetwork
from model.plan.tracks import NUM_TRACKS
from model.sampling.prior import GaussianPrior
from model.systems.planned.config import PlannedNetworkConfig


class PlanTokens(nn.Module):
    """A plan to one token a frame; nothing of it is said before training."""

    def __init__(self, config: PlannedNetworkConfig) -> None:
        super().__init__()
        self.kinds = nn.Embedding(config.num_kinds, config.kind_dim)
        self.frames = SpeechTokens(
            NUM_TRACKS + 2 * config.kind_dim, config.width, config.speech_context
        )
        self.out = nn.Linear(config.width, config.width)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self,
        tracks: Float[Tensor, "B heard tracks"],
        kinds: Int[Tensor, "B heard 2"],
        has_plan: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T width"]:
        told = torch.cat([tracks, self.kinds(kinds).flatten(-2)], dim=-1)
        return self.out(self.frames(told)) * has_plan[:, None, None]


class PlannedNetwork(PriorNetwork):
    """Predicts x_1 from what `PriorNetwork` is told, and a plan."""

    def __init__(self, config: PlannedNetworkConfig, prior: GaussianPrior) -> None:
        super().__init__(
            config, prior, channels=config.motion_dim, expression_dim=config.expression_dim
        )
        self.plan = PlanTokens(config)

    def forward(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        *,
        tracks: Float[Tensor, "B heard tracks"],
        kinds: Int[Tensor, "B heard 2"],
        has_plan: Bool[Tensor, " B"],
        **conditions: Tensor,
    ) -> Float[Tensor, "B T C"]:
        """Clean components x_1.

        Args:
            tracks: of the window and of ``speech_context`` frames before and after it.
            kinds: numbers of the gestures of the left and the right hand.
            conditions: of `PriorNetwork.forward`.
        """
        return super().forward(x_t, t, beside=self.plan(tracks, kinds, has_plan), **conditions)
