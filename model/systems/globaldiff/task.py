"""The losses of GlobalDiff's ladder and of our own system, and what trains them.

L_simple and L_pos are eq. 7's; L_j, L_s and L_m are the paper's joint, skeleton and temporal
structure constraints, pure functions that return one value per sample.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from conventions.joints import PARENTS
from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import Decoded, Normaliser, decode
from model.networks.autoencoder import FrozenEncoder, load_encoder
from model.sampling.flow import interpolate, time_weight
from model.systems.globaldiff.config import GlobalDiffConfig, GlobalDiffLoss
from model.systems.globaldiff.network import MotionNetwork, make_network
from model.training import losses
from model.training.losses import geometric_terms, positions_of, weighted
from model.training.parallel import WHOLE, Draws, Shard, compiled
from model.training.targets import (
    Targets,
    conditions,
    fit_motion_prior,
    fit_normaliser,
    prepare_targets,
)
from model.training.task import DescentTask, StepFunction, StepLoss, TaskSetup

ENCODER = "motion-vae"
ANCHOR_DISTANCE_M = 0.05
SHORTEST_BONE_M = 1e-4
"""A bone below this length has no direction."""


def make_task(config: GlobalDiffConfig, data: PreparedData, setup: TaskSetup) -> DescentTask:
    """See `Family.make_task`."""
    shape, device = config.network, setup.shard.device
    given = setup.begin(config, data, shape.num_speakers)
    encoder = load_encoder(setup.helpers, ENCODER, device) if config.loss.motion > 0 else None
    targets = prepare_targets(data, shape.rotation_space, shape.root, open_body_skeleton())
    prior = None
    if shape.prior:
        known, prior = fit_motion_prior(data, targets, shape, given)
    elif given:
        known = given.normaliser
    else:
        known = fit_normaliser(data, targets, shape.window_frames, config.representation)
    network = make_network(shape, prior)
    if isinstance(network, MotionNetwork):
        network.start_at(mean_vector(known, targets))
    normaliser = known.to(device)
    setup.put_weights_into(network, given)
    step = motion_step(config, normaliser, targets, encoder, setup.compiles)
    return DescentTask(
        setup, config, network, step, normaliser, shape.window_frames, shape.speech_context,
        setup.compiles,
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
    more: Callable[[Batch, Draws], dict[str, Tensor]] | None = None,
) -> StepFunction:
    """The loss of a motion network on one batch.

    The network hears the recorded face: at generation it gets one that was drawn to look like it.

    Args:
        encoder: L_m's encoder, if L_m has a weight.
        compile_step: compile the terms of training steps; the network compiles itself.
        more: what else the network is told of a batch, by name.
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
            told = conditions(config, network, batch, draws)
            told |= {"expression": shard.of(batch.expression), "seed": x_1[:, :seed_frames]}
            told |= more(batch, draws) if more else {}
        with shard.autocast():
            predicted = network(interpolate(x_0, x_1, t), t, **told)
        measured = compiled_terms if network.training else terms_of
        return StepLoss.of(measured(predicted.float(), vectors, target, t, told["has_seed"]))

    return step


def constraint_terms(
    weights: GlobalDiffLoss, predicted: Decoded, target: Decoded, encoder: FrozenEncoder | None
) -> dict[str, Float[Tensor, " B"]]:
    """The paper's three constraints, weighted, one value per sample; those of weight 0 are left
    out. L_j and L_m need rotations and vectors, L_m its encoder."""
    positions = positions_of(weights, predicted, target)

    def joint() -> Float[Tensor, " B"]:
        assert predicted.global_rot is not None and target.global_rot is not None
        anchors = octahedron_anchors()
        return joint_structure_loss(predicted.global_rot, target.global_rot, anchors)

    def motion() -> Float[Tensor, " B"]:
        assert encoder is not None
        assert predicted.global_vectors is not None and target.global_vectors is not None
        with torch.no_grad():
            wanted = encoder.codes(target.global_vectors)
        return temporal_structure_loss(encoder.codes(predicted.global_vectors), wanted)

    terms = {
        "joint": joint,
        "skeleton": lambda: skeleton_structure_loss(*positions),
        "motion": motion,
    }
    return weighted(weights, terms)


def octahedron_anchors() -> Float[Tensor, "6 3"]:
    """N = 6 anchors, one on each half axis of a joint's frame, 5 cm from it (official code)."""
    axes = torch.eye(3)
    return ANCHOR_DISTANCE_M * torch.cat([axes, -axes])


def joint_structure_loss(
    rotmat: Float[Tensor, "B T J 3 3"],
    target: Float[Tensor, "B T J 3 3"],
    anchors: Float[Tensor, "N 3"],
) -> Float[Tensor, " B"]:
    """L_j, GlobalDiff eqs. 8 to 10: squared distance of turned anchors, in metres squared.

    ``v_hat = R v`` (eq. 8) and ``v_tilde = R_gt v`` (eq. 9); the mean over joints, anchors and
    frames of ``|v_hat - v_tilde|^2`` (eq. 10). A joint's position does not enter.

    Args:
        rotmat: global rotations. With anchors that span space, zero means equal rotations.
    """
    turned = (rotmat - target) @ anchors.to(rotmat).T  # (B, T, J, 3, N)
    return turned.square().sum(-2).mean((1, 2, 3))


def bone_directions(
    positions: Float[Tensor, "*batch J 3"],
) -> tuple[Float[Tensor, "*batch bones 3"], Float[Tensor, "*batch bones"]]:
    """Unit vectors from parents to joints (GlobalDiff eq. 11), and each bone's length in metres.

    A degenerate bone gets the zero vector.
    """
    bones = positions[..., 1:, :] - positions[..., list(PARENTS[1:]), :]
    length = bones.square().sum(-1).clamp_min(1e-18).sqrt()
    is_valid = length > SHORTEST_BONE_M
    safe = torch.where(is_valid, length, torch.ones_like(length))
    return bones / safe[..., None] * is_valid[..., None], length


def skeleton_structure_loss(
    positions: Float[Tensor, "B T J 3"],
    target: Float[Tensor, "B T J 3"],
) -> Float[Tensor, " B"]:
    """L_s, GlobalDiff eq. 13: mean squared difference of the cosines between every two bones (the
    angular matrix D D^T of eq. 12), over valid pairs.

    Valid are the ordered pairs of two different bones that have a direction in prediction and
    target. The matrices are never formed: with D and E the masked directions, S = D + E and
    M = D - E,

        |D D^T - E E^T|^2 = (tr(S^T S M^T M) + tr(M^T S M^T S)) / 2

    holds for any number of bones, needs 3 x 3 products only, and loses no digits where the two are
    nearly equal.
    """
    predicted, length = bone_directions(positions)
    wanted, wanted_length = bone_directions(target)
    is_valid = (length > SHORTEST_BONE_M) & (wanted_length > SHORTEST_BONE_M)
    predicted, wanted = predicted * is_valid[..., None], wanted * is_valid[..., None]
    total, difference = predicted + wanted, predicted - wanted

    def gram(a: Tensor, b: Tensor) -> Float[Tensor, "B T 3 3"]:
        return a.transpose(-1, -2) @ b

    cross = gram(difference, total)
    squared = (
        (gram(total, total) * gram(difference, difference)).sum((-1, -2))
        + (cross * cross.transpose(-1, -2)).sum((-1, -2))
    ) / 2
    count = is_valid.sum(-1)
    pairs = (count * (count - 1)).clamp_min(1)
    return (squared / pairs).mean(-1)


def temporal_structure_loss(
    codes: Sequence[Float[Tensor, "B _ dim"]],
    target: Sequence[Float[Tensor, "B _ dim"]],
) -> Float[Tensor, " B"]:
    """L_m, GlobalDiff eq. 15: squared distance of the codes of two motions.

    Args:
        codes: ``z = g(X)`` (eq. 14), one tensor for each scale of the encoder; every scale counts
            alike, as the mean over its numbers.
    """
    squared = [(a - b).square().mean((1, 2)) for a, b in zip(codes, target, strict=True)]
    return torch.stack(squared).sum(0)
