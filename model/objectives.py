"""What a training step descends: the losses of the motion and of the expression network."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from model import losses
from model.checkpoint import load_into, load_weights
from model.config import ExpressionConfig, TrainConfig, from_dict
from model.data import Batch, PreparedData
from model.expression import ExpressionNetwork, predict_expressions
from model.flow import interpolate, time_weight
from model.kinematics import global_from_local, joint_positions_from_global
from model.packing import Normaliser, pack, unpack
from model.rotations import matrix_from_axis_angle, matrix_from_rot6d, rot6d_from_matrix
from model.skeleton import open_body_skeleton
from model.speech.features import augment_mel


@dataclass(frozen=True)
class StepLoss:
    """The loss to descend, and its parts for the log."""

    total: Float[Tensor, ""]
    parts: dict[str, float]


StepFunction = Callable[[nn.Module, Batch, torch.Generator], StepLoss]


def to_vectors(config: TrainConfig, batch: Batch) -> Float[Tensor, "B T 333"]:
    """Motion vectors of a batch in the config's rotation space, not normalised."""
    rotmat = matrix_from_axis_angle(batch.poses.unflatten(-1, (-1, 3)))
    if config.network.rotation_space == "global":
        rotmat = global_from_local(rotmat)
    return pack(rot6d_from_matrix(rotmat), batch.transl)


def fit_normaliser(config: TrainConfig, data: PreparedData) -> Normaliser:
    """Statistics over (at most 400 windows of) the training split."""
    rng = np.random.default_rng(0)
    window = config.network.window_frames
    batch = data.window_batch(data.of_split("train"), window, 400, rng)
    return Normaliser.fit(to_vectors(config, batch).flatten(0, 1))


def motion_step(
    config: TrainConfig, normaliser: Normaliser, expressions: Float[Tensor, "N E"]
) -> StepFunction:
    """The loss of a motion network on one batch."""
    skeleton = open_body_skeleton()
    space, weights = config.network.rotation_space, config.loss
    seed_frames = config.network.seed_frames

    def positions(vectors: Float[Tensor, "B T 333"]) -> Float[Tensor, "B T 55 3"]:
        rot6d, transl = unpack(vectors)
        rotmat = matrix_from_rot6d(rot6d)
        global_rot = global_from_local(rotmat) if space == "local" else rotmat
        return joint_positions_from_global(global_rot, skeleton, transl)

    def step(network: nn.Module, batch: Batch, generator: torch.Generator) -> StepLoss:
        size = len(batch.clips)

        def keep(dropout: float) -> Bool[Tensor, " B"]:
            return torch.rand(size, generator=generator) >= dropout

        with torch.no_grad():
            vectors = to_vectors(config, batch)
            target_positions = positions(vectors)
            x_1 = normaliser.normalise(vectors)
            x_0 = torch.randn(x_1.shape, generator=generator)
            t = torch.rand(size, generator=generator)
            speech = batch.speech
            if network.training and config.augment_speech:
                speech = augment_mel(speech, generator)
            has_seed = keep(config.seed_dropout)
            speaker = batch.speaker * keep(config.speaker_dropout)
        predicted = network(
            interpolate(x_0, x_1, t),
            t,
            speech=speech,
            expression=expressions[torch.from_numpy(batch.frames)],
            seed=x_1[:, :seed_frames],
            speaker=speaker,
            has_seed=has_seed,
            has_speech=keep(config.speech_dropout),
        )
        predicted_positions = positions(normaliser.restore(predicted))
        seed_error = losses.simple_loss(predicted[:, :seed_frames], x_1[:, :seed_frames])
        terms = {
            "simple": weights.simple * losses.simple_loss(predicted, x_1),
            "position": weights.position
            * losses.position_loss(predicted_positions, target_positions),
            "velocity": weights.velocity
            * losses.velocity_loss(predicted_positions, target_positions),
            "acceleration": weights.acceleration
            * losses.acceleration_loss(predicted_positions, target_positions),
            "seed": weights.seed * seed_frames / x_1.shape[1] * seed_error * has_seed,
        }
        by_sample = time_weight(t, weights.time_weight_floor)
        means = {name: (by_sample * term).mean() for name, term in terms.items()}
        total = torch.stack(list(means.values())).sum()
        parts = {name: float(term.detach()) for name, term in means.items()}
        return StepLoss(total, parts | {"total": float(total.detach())})

    return step


def expression_step(config: TrainConfig) -> StepFunction:
    """The loss of the expression network on one batch."""

    def step(network: nn.Module, batch: Batch, generator: torch.Generator) -> StepLoss:
        speech = batch.speech
        speaker = batch.speaker
        if network.training:
            kept = torch.rand(len(speaker), generator=generator) >= config.speaker_dropout
            speaker = speaker * kept
            if config.augment_speech:
                speech = augment_mel(speech, generator)
        total = losses.expression_loss(network(speech, speaker), batch.expression)
        return StepLoss(total, {"total": float(total.detach())})

    return step


def predicted_expressions(data: PreparedData, folder: Path) -> Float[Tensor, "N E"]:
    """What the (frozen) expression network says for every frame: what generation will see."""
    tensors, card = load_weights(folder, "expression")
    network = ExpressionNetwork(from_dict(ExpressionConfig, card["config"]["expression"]))
    load_into(network, tensors, "network.", "expression")
    network.eval()
    result = torch.empty(len(data.speech), network.config.expression_dim)
    for clip in data.clips:
        speech = torch.from_numpy(data.speech[clip.start : clip.stop].astype(np.float32))
        result[clip.start : clip.stop] = predict_expressions(network, speech, clip.speaker)
    return result.clone()
