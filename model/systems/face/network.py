"""The expression network: the face on a linear-Gaussian prior, told a plan where there is one."""

from jaxtyping import Bool, Float
from torch import Tensor

from model.networks.branch import AddedTokens
from model.networks.prior_network import PriorNetwork
from model.plan.tracks import NUM_FACE_TRACKS
from model.sampling.prior import GaussianPrior
from model.systems.face.config import ExpressionConfig


class FaceNetwork(PriorNetwork):
    """Predicts face units x_1 from what `PriorNetwork` is told, and a plan's tracks."""

    config: ExpressionConfig

    def __init__(self, config: ExpressionConfig, prior: GaussianPrior) -> None:
        super().__init__(config, prior, channels=config.expression_dim, expression_dim=0)
        self.plan = AddedTokens(NUM_FACE_TRACKS, config.width, config.speech_context)

    def forward(
        self,
        x_t: Float[Tensor, "B T E"],
        t: Float[Tensor, " B"],
        *,
        tracks: Float[Tensor, "B heard tracks"] | None = None,
        has_plan: Bool[Tensor, " B"] | None = None,
        **conditions: Tensor,
    ) -> Float[Tensor, "B T E"]:
        """Clean components x_1.

        Args:
            tracks: `model.plan.tracks.FACE_TRACKS` of the window and of ``speech_context`` frames
                before and after it; None where no plan is told.
            has_plan: which of them are told one; all, if left out.
            conditions: of `PriorNetwork.forward`.
        """
        if tracks is None:
            return super().forward(x_t, t, **conditions)
        told = conditions["has_seed"].new_ones(len(x_t)) if has_plan is None else has_plan
        return super().forward(x_t, t, beside=self.plan(tracks, told), **conditions)
