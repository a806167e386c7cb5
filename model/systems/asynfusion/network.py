"""AsynFusion's networks: branches for face and body, coupled by CoSync."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from model.motion.packing import Normaliser
from model.networks.branch import Attention, ConditionedNetwork, MotionBranch
from model.networks.trained import TrainedWeights
from model.sampling.prior import GaussianPrior
from model.systems.asynfusion.config import DualBranchConfig


class CoSync(nn.Module):
    """Exchange ``MLP(LN(softmax(Q K^T / sqrt(d)) V)) + F`` of a branch with the other.

    Eqs. 9 and 10: queries of its own frames, keys and values of the other's. Initially identity.
    """

    def __init__(self, width: int, num_heads: int) -> None:
        super().__init__()
        self.attention = Attention(width, num_heads)
        self.norm = nn.LayerNorm(width)
        last = nn.Linear(width, width)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.mlp = nn.Sequential(nn.Linear(width, width), nn.GELU(), last)

    def forward(
        self, own: Float[Tensor, "B T width"], other: Float[Tensor, "B T width"]
    ) -> Float[Tensor, "B T width"]:
        return self.mlp(self.norm(self.attention(own, other))) + own


EXPRESSION, GESTURE = 0, 1
BRANCHES = EXPRESSION, GESTURE
Pair = tuple[Tensor, Tensor]
"""A value of the expression branch and the same of the gesture branch."""


def map_branches(function: Callable[..., Any], *pairs: tuple) -> tuple:
    """Apply a function to the corresponding values of both branches."""
    return tuple(function(*parts) for parts in zip(*pairs, strict=True))


FeatureBuffer = dict[tuple[int, int], Tensor]
"""Latest features by branch and block, before their exchange."""


class Branch(MotionBranch):
    """Blocks of one branch, its prior, and the exchange after each block."""

    def __init__(self, config: DualBranchConfig, prior: GaussianPrior, channels: int) -> None:
        super().__init__(config, inputs=channels, body_inputs=channels, channels=channels)
        self.prior = prior
        self.exchanges = nn.ModuleList(
            CoSync(config.width, config.num_heads) for _ in range(config.num_blocks)
        )


@dataclass(frozen=True)
class BranchStatistics:
    """Normalisation and prior of the motion of one branch."""

    normaliser: Normaliser
    prior: GaussianPrior

    def tensors(self) -> dict[str, Tensor]:
        """Return the tensors that are saved with trained weights."""
        return self.normaliser.tensors() | {"prior.covariance": self.prior.covariance}


PairStatistics = tuple[BranchStatistics, BranchStatistics]
"""Statistics of the expression branch and of the gesture branch."""


class DualBranchNetwork(ConditionedNetwork):
    """Network that predicts x_1 of face and body, each from its own x_t and flow time (eq. 8).

    Each has a linear-Gaussian prior (`model.sampling.prior`), which the paper does not have: a
    network this small, trained this short, needs one to move well.

    Args:
        consistent: True if x_1 is the end of the flow (a consistency function), not the posterior
            mean. It decides which part of the prior the network extends.
    """

    def __init__(
        self, config: DualBranchConfig, streams: PairStatistics, *, consistent: bool
    ) -> None:
        super().__init__(config)
        self.config = config
        self.consistent = consistent
        face, body = (stream.prior for stream in streams)
        self.expression = Branch(config, face, config.expression_dim)
        self.gesture = Branch(config, body, config.gesture_dim)

    @property
    def branches(self) -> tuple[Branch, Branch]:
        """The branches of expression and gesture."""
        return self.expression, self.gesture

    def forward(
        self,
        x_t: Pair,
        t: Pair,
        *,
        speech: Float[Tensor, "B T_ctx speech_dim"],
        seed: Pair,
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
    ) -> Pair:
        """Predict clean motion of both branches at once.

        Args:
            x_t: (B, T, 52) and (B, T, 168), normalised components.
            t: flow times, each (B,).
            seed: the clean first frames; ignored where ``has_seed`` is false.
            has_speech: false hides the speech from both branches.
        """
        outputs = self.predict_active(
            BRANCHES, x_t, t, {},
            speech_tokens=self.speech_tokens(speech, has_speech), seed=seed, speaker=speaker,
        has_seed=has_seed, )  # fmt: skip
        return outputs[EXPRESSION], outputs[GESTURE]

    def predict_active(
        self,
        active: Sequence[int],
        x_t: Pair,
        t: Pair,
        buffer: FeatureBuffer,
        *,
        speech_tokens: Float[Tensor, "B T width"],
        seed: Pair,
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
    ) -> dict[int, Float[Tensor, "B T C"]]:
        """Predict clean motion of the ``active`` branches and update their features in the buffer.

        The buffer has the latest features of the branches, used for inactive ones.
        """
        clean, entered = {}, {}
        for which in active:
            inputs = x_t[which], t[which], seed[which], has_seed
            prior = self.branches[which].prior
            clean[which] = (
                prior.flow_to_data(*inputs) if self.consistent else prior.posterior_mean(*inputs)
            )
            condition = self.condition(t[which], speaker)
            entered[which] = self.branches[which].embed(
                x_t[which], clean[which], speech_tokens, seed[which], has_seed, condition
            )
        frames = {which: entered[which][0] for which in active}
        for layer in range(self.config.num_blocks):
            for which in active:
                block = self.branches[which].blocks[layer]
                frames[which] = block(frames[which], *entered[which][1:])
                buffer[which, layer] = frames[which]
            for which in active:
                exchange = self.branches[which].exchanges[layer]
                frames[which] = exchange(frames[which], buffer[1 - which, layer])
        outputs = {}
        for which in active:
            branch = self.branches[which]
            unit = branch.project(frames[which]).to(clean[which].dtype)
            outputs[which] = clean[which] + branch.prior.scale_by_posterior(
                unit, t[which], has_seed
            )
        return outputs


_FACE = ".face."


def face_tensors(statistics: BranchStatistics) -> dict[str, Tensor]:
    """Rename the face's statistics, so that the plain names remain for the body."""
    return {name.replace(".", _FACE, 1): tensor for name, tensor in statistics.tensors().items()}


def read_statistics(trained: TrainedWeights, seed_frames: int) -> PairStatistics:
    """Read the statistics of both branches as saved."""
    named = trained.tensors.items()
    face = replace(
        trained, tensors={name.replace(_FACE, ".", 1): t for name, t in named if _FACE in name}
    )
    expression, gesture = (
        BranchStatistics(each.normaliser, each.prior(seed_frames)) for each in (face, trained)
    )
    return expression, gesture
