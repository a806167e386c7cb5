"""Training of the planner, and of the motion network that follows plans."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from model.data.annotations import PlanAnnotations, load_plan_annotations
from model.data.prepared import Batch, PreparedData
from model.networks.speech_codes import load_speech_codes
from model.sampling.prior import GaussianPrior
from model.systems.globaldiff.task import MotionTask
from model.systems.planned.config import PlannedMotionTrainConfig, PlannerConfig, PlannerTrainConfig
from model.systems.planned.network import PlannedNetwork, PlannerNetwork
from model.systems.planned.planner import planner_inputs
from model.training.parallel import ShardedRandom
from model.training.targets import augmented_speech, fit_speech_normaliser
from model.training.task import SingleNetworkTask, StepLoss, TaskSetup


def make_task(
    config: PlannerTrainConfig | PlannedMotionTrainConfig, data: PreparedData, setup: TaskSetup
) -> SingleNetworkTask:
    if isinstance(config, PlannerTrainConfig):
        return PlannerTask(config, data, setup)
    return PlannedTask(config, data, setup)


class PlannerTask(SingleNetworkTask):
    """Training with the negative log-likelihood of a plan's events."""

    config: PlannerTrainConfig

    def __init__(self, config: PlannerTrainConfig, data: PreparedData, setup: TaskSetup) -> None:
        shape = config.planner
        weights = setup.seed_and_read_initial_weights(config, data, shape.num_speakers)
        self.plans = load_plan_annotations(data, shape.num_speakers)
        network = PlannerNetwork(shape)
        device = setup.shard.device
        self.codes = load_speech_codes(setup.helper_weights, device) if shape.codes else None
        super().__init__(
            setup, config, weights, network,
            weights.normaliser if weights else fit_speech_normaliser(data),
            shape.window_frames, shape.context_frames_per_side,
            self.plans.kind_table.to_tensors()
            | {"begins.goals": first_goals(data, self.plans, shape)},
        )  # fmt: skip

    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        config, shard = self.config, draws.shard
        with torch.no_grad():
            events = self.plans.events(batch.part(shard.rows)).to(shard.device)
            has_speech = draws.keep_mask(config.speech_dropout)
            knows = draws.keep_mask(config.speaker_dropout)
            knows &= has_speech | draws.keep_mask(config.speakerless)
            features = shard.local_rows(augmented_speech(config, network, batch, draws.generator))
            speech = planner_inputs(features, self.normaliser, self.codes)
            speaker = shard.local_rows(batch.speaker) * knows
        with shard.autocast():
            inputs = events.chain_states, events.event, events.mark
            return StepLoss(network(speech, speaker, has_speech, *inputs))


def first_goals(
    data: PreparedData, plans: PlanAnnotations, shape: PlannerConfig
) -> Float[Tensor, "speakers 2 3"]:
    """Compute the median initial goals of hands for each speaker; row 0 is that of all."""
    first: dict[int, list[list[tuple[float, ...]]]] = {}
    for clip, chains in zip(data.clips, plans.chains, strict=True):
        if clip.split == "train":
            goals = [chains[side][0].mark for side in ("left", "right")]
            first.setdefault(clip.speaker, []).append(goals)
    everybody = torch.tensor([goals for each in first.values() for goals in each]).median(0).values
    table = everybody.repeat(shape.num_speakers, 1, 1)
    for speaker, goals in first.items():
        table[speaker] = torch.tensor(goals).median(0).values
    return table


class PlannedTask(MotionTask):
    """Training of GlobalDiff's network with plans as a further input."""

    config: PlannedMotionTrainConfig

    def __init__(
        self, config: PlannedMotionTrainConfig, data: PreparedData, setup: TaskSetup
    ) -> None:
        self.plans = load_plan_annotations(data, config.network.num_speakers)
        super().__init__(config, data, setup)
        self.statistics = {"kinds.names": self.plans.kind_table.to_tensors()["kinds.names"]}

    def make_network(self, config: PlannedMotionTrainConfig, prior: GaussianPrior) -> nn.Module:
        return PlannedNetwork(config.network, prior)

    def extra_inputs(self, batch: Batch, draws: ShardedRandom) -> dict[str, Tensor]:
        parts = self.plans.tracks_and_kinds(batch, self.config.network.speech_context)
        tracks, kinds = (draws.shard.local_rows(part) for part in parts)
        return {
            "tracks": tracks,
            "kinds": kinds,
            "has_plan": draws.keep_mask(self.config.plan_dropout),
        }
