"""The motion network on a linear-Gaussian prior, told a plan besides."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from model.networks.branch import AddedTokens
from model.networks.prior_network import PriorNetwork
from model.plan.tracks import NUM_TRACKS
from model.sampling.prior import GaussianPrior
from model.systems.planned.config import PlannedNetworkConfig


class PlanTokens(AddedTokens):
    """All of a plan to one token a frame."""

    def __init__(self, config: PlannedNetworkConfig) -> None:
        super().__init__(NUM_TRACKS + 2 * config.kind_dim, config.width, config.speech_context)
        self.kinds = nn.Embedding(config.num_kinds, config.kind_dim)

    def told(
        self, tracks: Float[Tensor, "B heard tracks"], kinds: Int[Tensor, "B heard 2"]
    ) -> Float[Tensor, "B heard dim"]:
        """The numbers of a plan, its gestures as vectors."""
        return torch.cat([tracks, self.kinds(kinds).flatten(-2)], dim=-1)


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
        plan = self.plan(self.plan.told(tracks, kinds), has_plan)
        return super().forward(x_t, t, beside=plan, **conditions)
