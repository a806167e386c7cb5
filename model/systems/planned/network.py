"""Networks of the planner, and of motion that follows a plan, on a linear-Gaussian prior.

The planner is a discrete-time model of competing risks: the speech determines the probability of
each state to begin now, depending on the duration of the present one; random numbers choose.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor, nn

from model.networks.branch import ExtraConditionEncoder, PriorResidualNetwork
from model.plan.plan_features import NUM_TRACKS, TIERS, TIERS_BY_NAME, EventTier
from model.sampling.prior import GaussianPrior
from model.systems.planned.config import PlannedNetworkConfig, PlannerConfig


class PlanEncoder(ExtraConditionEncoder):
    """Encoder of a plan to one token per frame."""

    def __init__(self, config: PlannedNetworkConfig) -> None:
        super().__init__(NUM_TRACKS + 2 * config.kind_dim, config.width, config.speech_context)
        self.kinds = nn.Embedding(config.num_kinds, config.kind_dim)

    def encoder_inputs(
        self, tracks: Float[Tensor, "B T_ctx tracks"], kinds: Int[Tensor, "B T_ctx 2"]
    ) -> Float[Tensor, "B T_ctx dim"]:
        """Concatenate the tracks of a plan and the embeddings of its gesture types."""
        return torch.cat([tracks, self.kinds(kinds).flatten(-2)], dim=-1)


class PlannedNetwork(PriorResidualNetwork):
    """Network that predicts x_1 from the inputs of `PriorResidualNetwork` and a plan."""

    def __init__(self, config: PlannedNetworkConfig, prior: GaussianPrior) -> None:
        super().__init__(
            config, prior, channels=config.motion_dim, expression_dim=config.expression_dim
        )
        self.plan = PlanEncoder(config)

    def forward(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        *,
        tracks: Float[Tensor, "B T_ctx tracks"],
        kinds: Int[Tensor, "B T_ctx 2"],
        has_plan: Bool[Tensor, " B"],
        **conditions: Shaped[Tensor, "B ..."],
    ) -> Float[Tensor, "B T C"]:
        """Predict the clean components x_1, with the inputs of `PriorResidualNetwork` and a plan.

        The plan's tracks, and the gesture types of both hands, are those of the speech's frames.
        """
        plan = self.plan(self.plan.encoder_inputs(tracks, kinds), has_plan)
        return super().forward(x_t, t, extra_tokens=plan, **conditions)


SPEAKER_WIDTH = 16
_MIN_STD = 0.02
"""Smallest standard deviation of a mark, in the tier's units."""


@dataclass(frozen=True)
class MarkMixture:
    """Mixture of K Gaussians with diagonal covariances, in the tier's units."""

    logits: Float[Tensor, "*rows K"]
    mean: Float[Tensor, "*rows K mark_dim"]
    std: Float[Tensor, "*rows K mark_dim"]

    def log_likelihood(self, mark: Float[Tensor, "*rows mark_dim"]) -> Float[Tensor, "*rows"]:
        """Compute the natural logarithm of the density."""
        off = (mark[..., None, :] - self.mean) / self.std
        each = -0.5 * (off.square() + 2 * self.std.log() + 1.8378770664).sum(-1)
        return torch.logsumexp(F.log_softmax(self.logits, -1) + each, dim=-1)


class TierHead(nn.Module):
    """Predictor of one tier's next event."""

    def __init__(self, tier: EventTier, config: PlannerConfig) -> None:
        super().__init__()
        self.tier, self.mixtures = tier, config.mixtures
        state_dim = tier.state_feature_dim + (
            TIERS_BY_NAME[tier.coupled_tier].state_feature_dim if tier.coupled_tier else 0
        )
        hidden = config.head_width
        self.heard = nn.Linear(config.width + SPEAKER_WIDTH, hidden)
        self.seen = nn.Linear(state_dim, hidden, bias=False)
        self.event = nn.Sequential(nn.Linear(hidden, hidden), nn.SiLU())
        self.event_out = nn.Linear(hidden, 1 + len(tier.states))
        if tier.mark_scales:
            self.begun = nn.Embedding(len(tier.states), hidden)
            self.mark = nn.Sequential(nn.Linear(hidden, hidden), nn.SiLU())
            self.mark_out = nn.Linear(hidden, config.mixtures * (1 + 2 * len(tier.mark_scales)))

    def hidden(
        self,
        speech: Float[Tensor, "*rows speech_width"],
        chain_state: Float[Tensor, "*rows state_dim"],
    ) -> Float[Tensor, "*rows hidden"]:
        return F.silu(self.heard(speech) + self.seen(chain_state))

    def event_log_probs(
        self, hidden: Float[Tensor, "*rows hidden"]
    ) -> Float[Tensor, "*rows events"]:
        """Compute log probabilities of staying (index 0) and of each state that may begin."""
        return F.log_softmax(self.event_out(self.event(hidden)).float(), dim=-1)

    def marks(
        self, hidden: Float[Tensor, "*rows hidden"], begun_state: Int[Tensor, "*rows"]
    ) -> MarkMixture:
        """Predict the mark of a state that begins."""
        logits = self.mark_out(self.mark(hidden + self.begun(begun_state))).float()
        parts = logits.unflatten(-1, (self.mixtures, -1))
        mean, raw_std = parts[..., 1:].chunk(2, dim=-1)
        return MarkMixture(parts[..., 0], mean, F.softplus(raw_std) + _MIN_STD)


class PlannerNetwork(nn.Module):
    """Network that predicts each tier's next event from the speech around each frame."""

    def __init__(self, config: PlannerConfig) -> None:
        super().__init__()
        width = config.width
        self.config = config
        self.no_speech = nn.Parameter(torch.zeros(width))
        self.speaker = nn.Embedding(config.num_speakers, SPEAKER_WIDTH)
        self.frames = nn.Linear(config.speech_dim + config.codes, width)
        self.around = nn.ModuleList(
            nn.Conv1d(width, width, 3, padding=dilation, dilation=dilation)
            for dilation in config.dilations
        )
        self.norm = nn.LayerNorm(width)
        self.heads = nn.ModuleDict({tier.name: TierHead(tier, config) for tier in TIERS})

    def encode_speech_and_speaker(
        self,
        speech: Float[Tensor, "B T_ctx input_dim"],
        speaker: Int[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T speech_width"]:
        """Encode normalised features (and codes) around each of T frames, with the speaker.

        ``speech`` has ``config.context_frames_per_side`` frames more before and after them.
        """
        x = self.frames(speech)
        for convolution in self.around:
            x = x + convolution(F.silu(x).transpose(1, 2)).transpose(1, 2)
        x = x[
            :,
            self.config.context_frames_per_side : x.shape[1] - self.config.context_frames_per_side,
        ]
        x = torch.where(has_speech[:, None, None], self.norm(x), self.no_speech)
        who = self.speaker(speaker)[:, None].expand(-1, x.shape[1], -1)
        return torch.cat([x, who], dim=-1)

    def forward(
        self,
        speech: Float[Tensor, "B T_ctx input_dim"],
        speaker: Int[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
        chain_states: Mapping[str, Float[Tensor, "B T _"]],
        event: Mapping[str, Int[Tensor, "B T"]],
        mark: Mapping[str, Float[Tensor, "B T _"]],
    ) -> dict[str, Float[Tensor, ""]]:
        """Compute mean negative log-likelihoods by tier of events and their marks, per frame.

        They are conditioned on the past of the tier and of its neighbour (``chain_states``).
        """
        encoded = self.encode_speech_and_speaker(speech, speaker, has_speech)
        losses = {}
        for name, head in self.heads.items():
            assert isinstance(head, TierHead)
            hidden = head.hidden(encoded, chain_states[name])
            logs = head.event_log_probs(hidden)
            losses[name] = -logs.gather(-1, event[name][..., None]).mean()
            if head.tier.mark_scales:
                begins = event[name] > 0
                marks = head.marks(hidden[begins], event[name][begins] - 1)
                log_likelihood = marks.log_likelihood(mark[name][begins])
                losses[f"{name} mark"] = -log_likelihood.sum() / begins.numel()
        return losses
