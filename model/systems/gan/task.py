"""Training of generator and discriminator against each other."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
import torch.distributed as dist
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import Decoded, Normaliser, decode
from model.sampling.flow import time_weight
from model.systems.gan.adversary import (
    Discriminator,
    Watch,
    discriminator_loss,
    gaussian_loss,
    generator_loss,
    gradient_penalty,
)
from model.systems.gan.config import GanConfig
from model.systems.gan.generator import Generator
from model.systems.gan.sampling import diffused, flow_time, posterior
from model.training import losses
from model.training.losses import geometric_terms
from model.training.parallel import Draws, Shard
from model.training.rate import can_compile, compiled
from model.training.statistics import fit_motion_prior
from model.training.targets import Targets, heard, prepare_targets
from model.training.task import TaskSetup, check_speakers, learning_rate_factor


def make_task(config: GanConfig, data: PreparedData, setup: TaskSetup) -> "GanTask":
    """The task of the family's one network.

    Raises:
        CheckpointError: if the weights to start from are missing, damaged or of another shape.
        DataError: if a speaker's number does not fit the network's table.
    """
    shape = config.generator
    check_speakers(data, shape.num_speakers)
    torch.manual_seed(config.random_seed)
    given = setup.given()
    targets = prepare_targets(data, "axis-angle", "place", open_body_skeleton())
    normaliser, prior = fit_motion_prior(data, targets, shape, config.mirror, given)
    generator = Generator(shape, prior, normaliser)
    discriminator = Discriminator(config.discriminator, shape)
    setup.put_weights_into(generator, given)
    compiles = setup.may_compile and can_compile()
    return GanTask(config, generator, discriminator, normaliser, targets, setup.shard, compiles)


@dataclass(frozen=True)
class Drawn:
    """What a step draws for its windows: both ends of a denoising step, and what is told."""

    vectors: Float[Tensor, "B T C"]
    """Motion vectors, not normalised."""
    target: Decoded
    x_0: Float[Tensor, "B T C"]
    x_before: Float[Tensor, "B T C"]
    x_now: Float[Tensor, "B T C"]
    before: Float[Tensor, " B"]
    now: Float[Tensor, " B"]
    noise: Float[Tensor, "B T C"]
    """Of the posterior."""
    latent: Float[Tensor, "B T C"]
    expression: Float[Tensor, "B T E"]
    told: dict[str, Tensor]
    """To generator and discriminator alike."""


class GanTask:
    """Two networks, each with its optimizer, and a moving average of the generator."""

    def __init__(
        self,
        config: GanConfig,
        generator: Generator,
        discriminator: Discriminator,
        normaliser: Normaliser,
        targets: Targets,
        shard: Shard,
        compiles: bool,
    ) -> None:
        self.config, self.targets, self.shard = config, targets, shard
        self.window_frames = config.generator.window_frames
        self.context = config.generator.speech_context
        self.normaliser = normaliser.to(shard.device)
        self.generator = generator.to(shard.device)
        self.discriminator = discriminator.to(shard.device)
        decay = torch.optim.swa_utils.get_ema_multi_avg_fn(config.ema_decay)
        self.average = torch.optim.swa_utils.AveragedModel(self.generator, multi_avg_fn=decay)
        self.optimizers = [
            torch.optim.AdamW(
                network.parameters(),
                lr=rate,
                betas=config.betas,
                weight_decay=config.weight_decay,
                fused=True,
            )
            for network, rate in zip(self.networks, self.rates, strict=True)
        ]
        self.watch = Watch()
        self.training_terms = compiled(self.explicit_terms) if compiles else self.explicit_terms
        if compiles:
            self.generator.compile(dynamic=False)

    @property
    def networks(self) -> tuple[nn.Module, nn.Module]:
        return self.generator, self.discriminator

    @property
    def rates(self) -> tuple[float, float]:
        return self.config.learning_rate, self.config.discriminator_learning_rate

    def step(self, number: int, batch: Batch, generator: torch.Generator) -> dict[str, float]:
        """See `Task`; both networks change at once, each by the other as it was.

        Raises:
            TrainingError: if the training has collapsed.
        """
        config = self.config
        self.generator.train()
        drawn = self.draw(self.generator, batch, generator)
        mean, deviation = self.denoised(self.generator, drawn)
        found = self.generator.drawn(mean, deviation, drawn.latent, drawn.told["has_seed"])
        real = drawn.x_before.requires_grad_()
        score_real = self.scores(real, drawn)
        score_fake = self.scores(self.step_back(found.detach(), drawn), drawn)
        penalty = config.loss.gradient_penalty * gradient_penalty(score_real, real).mean()
        judging = discriminator_loss(score_real, score_fake).mean()
        terms = self.training_terms(mean, deviation, drawn)
        weight = config.loss.geometric
        explicit = {name: weight * term for name, term in terms.items()} if weight else {}
        if config.loss.adversarial:
            deceiving = generator_loss(self.scores(self.step_back(found, drawn), drawn)).mean()
            explicit["adversarial"] = config.loss.adversarial * deceiving
        total = torch.stack(list(explicit.values())).sum()
        norms = [
            self._descend(network, loss)
            for network, loss in zip(self.networks, (total, judging + penalty), strict=True)
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
            "liveliness": _spread_of(found) / _spread_of(drawn.x_0),
            "gradient_norm": norms[0],
            "discriminator_gradient_norm": norms[1],
        }
        logged = self.shard.mean({name: value.detach() for name, value in numbers.items()})
        losses.finite_or_raise(logged, number, batch.clips)
        self.watch.see(logged, number)
        for optimizer, rate in zip(self.optimizers, self.rates, strict=True):
            for group in optimizer.param_groups:
                group["lr"] = rate * learning_rate_factor(number, config)
            optimizer.step()
        if number < 2 * config.warmup_steps:  # average only what has left the start behind
            self.average.module.load_state_dict(self.generator.state_dict())
        else:
            self.average.update_parameters(self.generator)
        return logged

    @torch.no_grad()
    def validate(self, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
        """See `Task`: the explicit terms, which alone can be compared from step to step."""
        network = self.average.module.eval()
        drawn = self.draw(network, batch, generator)
        terms = self.explicit_terms(*self.denoised(network, drawn), drawn)
        return terms | {"total": torch.stack(list(terms.values())).sum()}

    @torch.no_grad()
    def draw(self, network: nn.Module, batch: Batch, generator: torch.Generator) -> Drawn:
        """Draws for the whole batch, cut to this process's share of it."""
        config, shape, shard = self.config, self.config.generator, self.shard
        size = len(batch.clips)
        draws = Draws(size, generator, shard)
        window = self.window_frames, shape.channels
        vectors, target = self.targets.of(batch.rows(shard.mine), rotations=False)
        vectors, target = vectors.to(shard.device), target.to(shard.device)
        x_0 = self.normaliser.normalise(vectors)
        counts = torch.tensor(config.step_counts)
        counts = counts[torch.randint(len(counts), (size,), generator=generator)]
        number = 1 + (torch.rand(size, generator=generator) * counts).long()
        now, before = shard.of(number / counts), shard.of((number - 1) / counts)
        x_before = diffused(x_0, draws.noise(window), torch.zeros_like(before), before)
        x_now = diffused(x_before, draws.noise(window), before, now)
        told = {
            "has_seed": draws.keep(config.seed_dropout),
            "has_speech": draws.keep(config.speech_dropout),
            "speaker": shard.of(batch.speaker) * draws.keep(config.speaker_dropout),
            "speech": shard.of(heard(config, network, batch, generator)),
            "seed": x_0[:, : shape.seed_frames],
        }
        return Drawn(
            vectors, target, x_0, x_before, x_now, before, now, noise=draws.noise(window),
            latent=draws.noise(window), expression=shard.of(batch.expression), told=told,
        )  # fmt: skip

    def denoised(
        self, network: nn.Module, drawn: Drawn
    ) -> tuple[Float[Tensor, "B T C"], Float[Tensor, "C T B"]]:
        """The generator's x_0: mean and deviation."""
        with self.shard.autocast():
            return network(
                drawn.x_now, drawn.now, drawn.before, expression=drawn.expression, **drawn.told
            )

    def step_back(self, x_0: Float[Tensor, "B T C"], drawn: Drawn) -> Float[Tensor, "B T C"]:
        """A sample of x_before from what the generator says of x_0."""
        mean, deviation = posterior(drawn.x_now, x_0, drawn.before, drawn.now)
        return mean + deviation * drawn.noise

    def scores(self, x_before: Float[Tensor, "B T C"], drawn: Drawn) -> Float[Tensor, " B"]:
        """The discriminator's, in fp32: its gradient is differentiated again."""
        return self.discriminator(x_before, drawn.x_now, drawn.before, drawn.now, **drawn.told)

    def explicit_terms(
        self, mean: Float[Tensor, "B T C"], deviation: Float[Tensor, "C T B"], drawn: Drawn
    ) -> dict[str, Float[Tensor, ""]]:
        """Shares of the explicit loss on x_0, before its weight."""
        weights, vectors = self.config.loss.terms, drawn.vectors
        restored = self.normaliser.restore(mean)
        scaled, wanted = self.normaliser.scaled(restored), self.normaliser.scaled(vectors)
        huber = F.huber_loss(scaled, wanted, reduction="none").mean((1, 2))
        terms = {"simple": weights.simple * huber}
        decoded = decode(restored, self.targets.space, self.targets.skeleton, self.targets.root)
        terms |= geometric_terms(weights, decoded, drawn.target)
        by_sample = time_weight(flow_time(drawn.now)[0], self.config.loss.time_weight_floor)
        means = {name: (by_sample * term).mean() for name, term in terms.items()}
        if self.config.generator.latent:
            has_seed = drawn.told["has_seed"]
            own = self.generator.prior_deviation(flow_time(drawn.now)[0], has_seed)
            error = self.generator.along(drawn.x_0 - mean, has_seed) / own
            means["spread"] = self.config.loss.spread * gaussian_loss(error, deviation / own)
        return means

    def export(self) -> dict[str, Tensor]:
        """The averaged generator and its statistics; what judged it is in the state only."""
        found = {f"network.{name}": t for name, t in self.average.module.state_dict().items()}
        found |= self.normaliser.tensors()
        found["prior.covariance"] = self.generator.prior.covariance
        return {name: tensor.cpu() for name, tensor in found.items()}

    def state(self) -> dict[str, Any]:
        """See `Task`."""
        return {
            "generator": self.generator.state_dict(),
            "discriminator": self.discriminator.state_dict(),
            "average": self.average.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
            "watch": asdict(self.watch),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """See `Task`."""
        self.generator.load_state_dict(state["generator"])
        self.discriminator.load_state_dict(state["discriminator"])
        self.average.load_state_dict(state["average"])
        for optimizer, saved in zip(self.optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(saved)
        self.watch = Watch(**state["watch"])

    def _descend(self, network: nn.Module, loss: Float[Tensor, ""]) -> Float[Tensor, ""]:
        """Put the loss's gradient for this network alone in place, averaged over all processes and
        clipped; its length before that."""
        parameters = [each for each in network.parameters() if each.requires_grad]
        gradients = torch.autograd.grad(loss, parameters)
        for parameter, gradient in zip(parameters, self._averaged(gradients), strict=True):
            parameter.grad = gradient
        return nn.utils.clip_grad_norm_(parameters, self.config.clip_norm)

    def _averaged(self, gradients: Sequence[Tensor]) -> Sequence[Tensor]:
        if self.shard.count == 1:
            return gradients
        flat = torch.cat([gradient.flatten() for gradient in gradients])
        dist.all_reduce(flat)
        parts = (flat / self.shard.count).split([gradient.numel() for gradient in gradients])
        return [part.view_as(of) for part, of in zip(parts, gradients, strict=True)]


def _spread_of(windows: Float[Tensor, "B T C"]) -> Float[Tensor, ""]:
    """Deviation over the batch, of some frames."""
    return windows[:, ::15].std(0).mean()
