"""What a training step descends: the losses of the motion, expression and autoencoder networks.

A step draws its random numbers for the whole batch and computes its shard of it, so that several
processes together do what one does alone.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from model.data.prepared import Batch, PreparedData
from model.motion.decoding import Decoded, decode, geometric_terms, to_vectors
from model.motion.packing import AXIS_ANGLE_GROUPS, Normaliser
from model.motion.skeleton import open_body_skeleton
from model.networks.autoencoder import FrozenEncoder
from model.sampling.flow import interpolate, time_weight
from model.sampling.prior import GaussianPrior, fit_components, fit_prior
from model.speech.features import augment_mel
from model.storage.settings import RotationSpace, TrainConfig
from model.systems.globaldiff import constraints
from model.training import losses
from model.training.parallel import WHOLE, Shard
from model.training.rate import compiled
from model.training.targets import Targets


@dataclass(frozen=True)
class StepLoss:
    """The loss to descend, and its parts for the log."""

    total: Float[Tensor, ""]
    parts: dict[str, Float[Tensor, ""]]
    """Detached, with ``total`` among them."""


PRIOR_BATCHES, PRIOR_BATCH_SIZE = 12, 256
FACE_STD_FLOOR = 0.02
"""Face units that hardly ever move are not blown up to unit variance."""

StepFunction = Callable[[nn.Module, Batch, torch.Generator, Shard], StepLoss]


def fit_vector_normaliser(
    config: TrainConfig, space: RotationSpace, data: PreparedData
) -> Normaliser:
    """Statistics of motion vectors over (at most 400 windows of) the training split."""
    batch = _statistics_batch(config, data)
    vectors = to_vectors(space, batch.poses, batch.transl)
    return Normaliser.fit(vectors.flatten(0, 1), config.representation)


def fit_normaliser(config: TrainConfig, data: PreparedData, targets: Targets) -> Normaliser:
    """The same of what a motion network aims at."""
    vectors, _ = targets.of(_statistics_batch(config, data), rotations=False)
    groups = AXIS_ANGLE_GROUPS if targets.space == "axis-angle" else None
    return Normaliser.fit(vectors.flatten(0, 1), config.representation, groups)


def _statistics_batch(config: TrainConfig, data: PreparedData) -> Batch:
    window = config.network.window_frames
    rng = np.random.default_rng(0)
    return data.window_batch(data.of_split("train"), window, 400, rng, config.mirror)


def fit_motion_prior(
    config: TrainConfig, data: PreparedData, targets: Targets
) -> tuple[Normaliser, GaussianPrior]:
    """Components of motion and their linear-Gaussian prior, from windows of the training split."""
    shape = config.network
    batches = [targets.windows(batch) for batch in _prior_batches(data, shape.window_frames)]
    return _with_components(fit_normaliser(config, data, targets), batches, shape.seed_frames)


def fit_face(config: TrainConfig, data: PreparedData) -> tuple[Normaliser, GaussianPrior]:
    """The same of face units."""
    shape = config.expression
    batches = [batch.expression for batch in _prior_batches(data, shape.window_frames)]
    flat = torch.cat([batch.flatten(0, 1) for batch in batches])
    normaliser = Normaliser(flat.mean(0), flat.std(0).clamp_min(FACE_STD_FLOOR))
    return _with_components(normaliser, batches, shape.seed_frames)


def _with_components(
    normaliser: Normaliser, windows: Sequence[Float[Tensor, "N T C"]], seed_frames: int
) -> tuple[Normaliser, GaussianPrior]:
    mean = torch.cat([batch.flatten(0, 1) for batch in windows]).mean(0)
    centred = Normaliser(mean, normaliser.std)
    mix, unmix = fit_components([centred.scaled(batch) for batch in windows])
    mixing = replace(centred, mix=mix, unmix=unmix)
    return mixing, fit_prior([mixing.normalise(batch) for batch in windows], seed_frames)


def _prior_batches(data: PreparedData, window: int) -> Iterator[Batch]:
    clips = data.of_split("train")
    for k in range(PRIOR_BATCHES):
        yield data.window_batch(clips, window, PRIOR_BATCH_SIZE, np.random.default_rng([k, 17]))


def mean_vector(normaliser: Normaliser, targets: Targets) -> Float[Tensor, "333"]:
    """The mean normalised motion vector, from every hundredth frame."""
    vectors = torch.from_numpy(np.array(targets.vectors[::100]))
    return normaliser.normalise(vectors).mean(0)


def motion_step(
    config: TrainConfig,
    normaliser: Normaliser,
    targets: Targets,
    encoder: FrozenEncoder | None = None,
    compile_step: bool = False,
) -> StepFunction:
    """The loss of a motion network on one batch.

    The network hears the recorded face: at generation it gets one that was drawn to look like it.

    Args:
        encoder: L_m's encoder, if L_m has a weight.
        compile_step: compile the terms of training steps; the network compiles itself.
    """
    constraints.check_anchors(constraints.octahedron_anchors())
    weights = config.loss
    seed_frames = config.network.seed_frames
    needs_rotations = weights.joint > 0 or weights.motion > 0
    skeleton = targets.skeleton

    def terms_of(
        predicted: Float[Tensor, "B T C"],
        vectors: Float[Tensor, "B T C"],
        target: Decoded,
        t: Float[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
    ) -> dict[str, Float[Tensor, ""]]:
        restored = normaliser.restore(predicted)
        scaled, wanted = normaliser.scaled(restored), normaliser.scaled(vectors)
        seed_error = losses.simple_loss(scaled[:, :seed_frames], wanted[:, :seed_frames])
        terms = {
            "simple": weights.simple * losses.simple_loss(scaled, wanted),
            "seed": weights.seed * seed_frames / vectors.shape[1] * seed_error * has_seed,
        }
        decoded = decode(restored, targets.space, skeleton, targets.root)
        terms |= geometric_terms(weights, decoded, target, encoder)
        by_sample = time_weight(t, weights.time_weight_floor)
        return {name: (by_sample * term).mean() for name, term in terms.items()}

    compiled_terms = compiled(terms_of) if compile_step else terms_of

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        size = len(batch.clips)

        def keep(dropout: float) -> Bool[Tensor, " B"]:
            return shard.of(torch.rand(size, generator=generator) >= dropout)

        with torch.no_grad():
            vectors, target = targets.of(batch.rows(shard.mine), rotations=needs_rotations)
            target = target.to(shard.device)
            vectors = vectors.to(shard.device)
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
                expression=shard.of(batch.expression),
                seed=x_1[:, :seed_frames],
                speaker=speaker,
                has_seed=has_seed,
                has_speech=has_speech,
            )
        measured = compiled_terms if network.training else terms_of
        return _summed(measured(predicted.float(), vectors, target, t, has_seed))

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


def expression_step(config: TrainConfig, normaliser: Normaliser) -> StepFunction:
    """The loss of the expression network on one batch."""
    seed_frames = config.expression.seed_frames

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        size = len(batch.clips)
        with torch.no_grad():
            units = shard.of(batch.expression)
            x_1 = normaliser.normalise(units)
            x_0 = shard.of(torch.randn(size, *x_1.shape[1:], generator=generator))
            t = shard.of(torch.rand(size, generator=generator) ** config.flow_time_power)
            has_seed = shard.of(torch.rand(size, generator=generator) >= config.seed_dropout)
            kept = shard.of(torch.rand(size, generator=generator) >= config.speaker_dropout)
            speech = shard.of(_heard(config, network, batch, generator))
        with shard.autocast():
            predicted = network(
                interpolate(x_0, x_1, t),
                t,
                speech=speech,
                seed=x_1[:, :seed_frames],
                speaker=shard.of(batch.speaker) * kept,
                has_seed=has_seed,
                has_speech=torch.ones_like(has_seed),
            )
        scaled = normaliser.scaled(normaliser.restore(predicted.float()))
        wanted = normaliser.scaled(units)
        terms = {
            "simple": config.loss.simple * losses.simple_loss(scaled, wanted),
            "difference": losses.difference_loss(scaled, wanted),
        }
        by_sample = time_weight(t, config.loss.time_weight_floor)
        return _summed({name: (by_sample * term).mean() for name, term in terms.items()})

    return step


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
