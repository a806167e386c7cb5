"""Training of generator and discriminator against each other: their losses, and the penalty."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.distributed as dist
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import DecodedMotion, decode
from model.sampling.flow import flow_loss_weight
from model.systems.gan.config import GanTrainConfig
from model.systems.gan.network import (
    Discriminator,
    Generator,
    diffuse,
    flow_time_and_scale,
    posterior,
)
from model.training import losses
from model.training.losses import geometric_terms
from model.training.parallel import ShardedRandom, compiled
from model.training.targets import fit_or_reuse_motion_prior, mask_conditions, prepare_targets
from model.training.task import SingleNetworkTask, StepLoss, TaskSetup

MAX_DEVIATIONS = 5.0


def discriminator_loss(real: Float[Tensor, " B"], fake: Float[Tensor, " B"]) -> Float[Tensor, " B"]:
    """Compute the discriminator's loss of scores, which should be positive for real samples."""
    return F.softplus(-real) + F.softplus(fake)


def generator_loss(fake: Float[Tensor, " B"]) -> Float[Tensor, " B"]:
    """Compute the generator's non-saturating loss."""
    return F.softplus(-fake)


def gaussian_loss(
    error: Float[Tensor, "*shape"], std: Float[Tensor, "*shape"]
) -> Float[Tensor, ""]:
    """Compute the negative log-likelihood of errors, clipped at `MAX_DEVIATIONS`."""
    ratio = (error / std).clamp(-MAX_DEVIATIONS, MAX_DEVIATIONS)
    return (std.log() + ratio.square() / 2).mean()


def gradient_penalty(
    scores: Float[Tensor, " B"], real: Float[Tensor, "B T C"]
) -> Float[Tensor, " B"]:
    """Compute R1 (Mescheder et al., 2018): half the scores' squared gradient at real samples."""
    (slope,) = torch.autograd.grad(scores.sum(), real, create_graph=True)
    return slope.square().sum((1, 2)) / 2


@dataclass(frozen=True)
class DenoisingBatch:
    """Random draws of a training step: both ends of a denoising step, and the conditions."""

    motion_vectors: Float[Tensor, "B T C"]
    """Motion vectors, not normalised."""
    target: DecodedMotion
    x_0: Float[Tensor, "B T C"]
    x_s: Float[Tensor, "B T C"]
    x_t: Float[Tensor, "B T C"]
    s: Float[Tensor, " B"]
    t: Float[Tensor, " B"]
    posterior_noise: Float[Tensor, "B T C"]
    """Noise of the posterior."""
    latent: Float[Tensor, "B T C"]
    expression: Float[Tensor, "B T E"]
    condition: dict[str, Tensor]
    """Conditions of generator and discriminator."""


class GanTask(SingleNetworkTask):
    """Task of generator and discriminator; it exports the generator's moving average alone.

    Losses of validation are the explicit terms, which alone can be compared from step to step.
    """

    state_attributes = (*SingleNetworkTask.state_attributes, "discriminator", "judging")
    is_worth_compiling = True
    config: GanTrainConfig
    network: Generator

    def __init__(self, config: GanTrainConfig, data: PreparedData, setup: TaskSetup) -> None:
        shape = config.generator
        weights = setup.seed_and_read_initial_weights(config, data, shape.num_speakers)
        self.targets = prepare_targets(data, "axis-angle", "place", open_body_skeleton())
        normaliser, prior = fit_or_reuse_motion_prior(data, self.targets, shape, weights)
        generator = Generator(shape, prior, normaliser)
        self.discriminator = Discriminator(config.discriminator, shape).to(setup.shard.device)
        super().__init__(
            setup, config, weights, generator, normaliser, shape.window_frames, shape.speech_context
        )
        self.judging = self.make_optimizer(self.discriminator, config.discriminator_learning_rate)
        self.training_terms = (
            compiled(self.explicit_terms) if self.compiles else self.explicit_terms
        )

    def step(self, number: int, batch: Batch, generator: torch.Generator) -> dict[str, float]:
        """Update both networks at once (`Task.step`), each against the unchanged other."""
        config = self.config
        self.network.train()
        draws = ShardedRandom(len(batch.clip_names), generator, self.shard)
        drawn = self.draw(self.network, batch, draws)
        mean, std = self.denoised(self.network, drawn)
        sample = self.network.sample_x_0(mean, std, drawn.latent, drawn.condition["has_seed"])
        real = drawn.x_s.requires_grad_()
        score_real = self.scores(real, drawn)
        score_fake = self.scores(self.step_back(sample.detach(), drawn), drawn)
        penalty = config.loss.gradient_penalty * gradient_penalty(score_real, real).mean()
        judging = discriminator_loss(score_real, score_fake).mean()
        terms = self.training_terms(mean, std, drawn)
        explicit = {name: config.loss.geometric * term for name, term in terms.items()}
        deceiving = generator_loss(self.scores(self.step_back(sample, drawn), drawn)).mean()
        explicit["adversarial"] = config.loss.adversarial * deceiving
        total = torch.stack(list(explicit.values())).sum()
        norms = [
            self._put_gradient(self.network, total),
            self._put_gradient(self.discriminator, judging + penalty),
        ]
        numbers = {
            **explicit,
            "total": total,
            "discriminator": judging,
            "gradient_penalty": penalty,
            "score_real": score_real.mean(),
            "score_fake": score_fake.mean(),
            "accuracy_real": (score_real > 0).float().mean(),
            "accuracy_fake": (score_fake < 0).float().mean(),
            "liveliness": _batch_deviation(sample) / _batch_deviation(drawn.x_0),
            "gradient_norm": norms[0],
            "discriminator_gradient_norm": norms[1],
        }
        logged = self.shard.mean({name: value.detach() for name, value in numbers.items()})
        losses.finite_or_raise(logged, number, batch.clip_names)
        self.update_weights_and_average(
            number,
            {
                self.optimizer: config.learning_rate,
                self.judging: config.discriminator_learning_rate,
            },
        )
        return logged

    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        """Compute the explicit terms alone, for validation; `step` has the losses of training."""
        drawn = self.draw(network, batch, draws)
        return StepLoss(self.explicit_terms(*self.denoised(network, drawn), drawn))

    @torch.no_grad()
    def draw(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> DenoisingBatch:
        """Draw the random numbers of the whole batch, cut to this process's share of it."""
        config, shape, shard, chance = (
            self.config, self.config.generator, draws.shard, draws.generator
        )  # fmt: skip
        window = self.window_frames, shape.channels
        vectors, target = self.targets.for_batch(batch.part(shard.rows), with_rotations=False)
        vectors, target = vectors.to(shard.device), target.to(shard.device)
        x_0 = self.normaliser.normalise(vectors)
        counts = torch.tensor(config.step_counts)
        counts = counts[torch.randint(len(counts), (draws.batch_size,), generator=chance)]
        number = 1 + (torch.rand(draws.batch_size, generator=chance) * counts).long()
        t, s = shard.local_rows(number / counts), shard.local_rows((number - 1) / counts)
        x_s = diffuse(x_0, draws.noise(window), torch.zeros_like(s), s)
        x_t = diffuse(x_s, draws.noise(window), s, t)
        conditions = mask_conditions(
            config, network, batch, draws, droppable=("seed", "speech", "speaker")
        )
        conditions["seed"] = x_0[:, : shape.seed_frames]
        return DenoisingBatch(
            vectors, target, x_0, x_s, x_t, s, t, posterior_noise=draws.noise(window),
            latent=draws.noise(window), expression=shard.local_rows(batch.arkit_weights),
            condition=conditions,
        )  # fmt: skip

    def denoised(
        self, network: nn.Module, drawn: DenoisingBatch
    ) -> tuple[Float[Tensor, "B T C"], Float[Tensor, "C T B"]]:
        """Predict the mean of x_0, and its deviation along the prior's eigenvectors."""
        with self.shard.autocast():
            return network(
                drawn.x_t, drawn.t, drawn.s, expression=drawn.expression, **drawn.condition
            )

    def step_back(
        self, x_0: Float[Tensor, "B T C"], drawn: DenoisingBatch
    ) -> Float[Tensor, "B T C"]:
        """Sample x_s for a prediction of x_0."""
        mean, std = posterior(drawn.x_t, x_0, drawn.s, drawn.t)
        return mean + std * drawn.posterior_noise

    def scores(self, x_s: Float[Tensor, "B T C"], drawn: DenoisingBatch) -> Float[Tensor, " B"]:
        """Compute the discriminator's scores in fp32: their gradient is differentiated again."""
        return self.discriminator(x_s, drawn.x_t, drawn.s, drawn.t, **drawn.condition)

    def explicit_terms(
        self, mean: Float[Tensor, "B T C"], std: Float[Tensor, "C T B"], drawn: DenoisingBatch
    ) -> dict[str, Float[Tensor, ""]]:
        """Compute the terms of the explicit loss on x_0, before its weight."""
        weights, vectors = self.config.loss.terms, drawn.motion_vectors
        restored = self.normaliser.restore(mean)
        scaled, wanted = self.normaliser.standardise(restored), self.normaliser.standardise(vectors)
        huber = F.huber_loss(scaled, wanted, reduction="none").mean((1, 2))
        terms = {"simple": weights.simple * huber}
        decoded = decode(
            restored, self.targets.space, self.targets.skeleton, self.targets.root_format
        )
        terms |= geometric_terms(weights, decoded, drawn.target)
        by_sample = flow_loss_weight(
            flow_time_and_scale(drawn.t)[0], self.config.loss.time_weight_floor
        )
        means = {name: (by_sample * term).mean() for name, term in terms.items()}
        has_seed = drawn.condition["has_seed"]
        own = self.network.posterior_std_in_eigenbasis(flow_time_and_scale(drawn.t)[0], has_seed)
        error = self.network.prior.to_eigenbasis(drawn.x_0 - mean, has_seed) / own
        means["spread"] = self.config.loss.spread * gaussian_loss(error, std / own)
        return means

    def _put_gradient(self, network: nn.Module, loss: Float[Tensor, ""]) -> Float[Tensor, ""]:
        """Set the network's averaged, clipped gradient; return its norm before clipping."""
        parameters = [each for each in network.parameters() if each.requires_grad]
        gradients = torch.autograd.grad(loss, parameters)
        for parameter, gradient in zip(parameters, self._averaged(gradients), strict=True):
            parameter.grad = gradient
        return nn.utils.clip_grad_norm_(parameters, self.config.clip_norm)

    def _averaged(self, gradients: Sequence[Float[Tensor, " ..."]]) -> Sequence[Tensor]:
        if self.shard.count == 1:
            return gradients
        flat = torch.cat([gradient.flatten() for gradient in gradients])
        dist.all_reduce(flat)
        parts = (flat / self.shard.count).split([gradient.numel() for gradient in gradients])
        return [part.view_as(of) for part, of in zip(parts, gradients, strict=True)]


make_task = GanTask


def _batch_deviation(windows: Float[Tensor, "B T C"]) -> Float[Tensor, ""]:
    """Compute the deviation over the batch, of every 15th frame."""
    return windows[:, ::15].std(0).mean()
