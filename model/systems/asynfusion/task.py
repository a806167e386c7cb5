"""Training of AsynFusion's branches: noise prediction, or distillation from a teacher."""

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional as F

from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import AXIS_ANGLE_GROUPS, Normaliser
from model.networks.trained import TrainedWeights
from model.sampling.flow import ClassifierFreeGuidance, interpolate
from model.systems.asynfusion.config import (
    DDIM,
    AsynFusionLossWeights,
    AsynFusionTrainConfig,
    DualBranchConfig,
)
from model.systems.asynfusion.network import (
    BRANCHES,
    GESTURE,
    BranchStatistics,
    DualBranchNetwork,
    Pair,
    PairStatistics,
    face_tensors,
    map_branches,
    read_statistics,
)
from model.systems.asynfusion.system import NUM_STEPS, flow_times, noise_from_clean
from model.training import losses
from model.training.parallel import ShardedRandom
from model.training.targets import (
    Targets,
    fit_components_and_prior,
    fit_or_reuse_face_prior,
    mask_conditions,
    prepare_targets,
    prior_batches,
)
from model.training.task import SingleNetworkTask, StepLoss, TaskSetup

NAMES = "expression", "gesture"
HUBER_C = 0.03


class BranchesTask(SingleNetworkTask):
    """Training of both branches by eqs. 12 to 14, or by consistency of a student with its teacher.

    The student starts as the teacher, `DDIM` among the helpers.
    """

    is_worth_compiling = True
    config: AsynFusionTrainConfig

    def __init__(self, config: AsynFusionTrainConfig, data: PreparedData, setup: TaskSetup) -> None:
        shape, device = config.network, setup.shard.device
        weights = setup.seed_and_read_initial_weights(config, data, shape.num_speakers)
        self.targets = prepare_targets(data, "axis-angle", "place", open_body_skeleton())
        taught = (
            TrainedWeights.read(setup.helper_weights, DDIM) if config.aim == "teacher" else None
        )
        teacher = taught or weights
        if teacher:
            face, body = read_statistics(teacher, shape.seed_frames)
        else:
            face, body = fit_statistics(shape, data, self.targets)
        self.teacher = None
        if taught is not None:
            self.teacher = taught.load_into(
                DualBranchNetwork(shape, (face, body), consistent=False)
            )
        network = DualBranchNetwork(shape, (face, body), consistent=self.teacher is not None)
        if self.teacher is not None:
            network.load_state_dict(self.teacher.state_dict())
        super().__init__(
            setup, config, weights, network, body.normaliser, shape.window_frames,
            shape.speech_context, face_tensors(face) | {"prior.covariance": body.prior.covariance},
        )  # fmt: skip
        self.normalisers = face.normaliser.to(device), self.normaliser
        if self.teacher is not None:
            self.teacher.to(device)
            if self.compiles:
                self.teacher.compile(dynamic=False)

    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        config, shard = self.config, draws.shard
        with torch.no_grad():
            vectors = self.targets.windows(batch.part(shard.rows))
            motion = shard.local_rows(batch.arkit_weights), vectors.to(shard.device)
            x_1 = map_branches(lambda n, m: n.normalise(m), self.normalisers, motion)
            noise = map_branches(lambda x: draws.noise(x.shape[1:]), x_1)
            steps = map_branches(
                shard.local_rows, draw_steps(draws.batch_size, config, draws.generator)
            )
            t = map_branches(lambda k: flow_times().to(k.device)[k], steps)
            x_t = map_branches(interpolate, noise, x_1, t)
            seed_frames = config.network.seed_frames
            conditions: dict[str, Any] = {"seed": map_branches(lambda x: x[:, :seed_frames], x_1)}
            droppable = "seed", "speech", "speaker"
            conditions |= mask_conditions(config, network, batch, draws, droppable)
        with shard.autocast():
            predicted = network(x_t, t, **conditions)
            if self.teacher is not None:
                wanted = consistency_target(
                    config, network, self.teacher, self.normaliser, x_t, steps, conditions
                )
        predicted = map_branches(lambda x: x.float(), predicted)
        terms: dict[str, Tensor] = {}
        for which in BRANCHES:
            if self.teacher is not None:
                branch_losses = {
                    "consistency": pseudo_huber(predicted[which], wanted[which].float())
                }
            else:
                branch_losses = noise_training_terms(
                    config.loss, self.normalisers[which], x_t[which], predicted[which],
                    x_1[which], noise[which], t[which],
                )  # fmt: skip
            terms |= {f"{NAMES[which]}_{name}": term.mean() for name, term in branch_losses.items()}
        return StepLoss(terms)


make_task = BranchesTask


def fit_statistics(
    config: DualBranchConfig, data: PreparedData, targets: Targets
) -> PairStatistics:
    """Fit components of face and body and their priors to windows of the training split."""
    bodies = [targets.windows(batch) for batch in prior_batches(data, config.window_frames)]
    vectors: Float[Tensor, "N C"] = torch.cat([body.flatten(0, 1) for body in bodies])
    body = Normaliser.fit(vectors, groups=AXIS_ANGLE_GROUPS)
    return (
        BranchStatistics(*fit_or_reuse_face_prior(data, config)),
        BranchStatistics(*fit_components_and_prior(body, bodies, config.seed_frames)),
    )


def draw_steps(
    size: int, config: AsynFusionTrainConfig, generator: torch.Generator
) -> tuple[Int[Tensor, " B"], Int[Tensor, " B"]]:
    """Draw diffusion steps of both branches: equal, or independent in a share of the samples."""
    # A student needs one step of the solver below it.
    first = NUM_STEPS // config.solver_steps if config.aim == "teacher" else 0
    gesture = torch.randint(first, NUM_STEPS, (size,), generator=generator)
    other = torch.randint(first, NUM_STEPS, (size,), generator=generator)
    is_apart = torch.rand(size, generator=generator) < config.independent_steps_share
    return torch.where(is_apart, other, gesture), gesture


def noise_training_terms(
    weights: AsynFusionLossWeights,
    normaliser: Normaliser,
    x_t: Float[Tensor, "B T C"],
    predicted: Float[Tensor, "B T C"],
    x_1: Float[Tensor, "B T C"],
    noise: Float[Tensor, "B T C"],
    t: Float[Tensor, " B"],
) -> dict[str, Float[Tensor, " B"]]:
    """Compute weighted eqs. 12 to 14: noise in components, the others in normalised channels."""
    restored, wanted = (normaliser.standardise(normaliser.restore(x)) for x in (predicted, x_1))
    huber = F.huber_loss(restored, wanted, reduction="none", delta=weights.huber_delta)
    return {
        "noise": weights.noise * losses.simple_loss(noise_from_clean(x_t, predicted, t), noise),
        "velocity": weights.velocity * losses.first_difference_loss(restored, wanted),
        "huber": weights.huber * huber.mean((1, 2)),
    }


@torch.no_grad()
def consistency_target(
    config: AsynFusionTrainConfig,
    network: nn.Module,
    teacher: DualBranchNetwork,
    normaliser: Normaliser,
    x_t: Pair,
    steps: Pair,
    conditions: dict[str, Any],
) -> Pair:
    """Compute the student's target: its own prediction one DDIM step nearer to the data.

    The step is that of the guided teacher. The student is its own target, without a moving average
    (Song and Dhariwal 2024); next to the data its prior leaves it no choice but x_t.
    """
    times = flow_times().to(steps[0].device)
    t = map_branches(lambda k: times[k], steps)
    clean = map_branches(lambda x: x.float(), teacher(x_t, t, **conditions))
    guide = ClassifierFreeGuidance(config.teacher_guidance, normaliser, "axis-angle")
    if guide.needs_unconditional:
        no_speech = conditions | {"has_speech": torch.zeros_like(conditions["has_speech"])}
        unconditional = teacher(x_t, t, **no_speech)[GESTURE].float()
        clean = clean[0], guide.combine(torch.cat([clean[GESTURE], unconditional]))
    noise = map_branches(noise_from_clean, x_t, clean, t)
    earlier = map_branches(lambda k: times[k - NUM_STEPS // config.solver_steps], steps)
    return network(map_branches(interpolate, noise, clean, earlier), earlier, **conditions)


def pseudo_huber(
    predicted: Float[Tensor, "B T C"], target: Float[Tensor, "B T C"]
) -> Float[Tensor, " B"]:
    """Compute ``sqrt(d^2 + c^2) - c`` of a window's RMS difference d (Song and Dhariwal 2024)."""
    return (losses.simple_loss(predicted, target) + HUBER_C**2).sqrt() - HUBER_C
