"""Training and losses of GlobalDiff's ablation and of this project's system.

L_simple and L_pos are eq. 7's; L_j, L_s and L_m are the joint, skeleton and motion constraints
(the paper's joint, skeleton and temporal structure constraints), pure functions that return one
value per sample.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from conventions.joints import PARENTS
from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import DecodedMotion, Normaliser, decode
from model.networks.autoencoder import FrozenMotionEncoder, load_motion_encoder
from model.sampling.flow import flow_loss_weight, interpolate
from model.sampling.prior import GaussianPrior
from model.systems.globaldiff.config import GlobalDiffLossWeights, GlobalDiffTrainConfig
from model.systems.globaldiff.system import MotionNetwork, make_network
from model.training import losses
from model.training.losses import geometric_terms, positions_to_compare, weighted_terms
from model.training.parallel import ShardedRandom, compiled
from model.training.targets import (
    Targets,
    fit_motion_normaliser,
    fit_or_reuse_motion_prior,
    mask_conditions,
    prepare_targets,
)
from model.training.task import SingleNetworkTask, StepLoss, TaskSetup

ENCODER = "motion-vae"
ANCHOR_DISTANCE_M = 0.05
SHORTEST_BONE_M = 1e-4
"""Shortest bone (m) with a defined direction."""


class MotionTask(SingleNetworkTask):
    """Flow matching of motion with constraints, conditioned on the recorded face."""

    is_worth_compiling = True
    config: GlobalDiffTrainConfig

    def __init__(self, config: GlobalDiffTrainConfig, data: PreparedData, setup: TaskSetup) -> None:
        shape = config.network
        weights = setup.seed_and_read_initial_weights(config, data, shape.num_speakers)
        self.encoder = None
        if config.loss.motion > 0:
            self.encoder = load_motion_encoder(setup.helper_weights, ENCODER, setup.shard.device)
        self.targets = prepare_targets(data, shape.rotation_space, shape.root, open_body_skeleton())
        prior = None
        if shape.has_prior:
            normaliser, prior = fit_or_reuse_motion_prior(data, self.targets, shape, weights)
        elif weights:
            normaliser = weights.normaliser
        else:
            normaliser = fit_motion_normaliser(
                data, self.targets, shape.window_frames, config.representation
            )
        network = self.make_network(config, prior)
        if isinstance(network, MotionNetwork):
            network.initialise_output(mean_vector(normaliser, self.targets))
        super().__init__(
            setup, config, weights, network, normaliser, shape.window_frames, shape.speech_context
        )
        self.training_terms = compiled(self.terms) if self.compiles else self.terms

    def make_network(self, config: GlobalDiffTrainConfig, prior: GaussianPrior | None) -> nn.Module:
        """Make the network, with a prior if there is one."""
        return make_network(config.network, prior)

    def extra_inputs(self, batch: Batch, draws: ShardedRandom) -> dict[str, Tensor]:
        """Return further inputs of the network for a batch, by name."""
        return {}

    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        config, weights, shard = self.config, self.config.loss, draws.shard
        with torch.no_grad():
            needs_rotations = weights.joint > 0 or weights.motion > 0
            vectors, target = self.targets.for_batch(
                batch.part(shard.rows), with_rotations=needs_rotations
            )
            vectors, target = vectors.to(shard.device), target.to(shard.device)
            x_1 = self.normaliser.normalise(vectors)
            x_0 = draws.noise(x_1.shape[1:])
            t = draws.flow_times(config.flow_time_power)
            conditions = mask_conditions(config, network, batch, draws)
            conditions["expression"] = shard.local_rows(batch.arkit_weights)
            conditions["seed"] = x_1[:, : config.network.seed_frames]
            conditions |= self.extra_inputs(batch, draws)
        with shard.autocast():
            predicted = network(interpolate(x_0, x_1, t), t, **conditions)
        measured = self.training_terms if network.training else self.terms
        return StepLoss(measured(predicted.float(), vectors, target, t, conditions["has_seed"]))

    def terms(
        self,
        predicted: Float[Tensor, "B T C"],
        vectors: Float[Tensor, "B T C"],
        target: DecodedMotion,
        t: Float[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
    ) -> dict[str, Float[Tensor, ""]]:
        """Compute the weighted terms as means over the batch."""
        weights, seed_frames = self.config.loss, self.config.network.seed_frames
        restored = self.normaliser.restore(predicted)
        scaled, wanted = self.normaliser.standardise(restored), self.normaliser.standardise(vectors)
        seed_error = losses.simple_loss(scaled[:, :seed_frames], wanted[:, :seed_frames])
        terms = {
            "simple": weights.simple * losses.simple_loss(scaled, wanted),
            "seed": weights.seed * seed_frames / vectors.shape[1] * seed_error * has_seed,
        }
        decoded = decode(
            restored, self.targets.space, self.targets.skeleton, self.targets.root_format
        )
        terms |= geometric_terms(weights, decoded, target)
        terms |= constraint_terms(weights, decoded, target, self.encoder)
        by_sample = flow_loss_weight(t, weights.time_weight_floor)
        return {name: (by_sample * term).mean() for name, term in terms.items()}


make_task = MotionTask


def mean_vector(normaliser: Normaliser, targets: Targets) -> Float[Tensor, "333"]:
    """Compute the mean normalised motion vector from every hundredth frame."""
    vectors = torch.from_numpy(np.array(targets.vectors[::100]))
    return normaliser.normalise(vectors).mean(0)


def constraint_terms(
    weights: GlobalDiffLossWeights,
    predicted: DecodedMotion,
    target: DecodedMotion,
    encoder: FrozenMotionEncoder | None,
) -> dict[str, Float[Tensor, " B"]]:
    """Compute the paper's three constraints, weighted, one value per sample, if not of weight 0.

    L_j and L_m need rotations and vectors, L_m its encoder.
    """
    positions = positions_to_compare(weights, predicted, target)

    def joint() -> Float[Tensor, " B"]:
        assert predicted.R_world_joint is not None and target.R_world_joint is not None
        anchors = octahedron_anchors()
        return joint_structure_loss(predicted.R_world_joint, target.R_world_joint, anchors)

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
    return weighted_terms(weights, terms)


def octahedron_anchors() -> Float[Tensor, "6 3"]:
    """Return N = 6 anchors, on the half axes of a joint's frame, 5 cm from it (official code)."""
    axes = torch.eye(3)
    return ANCHOR_DISTANCE_M * torch.cat([axes, -axes])


def joint_structure_loss(
    rotmat: Float[Tensor, "B T J 3 3"],
    target: Float[Tensor, "B T J 3 3"],
    anchors: Float[Tensor, "N 3"],
) -> Float[Tensor, " B"]:
    """Compute L_j, GlobalDiff eqs. 8 to 10: squared distance of turned anchors, in metres squared.

    ``v_hat = R v`` (eq. 8) and ``v_tilde = R_gt v`` (eq. 9); the mean over joints, anchors and
    frames of ``|v_hat - v_tilde|^2`` (eq. 10). A joint's position does not enter.
    """
    turned = (rotmat - target) @ anchors.to(rotmat).T  # (B, T, J, 3, N)
    return turned.square().sum(-2).mean((1, 2, 3))


def bone_directions_and_lengths(
    positions: Float[Tensor, "*batch J 3"],
) -> tuple[Float[Tensor, "*batch bones 3"], Float[Tensor, "*batch bones"]]:
    """Compute unit vectors of bones (GlobalDiff eq. 11; zero if degenerate), and lengths (m)."""
    bones = positions[..., 1:, :] - positions[..., list(PARENTS[1:]), :]
    length = bones.square().sum(-1).clamp_min(1e-18).sqrt()
    is_valid = length > SHORTEST_BONE_M
    safe = torch.where(is_valid, length, torch.ones_like(length))
    return bones / safe[..., None] * is_valid[..., None], length


def skeleton_structure_loss(
    positions: Float[Tensor, "B T J 3"], target: Float[Tensor, "B T J 3"]
) -> Float[Tensor, " B"]:
    """Compute L_s, GlobalDiff eq. 13: mean squared difference of cosines between every two bones.

    The cosines are the angular matrix D D^T of eq. 12. Valid are the ordered pairs of two different
    bones that have a direction in prediction and target. The matrices are never formed: with D and
    E the masked directions, S = D + E and M = D - E,

        |D D^T - E E^T|^2 = (tr(S^T S M^T M) + tr(M^T S M^T S)) / 2

    holds for any number of bones, needs 3 x 3 products only, and loses no digits if D is near E.
    """
    predicted, length = bone_directions_and_lengths(positions)
    wanted, wanted_length = bone_directions_and_lengths(target)
    is_valid = (length > SHORTEST_BONE_M) & (wanted_length > SHORTEST_BONE_M)
    predicted, wanted = predicted * is_valid[..., None], wanted * is_valid[..., None]
    total, difference = predicted + wanted, predicted - wanted

    def gram(a: Float[Tensor, "B T 3 3"], b: Float[Tensor, "B T 3 3"]) -> Float[Tensor, "B T 3 3"]:
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
    codes: Sequence[Float[Tensor, "B _ dim"]], target: Sequence[Float[Tensor, "B _ dim"]]
) -> Float[Tensor, " B"]:
    """Compute L_m, GlobalDiff eq. 15: squared distance of codes ``z = g(X)`` (eq. 14).

    Every scale of the encoder counts the same, as the mean over its numbers.
    """
    squared = [(a - b).square().mean((1, 2)) for a, b in zip(codes, target, strict=True)]
    return torch.stack(squared).sum(0)
