"""Training of GlobalDiff's ladder and of our own system."""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import Decoded, Normaliser, decode
from model.networks.autoencoder import FrozenEncoder, load_encoder
from model.networks.branch import PriorNetwork
from model.sampling.flow import interpolate, time_weight
from model.systems.globaldiff import constraints
from model.systems.globaldiff.config import GlobalDiffConfig, LossConfig
from model.systems.globaldiff.network import MotionNetwork
from model.training import losses
from model.training.losses import geometric_terms, positions_of, weighted
from model.training.parallel import WHOLE, Draws, Shard
from model.training.rate import can_compile, compiled
from model.training.statistics import fit_motion_prior, fit_normaliser
from model.training.targets import Targets, heard, prepare_targets
from model.training.task import (
    DescentTask,
    StepFunction,
    StepLoss,
    TaskSetup,
    check_speakers,
)

ENCODER = "motion-vae"


def make_task(config: GlobalDiffConfig, data: PreparedData, setup: TaskSetup) -> DescentTask:
    """The task of ``config.system``.

    Raises:
        CheckpointError: if weights are missing, damaged or of another shape.
        DataError: if a speaker's number does not fit the network's table.
    """
    shape, device = config.network, setup.shard.device
    check_speakers(data, shape.num_speakers)
    torch.manual_seed(config.random_seed)
    given = setup.given()
    encoder = None
    if config.loss.motion > 0:
        encoder = load_encoder(setup.helpers, ENCODER, device)
    targets = prepare_targets(data, shape.rotation_space, shape.root, open_body_skeleton())
    statistics: dict[str, Tensor] = {}
    if shape.prior:
        known, prior = fit_motion_prior(data, targets, shape, config.mirror, given)
        statistics["prior.covariance"] = prior.covariance
        network: nn.Module = PriorNetwork(
            shape, prior, channels=shape.motion_dim, expression_dim=shape.expression_dim
        )
    else:
        known = (
            given.normaliser
            if given
            else fit_normaliser(
                data, targets, shape.window_frames, config.mirror, config.representation
            )
        )
        network = MotionNetwork(shape)
        network.start_at(mean_vector(known, targets))
    normaliser = known.to(device)
    compiles = setup.may_compile and can_compile()
    setup.put_weights_into(network, given)
    return DescentTask(
        config, network, motion_step(config, normaliser, targets, encoder, compiles), normaliser,
        shape.window_frames, shape.speech_context, setup.shard, compiles, statistics,
    )  # fmt: skip


def mean_vector(normaliser: Normaliser, targets: Targets) -> Float[Tensor, "333"]:
    """The mean normalised motion vector, from every hundredth frame."""
    vectors = torch.from_numpy(np.array(targets.vectors[::100]))
    return normaliser.normalise(vectors).mean(0)


def motion_step(
    config: GlobalDiffConfig,
    normaliser: Normaliser,
    targets: Targets,
    encoder: FrozenEncoder | None = None,
    compile_step: bool = False,
    told: Callable[[Batch, Draws, Shard], dict[str, Tensor]] | None = None,
) -> StepFunction:
    """The loss of a motion network on one batch.

    The network hears the recorded face: at generation it gets one that was drawn to look like it.

    Args:
        encoder: L_m's encoder, if L_m has a weight.
        compile_step: compile the terms of training steps; the network compiles itself.
        told: what else the network is told of a batch, by name.
    """
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
        terms |= geometric_terms(weights, decoded, target)
        terms |= constraint_terms(weights, decoded, target, encoder)
        by_sample = time_weight(t, weights.time_weight_floor)
        return {name: (by_sample * term).mean() for name, term in terms.items()}

    compiled_terms = compiled(terms_of) if compile_step else terms_of

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        draws = Draws(len(batch.clips), generator, shard)
        with torch.no_grad():
            vectors, target = targets.of(batch.rows(shard.mine), rotations=needs_rotations)
            target = target.to(shard.device)
            vectors = vectors.to(shard.device)
            x_1 = normaliser.normalise(vectors)
            x_0 = draws.noise(x_1.shape[1:])
            t = draws.flow_times(config.flow_time_power)
            has_seed = draws.keep(config.seed_dropout)
            speaker = shard.of(batch.speaker) * draws.keep(config.speaker_dropout)
            has_speech = draws.keep(config.speech_dropout)
            speech = shard.of(heard(config, network, batch, generator))
            more = told(batch, draws, shard) if told else {}
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
                **more,
            )
        measured = compiled_terms if network.training else terms_of
        return StepLoss.of(measured(predicted.float(), vectors, target, t, has_seed))

    return step


def constraint_terms(
    weights: LossConfig, predicted: Decoded, target: Decoded, encoder: FrozenEncoder | None
) -> dict[str, Float[Tensor, " B"]]:
    """The paper's three constraints, weighted, one value per sample; those of weight 0 are left
    out.

    Raises:
        ValueError: if L_m has a weight but there is no encoder.
    """
    positions = positions_of(weights, predicted, target)
    terms = {
        "joint": lambda: _joint_term(predicted, target),
        "skeleton": lambda: constraints.skeleton_structure_loss(*positions),
        "motion": lambda: _motion_term(predicted, target, encoder),
    }
    return weighted(weights, terms)


def _joint_term(predicted: Decoded, target: Decoded) -> Float[Tensor, " B"]:
    if predicted.global_rot is None or target.global_rot is None:
        raise ValueError("L_j has a weight, but rotations were left out.")
    return constraints.joint_structure_loss(
        predicted.global_rot, target.global_rot, constraints.octahedron_anchors()
    )


def _motion_term(
    predicted: Decoded, target: Decoded, encoder: FrozenEncoder | None
) -> Float[Tensor, " B"]:
    if encoder is None:
        raise ValueError("L_m has a weight, but no motion encoder was given.")
    if predicted.global_vectors is None or target.global_vectors is None:
        raise ValueError("L_m has a weight, but rotations were left out.")
    with torch.no_grad():
        wanted = encoder.codes(target.global_vectors)
    return constraints.temporal_structure_loss(encoder.codes(predicted.global_vectors), wanted)
