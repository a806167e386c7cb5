"""What a training step descends: the losses of the motion, expression and autoencoder networks.

A step draws its random numbers for the whole batch and computes its shard of it, so that several
processes together do what one does alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from model import constraints, losses
from model.autoencoder import FrozenEncoder
from model.checkpoint import load_into, load_weights
from model.config import ExpressionConfig, RotationSpace, TrainConfig, from_dict
from model.data import Batch, PreparedData
from model.decoding import decode, geometric_terms, to_vectors
from model.expression import ExpressionNetwork, predict_expressions
from model.flow import interpolate, time_weight
from model.mirror import mirror_face_units
from model.packing import Normaliser
from model.parallel import WHOLE, Shard
from model.skeleton import open_body_skeleton
from model.speech.features import augment_mel


@dataclass(frozen=True)
class StepLoss:
    """The loss to descend, and its parts for the log."""

    total: Float[Tensor, ""]
    parts: dict[str, Float[Tensor, ""]]
    """Detached, with ``total`` among them."""


StepFunction = Callable[[nn.Module, Batch, torch.Generator, Shard], StepLoss]


def fit_normaliser(config: TrainConfig, space: RotationSpace, data: PreparedData) -> Normaliser:
    """Statistics over (at most 400 windows of) the training split."""
    rng = np.random.default_rng(0)
    window = config.network.window_frames
    batch = data.window_batch(data.of_split("train"), window, 400, rng, config.mirror)
    return Normaliser.fit(to_vectors(space, batch.poses, batch.transl).flatten(0, 1))


def motion_step(
    config: TrainConfig,
    normaliser: Normaliser,
    expressions: Float[Tensor, "N E"],
    encoder: FrozenEncoder | None = None,
) -> StepFunction:
    """The loss of a motion network on one batch.

    Args:
        expressions: the frozen expression network's word for every frame of the data.
        encoder: L_m's encoder, if L_m has a weight.
    """
    skeleton = open_body_skeleton()
    constraints.check_anchors(constraints.octahedron_anchors())
    space, weights = config.network.rotation_space, config.loss
    seed_frames = config.network.seed_frames

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        size = len(batch.clips)

        def keep(dropout: float) -> Bool[Tensor, " B"]:
            return shard.of(torch.rand(size, generator=generator) >= dropout)

        with torch.no_grad():
            vectors = to_vectors(space, shard.of(batch.poses), shard.of(batch.transl))
            target = decode(vectors, space, skeleton)
            x_1 = normaliser.normalise(vectors)
            x_0 = shard.of(torch.randn(size, *x_1.shape[1:], generator=generator))
            t = shard.of(torch.rand(size, generator=generator) ** config.flow_time_power)
            has_seed = keep(config.seed_dropout)
            speaker = shard.of(batch.speaker) * keep(config.speaker_dropout)
            has_speech = keep(config.speech_dropout)
            speech = shard.of(_heard(config, network, batch, generator))
        with shard.autocast():
            predicted = network(
                interpolate(x_0, x_1, t),
                t,
                speech=speech,
                expression=shard.of(_faces(expressions, batch)),
                seed=x_1[:, :seed_frames],
                speaker=speaker,
                has_seed=has_seed,
                has_speech=has_speech,
            )
        predicted = predicted.float()
        seed_error = losses.simple_loss(predicted[:, :seed_frames], x_1[:, :seed_frames])
        terms = {
            "simple": weights.simple * losses.simple_loss(predicted, x_1),
            "seed": weights.seed * seed_frames / x_1.shape[1] * seed_error * has_seed,
        }
        decoded = decode(normaliser.restore(predicted), space, skeleton)
        terms |= geometric_terms(weights, decoded, target, encoder)
        by_sample = time_weight(t, weights.time_weight_floor)
        return _summed({name: (by_sample * term).mean() for name, term in terms.items()})

    return step


def autoencoder_step(config: TrainConfig, normaliser: Normaliser) -> StepFunction:
    """The loss of a motion autoencoder: its input back, its geometry, and the codes' KL term."""
    skeleton = open_body_skeleton()
    shape = config.autoencoder
    space = shape.rotation_space

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        size, num_frames = batch.poses.shape[:2]
        num_frames -= num_frames % max(shape.scales)
        vectors = to_vectors(space, shard.of(batch.poses), shard.of(batch.transl))
        vectors = vectors[:, :num_frames]
        motion = normaliser.normalise(vectors)
        hidden, noise = None, None
        if network.training:
            draw = torch.rand(size, num_frames, generator=generator)
            hidden = shard.of(draw < shape.mask_share)
            if shape.kl_weight > 0:
                noise = [
                    shard.of(torch.randn(size, num_frames // scale, shape.latent_dim,
                                         generator=generator))
                    for scale in sorted(shape.scales)
                ]  # fmt: skip
        with shard.autocast():
            restored, codes = network(motion, hidden, noise)
        restored = restored.float()
        terms = {"simple": config.loss.simple * losses.simple_loss(restored, motion)}
        terms |= geometric_terms(
            config.loss,
            decode(normaliser.restore(restored), space, skeleton),
            decode(vectors, space, skeleton),
            None,
        )
        if shape.kl_weight > 0:
            terms["kl"] = shape.kl_weight * losses.kl_loss(codes)
        return _summed({name: term.mean() for name, term in terms.items()})

    return step


def expression_step(config: TrainConfig) -> StepFunction:
    """The loss of the expression network on one batch."""

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        speech = shard.of(_heard(config, network, batch, generator))
        speaker = batch.speaker
        if network.training:
            kept = torch.rand(len(speaker), generator=generator) >= config.speaker_dropout
            speaker = speaker * kept
        with shard.autocast():
            predicted = network(speech, shard.of(speaker)).float()
        return _summed({"face": losses.expression_loss(predicted, shard.of(batch.expression))})

    return step


def _faces(expressions: Float[Tensor, "N E"], batch: Batch) -> Float[Tensor, "B T E"]:
    """The rows of a batch, mirrored where its motion is."""
    units = expressions[torch.from_numpy(batch.frames)]
    return torch.where(batch.mirrored[:, None, None], mirror_face_units(units), units)


def _heard(
    config: TrainConfig, network: nn.Module, batch: Batch, generator: torch.Generator
) -> Float[Tensor, "B T dim"]:
    """The speech features of the whole batch, as some microphone might have caught them."""
    if network.training and config.augment_speech:
        return augment_mel(batch.speech, generator)
    return batch.speech


def _summed(means: dict[str, Float[Tensor, ""]]) -> StepLoss:
    total = torch.stack(list(means.values())).sum()
    parts = {name: mean.detach() for name, mean in means.items()}
    return StepLoss(total, parts | {"total": total.detach()})


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
