"""Interface of training tasks: networks with their optimizers, state and export."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn

from model.data.prepared import Batch, PreparedData
from model.data.recordings import DataError
from model.motion.packing import Normaliser
from model.networks.trained import TrainedWeights
from model.storage.cards import CheckpointError
from model.storage.checkpoint import load_module
from model.training import losses
from model.training.config import TrainConfig
from model.training.parallel import UNSHARDED, Shard, ShardedRandom, can_compile


@dataclass(frozen=True)
class TaskSetup:
    """Environment of a training task: weights it needs, device, compilation."""

    helper_weights: Path
    """Folder with the weights of networks that a task needs and does not train."""
    initial_weights: Path | None = None
    """Folder with initial weights of the trained network; None for random ones."""
    shard: Shard = UNSHARDED
    may_compile: bool = False
    """True to compile networks and losses if that pays (`model.training.parallel`)."""

    @property
    def compiles(self) -> bool:
        """True if networks and losses are compiled."""
        return self.may_compile and can_compile()

    def seed_and_read_initial_weights(
        self, config: TrainConfig, data: PreparedData, num_speakers: int | None = None
    ) -> TrainedWeights | None:
        """Check speakers' numbers, seed torch, and read the initial weights; None without any.

        They must include normalisation statistics, since other ones would change their meaning.

        Args:
            num_speakers: size of the network's table, if it has one.

        Raises:
            CheckpointError: if the weights are missing or damaged, or have no statistics.
            DataError: with the speakers with numbers that do not fit the table.
        """
        if num_speakers is not None:
            outside = [
                f"{number} ({name})"
                for number, name in data.speaker_names.items()
                if not 0 < number < num_speakers  # 0 is "no speaker"
            ]
            if outside:
                raise DataError(
                    f"The speaker numbers {', '.join(outside)} are out of range; they must be from "
                    f"1 to {num_speakers - 1}."
                )
        torch.manual_seed(config.random_seed)
        if self.initial_weights is None:
            return None
        weights = TrainedWeights.read(self.initial_weights, config.system)
        if "normaliser.mean" not in weights.tensors:
            raise CheckpointError(
                f"The weights of {weights.name} have no normalisation statistics."
            )
        return weights


@runtime_checkable
class Task(Protocol):
    """Interface between the training loop and a family.

    Every random number of a step follows from the generator in its arguments, so that a resumed run
    equals one that was not stopped.
    """

    window_frames: int
    context_frames: int
    """Frames of speech before and after each window."""

    def step(self, number: int, batch: Batch, generator: torch.Generator) -> dict[str, float]:
        """Update the weights once, and return the values for the log.

        Raises FloatingPointError if a loss is not finite; the weights are unchanged then.
        """
        ...

    def validate(self, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
        """Compute the losses of the weights that would be exported, ``total`` among them."""
        ...

    def export(self) -> dict[str, Tensor]:
        """Return the tensors to save as weights."""
        ...

    def state(self) -> dict[str, Any]:
        """Return everything that a resumed run needs, as `torch.save` writes it."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        ...


@dataclass(frozen=True)
class StepLoss:
    """Loss to minimise: the sum of its weighted terms."""

    terms: dict[str, Float[Tensor, ""]]
    logged: dict[str, Float[Tensor, ""]] = field(default_factory=dict)
    """Further values for the log."""

    @cached_property
    def total(self) -> Float[Tensor, ""]:
        return torch.stack(list(self.terms.values())).sum()

    @property
    def parts(self) -> dict[str, Float[Tensor, ""]]:
        """Values for the log: each term, ``total`` and further values."""
        parts = {**self.terms, "total": self.total, **self.logged}
        return {name: part.detach() for name, part in parts.items()}


class SingleNetworkTask(ABC):
    """Task of one network with one loss, AdamW, and a moving average of the weights.

    Args:
        start_weights: result of `TaskSetup.seed_and_read_initial_weights`.
        normaliser: statistics of the input, saved with the weights.
        window_frames, context_frames: see `Task`.
        statistics: further tensors to save with the weights, besides the network's prior, if any.
    """

    state_attributes: ClassVar[tuple[str, ...]] = ("network", "average", "optimizer")
    """Attributes that make up the state of a resumed run."""
    is_worth_compiling: ClassVar[bool] = False
    """True if the network is worth compiling; ``self.compiles`` says if it is."""

    def __init__(
        self,
        setup: TaskSetup,
        config: TrainConfig,
        start_weights: TrainedWeights | None,
        network: nn.Module,
        normaliser: Normaliser,
        window_frames: int,
        context_frames: int = 0,
        statistics: Mapping[str, Shaped[Tensor, " ..."]] = MappingProxyType({}),
    ) -> None:
        if start_weights is not None:
            load_module(network, start_weights.tensors, "network.", start_weights.name)
        self.setup, self.config = setup, config
        self.window_frames, self.context_frames = window_frames, context_frames
        self.network = network.to(self.shard.device)
        self.normaliser = normaliser.to(self.shard.device)
        self.statistics = statistics
        self.average = torch.optim.swa_utils.AveragedModel(
            self.network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(config.ema_decay)
        )
        self.optimizer = self.make_optimizer(self.network, config.learning_rate)
        self.compiles = self.is_worth_compiling and setup.compiles
        if self.compiles:
            self.network.compile(dynamic=False)

    @abstractmethod
    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        """Compute the loss of a network on the shard's share of a batch.

        Random numbers are drawn for the whole batch, so that several processes equal one.
        """

    def loss_from_generator(
        self, network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard
    ) -> StepLoss:
        """Compute `loss` with random numbers from a generator."""
        return self.loss(network, batch, ShardedRandom(len(batch.clip_names), generator, shard))

    @property
    def shard(self) -> Shard:
        """Shard of this process."""
        return self.setup.shard

    def make_optimizer(self, network: nn.Module, rate: float) -> torch.optim.Optimizer:
        """Make the AdamW optimizer of a network."""
        betas, decay = self.config.betas, self.config.weight_decay
        return torch.optim.AdamW(network.parameters(), rate, betas, weight_decay=decay, fused=True)

    @cached_property
    def data_parallel_network(self) -> nn.Module:
        """Network with gradients averaged over all processes.

        It is made at the first step, when all processes have joined; they make their tasks in turn.
        """
        return self.shard.wrap(self.network)

    def step(self, number: int, batch: Batch, generator: torch.Generator) -> dict[str, float]:
        self.network.train()
        loss = self.loss_from_generator(self.data_parallel_network, batch, generator, self.shard)
        self.optimizer.zero_grad(set_to_none=True)
        loss.total.backward()
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), self.config.clip_norm)
        numbers = self.shard.mean(loss.parts | {"gradient_norm": norm})
        losses.finite_or_raise(numbers, number, batch.clip_names)
        self.update_weights_and_average(number, {self.optimizer: self.config.learning_rate})
        return numbers

    def update_weights_and_average(
        self, number: int, rates: Mapping[torch.optim.Optimizer, float]
    ) -> None:
        """Update learning rates, weights by their present gradients, and the average of weights."""
        for optimizer, rate in rates.items():
            for group in optimizer.param_groups:
                group["lr"] = rate * learning_rate_factor(number, self.config)
            optimizer.step()
        if number < 2 * self.config.warmup_steps:  # average only what has left the start behind
            self.average.module.load_state_dict(self.network.state_dict())
        else:
            self.average.update_parameters(self.network)

    @torch.no_grad()
    def validate(self, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
        network = self.average.module.eval()
        return self.loss_from_generator(network, batch, generator, self.shard).parts

    def export(self) -> dict[str, Tensor]:
        """Return the averaged weights and the statistics."""
        tensors = {f"network.{name}": t for name, t in self.average.module.state_dict().items()}
        tensors |= {**self.normaliser.tensors(), **self.statistics}
        prior = getattr(self.network, "prior", None)
        if prior is not None:
            tensors["prior.covariance"] = prior.covariance
        return {name: tensor.cpu() for name, tensor in tensors.items()}

    def state(self) -> dict[str, Any]:
        return {name: getattr(self, name).state_dict() for name in self.state_attributes}

    def restore(self, state: Mapping[str, Any]) -> None:
        for name in self.state_attributes:
            getattr(self, name).load_state_dict(state[name])


def learning_rate_factor(step: int, config: TrainConfig) -> float:
    """Compute the learning rate's factor: linear warm-up, then a cosine from 1 down to 0.02."""
    if step < config.warmup_steps:
        return (step + 1) / config.warmup_steps
    done = (step - config.warmup_steps) / max(1, config.steps - config.warmup_steps)
    return 0.02 + 0.98 * (1 + math.cos(math.pi * done)) / 2
