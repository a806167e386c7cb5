"""Training of the planner, and of the motion network that follows plans."""

from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from model.data.annotated import Plans, prepare_plans
from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import Normaliser
from model.networks.speech_codes import SpeechCodes, load_codes
from model.systems.globaldiff.task import motion_step
from model.systems.planned.config import (
    PlannedConfig,
    PlannerConfig,
    PlannerTrainConfig,
)
from model.systems.planned.network import PlannedNetwork, PlannerNetwork
from model.systems.planned.planner import heard_by_planner
from model.training.config import TrainConfig
from model.training.parallel import WHOLE, Draws, Shard
from model.training.targets import fit_features, fit_motion_prior, heard, prepare_targets
from model.training.task import DescentTask, StepFunction, StepLoss, TaskSetup


def make_task(config: TrainConfig, data: PreparedData, setup: TaskSetup) -> DescentTask:
    """See `Family.make_task`."""
    if isinstance(config, PlannerTrainConfig):
        return _planner_task(config, data, setup)
    return _motion_task(cast(PlannedConfig, config), data, setup)


def _planner_task(config: PlannerTrainConfig, data: PreparedData, setup: TaskSetup) -> DescentTask:
    shape = config.planner
    given = setup.begin(config, data, shape.num_speakers)
    plans = prepare_plans(data, shape.num_speakers)
    network = PlannerNetwork(shape)
    setup.put_weights_into(network, given, may_lack=True)  # trained with fewer tiers, or no codes
    normaliser = given.normaliser if given else fit_features(data)
    codes = load_codes(setup.helpers) if shape.codes else None
    return DescentTask(
        setup, config, network, planner_step(config, normaliser, codes, plans), normaliser,
        shape.window_frames, shape.context,
        statistics={**plans.table.tensors(), "begins.goals": first_goals(data, plans, shape)},
    )  # fmt: skip


def first_goals(
    data: PreparedData, plans: Plans, shape: PlannerConfig
) -> Float[Tensor, "speakers 2 3"]:
    """Where each speaker's hands usually are when a clip begins, in the tiers' units; row 0 is
    everybody's, and that of speakers who are not there."""
    found: dict[int, list[list[tuple[float, ...]]]] = {}
    for clip, chains in zip(data.clips, plans.chains, strict=True):
        if clip.split == "train":
            goals = [chains[side][0].mark for side in ("left", "right")]
            found.setdefault(clip.speaker, []).append(goals)
    everybody = torch.tensor([goals for each in found.values() for goals in each]).median(0).values
    table = everybody.repeat(shape.num_speakers, 1, 1)
    for speaker, goals in found.items():
        table[speaker] = torch.tensor(goals).median(0).values
    return table


def planner_step(
    config: PlannerTrainConfig, normaliser: Normaliser, codes: SpeechCodes | None, plans: Plans
) -> StepFunction:
    """The loss of the planner on one batch: the negative log-likelihood of its events."""

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        draws = Draws(len(batch.clips), generator, shard)
        with torch.no_grad():
            events = plans.events(batch.rows(shard.mine))
            has_speech = draws.keep(config.speech_dropout)
            knows = draws.keep(config.speaker_dropout)
            knows &= has_speech | draws.keep(config.speakerless)
            features = shard.of(heard(config, network, batch, generator))
            speech = heard_by_planner(features, normaliser, codes)
            speaker = shard.of(batch.speaker) * knows
        with shard.autocast():
            losses = network(speech, speaker, has_speech, events.seen, events.event, events.mark)
        return StepLoss.of(losses)

    return step


def _motion_task(config: PlannedConfig, data: PreparedData, setup: TaskSetup) -> DescentTask:
    shape = config.network
    given = setup.begin(config, data, shape.num_speakers)
    plans = prepare_plans(data, shape.num_speakers)
    targets = prepare_targets(data, shape.rotation_space, shape.root, open_body_skeleton())
    known, prior = fit_motion_prior(data, targets, shape, given)
    network = PlannedNetwork(shape, prior)
    setup.put_weights_into(network, given, may_lack=True)  # they may know of no plans
    normaliser = known.to(setup.shard.device)

    def told_plan(batch: Batch, draws: Draws) -> dict[str, Tensor]:
        tracks, kinds = (draws.shard.of(one) for one in plans.of(batch, shape.speech_context))
        return {"tracks": tracks, "kinds": kinds, "has_plan": draws.keep(config.plan_dropout)}

    step = motion_step(config, normaliser, targets, compile_step=setup.compiles, more=told_plan)
    return DescentTask(
        setup, config, network, step, normaliser, shape.window_frames, shape.speech_context,
        setup.compiles, {"kinds.names": plans.table.tensors()["kinds.names"]},
    )  # fmt: skip
