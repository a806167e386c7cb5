"""Training of the expression network."""

import torch
from torch import nn

from model.data.annotated import Plans, prepare_plans
from model.data.prepared import Batch, PreparedData
from model.motion.packing import Normaliser
from model.plan.tracks import FACE_TRACKS
from model.sampling.flow import interpolate, time_weight
from model.systems.face.config import FaceTrainConfig
from model.systems.face.face import FaceNetwork
from model.training import losses
from model.training.parallel import WHOLE, Draws, Shard
from model.training.targets import conditions, fit_face_prior
from model.training.task import DescentTask, StepFunction, StepLoss, TaskSetup


def make_task(config: FaceTrainConfig, data: PreparedData, setup: TaskSetup) -> DescentTask:
    """The task of the expression network.

    Raises:
        CheckpointError: if the weights to start from are missing, damaged or of another shape.
        DataError: if a speaker's number does not fit the network's table, or a clip has no
            annotated plan and the network shall be told plans.
    """
    shape = config.expression
    given = setup.begin(config, data, shape.num_speakers)
    statistics, prior = fit_face_prior(data, shape, given)
    normaliser = statistics.to(setup.shard.device)
    network = FaceNetwork(shape, prior)
    setup.put_weights_into(network, given, may_lack=True)
    plans = prepare_plans(data, shape.num_speakers) if config.plan_dropout < 1 else None
    step = expression_step(config, normaliser, plans)
    return DescentTask(
        setup, config, network, step, normaliser, shape.window_frames, shape.speech_context
    )


def expression_step(
    config: FaceTrainConfig, normaliser: Normaliser, plans: Plans | None
) -> StepFunction:
    """The loss of the expression network on one batch."""
    seed_frames = config.expression.seed_frames

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        draws = Draws(len(batch.clips), generator, shard)
        with torch.no_grad():
            units = shard.of(batch.expression)
            x_1 = normaliser.normalise(units)
            x_0 = draws.noise(x_1.shape[1:])
            t = draws.flow_times(config.flow_time_power)
            told = conditions(config, network, batch, draws, hidden=("seed", "speaker"))
            if plans is not None:
                tracks, _ = plans.of(batch, config.expression.speech_context)
                told |= {
                    "tracks": shard.of(tracks[..., FACE_TRACKS]),
                    "has_plan": draws.keep(config.plan_dropout),
                }
        with shard.autocast():
            predicted = network(interpolate(x_0, x_1, t), t, seed=x_1[:, :seed_frames], **told)
        scaled = normaliser.scaled(normaliser.restore(predicted.float()))
        wanted = normaliser.scaled(units)
        terms = {
            "simple": losses.simple_loss(scaled, wanted),
            "difference": losses.difference_loss(scaled, wanted),
        }
        by_sample = time_weight(t, config.time_weight_floor)
        return StepLoss.of({name: (by_sample * term).mean() for name, term in terms.items()})

    return step
