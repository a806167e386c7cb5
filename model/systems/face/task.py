"""Training of the expression network."""

import torch
from torch import nn

from model.data.annotations import load_plan_annotations
from model.data.prepared import Batch, PreparedData
from model.plan.plan_features import HEAD_FACE_TRACKS
from model.sampling.flow import flow_loss_weight, interpolate
from model.systems.face.config import FaceTrainConfig
from model.systems.face.face import FaceNetwork
from model.training import losses
from model.training.parallel import ShardedRandom
from model.training.targets import fit_or_reuse_face_prior, mask_conditions
from model.training.task import SingleNetworkTask, StepLoss, TaskSetup


class FaceTask(SingleNetworkTask):
    """Flow matching of blendshapes; plans are an input if clips have annotated ones."""

    config: FaceTrainConfig

    def __init__(self, config: FaceTrainConfig, data: PreparedData, setup: TaskSetup) -> None:
        shape = config.expression
        weights = setup.seed_and_read_initial_weights(config, data, shape.num_speakers)
        normaliser, prior = fit_or_reuse_face_prior(data, shape, weights)
        network = FaceNetwork(shape, prior)
        super().__init__(
            setup, config, weights, network, normaliser, shape.window_frames, shape.speech_context
        )
        self.plans = (
            load_plan_annotations(data, shape.num_speakers) if config.plan_dropout < 1 else None
        )

    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        config, shape, shard = self.config, self.config.expression, draws.shard
        with torch.no_grad():
            units = shard.local_rows(batch.arkit_weights)
            x_1 = self.normaliser.normalise(units)
            x_0 = draws.noise(x_1.shape[1:])
            t = draws.flow_times(config.flow_time_power)
            conditions = mask_conditions(
                config, network, batch, draws, droppable=("seed", "speaker")
            )
            conditions["seed"] = x_1[:, : shape.seed_frames]
            if self.plans is not None:
                tracks, _ = self.plans.tracks_and_kinds(batch, shape.speech_context)
                conditions["tracks"] = shard.local_rows(tracks[..., HEAD_FACE_TRACKS])
                conditions["has_plan"] = draws.keep_mask(config.plan_dropout)
        with shard.autocast():
            predicted = network(interpolate(x_0, x_1, t), t, **conditions)
        scaled = self.normaliser.standardise(self.normaliser.restore(predicted.float()))
        wanted = self.normaliser.standardise(units)
        terms = {
            "simple": losses.simple_loss(scaled, wanted),
            "difference": losses.first_difference_loss(scaled, wanted),
        }
        by_sample = flow_loss_weight(t, config.time_weight_floor)
        return StepLoss({name: (by_sample * term).mean() for name, term in terms.items()})


make_task = FaceTask
