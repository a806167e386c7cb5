"""What there is to train: a task owns its networks, their optimizers, its state and its export."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from model.data.prepared import Batch, PreparedData
from model.data.recordings import DataError
from model.motion.packing import Normaliser
from model.networks.speech_codes import Listener, load_codes
from model.sampling.prior import GaussianPrior
from model.storage.cards import CheckpointError
from model.storage.checkpoint import load_into, load_weights
from model.training import losses
from model.training.config import TrainConfig
from model.training.parallel import WHOLE, Shard


@dataclass(frozen=True)
class Start:
    """Trained weights to begin with."""

    folder: Path
    system: str
    """Whose weights; every rung of the ladder can begin with those of any other."""

    def read(self) -> "Given":
        """The weights, which bring the statistics of their input along: other statistics would
        change what the weights mean.

        Raises:
            CheckpointError: if they are missing or damaged, or have no statistics.
        """
        tensors, _ = load_weights(self.folder, self.system)
        if "normaliser.mean" not in tensors:
            raise CheckpointError(f"The weights of {self.system} have no statistics.")
        return Given(self.system, tensors)


@dataclass(frozen=True)
class Given:
    """What a training begins with."""

    system: str
    tensors: dict[str, Tensor]

    @property
    def normaliser(self) -> Normaliser:
        """Statistics of the input that the weights learned with."""
        return Normaliser.of_tensors(self.tensors)

    def prior(self, seed_frames: int) -> GaussianPrior:
        """The linear-Gaussian prior that the network stands on."""
        return GaussianPrior(self.tensors["prior.covariance"], seed_frames)

    def load_into(self, network: nn.Module) -> None:
        """Put the weights into a network.

        Raises:
            CheckpointError: if they are of another shape.
        """
        load_into(network, self.tensors, "network.", self.system)

    def load_known_into(self, network: nn.Module) -> None:
        """Put the weights into a network that may have parts which they do not know, which stay,
        and layers of more inputs, which are not heard at first.

        Raises:
            CheckpointError: if they are of another shape.
        """
        fresh = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
        known = {
            name: with_more_inputs(tensor, fresh[name]) if name in fresh else tensor
            for name, tensor in self.tensors.items()
        }
        load_into(network, fresh | known, "network.", self.system)


def with_more_inputs(weight: Tensor, wanted: Tensor) -> Tensor:
    """A linear layer's weight with columns of zeros for the last inputs that ``wanted`` has more
    of; anything else as it is."""
    both = weight.dim() == wanted.dim() == 2 and len(weight) == len(wanted)
    more = wanted.shape[-1] - weight.shape[-1] if both else 0
    return F.pad(weight, (0, more)) if more > 0 else weight


@dataclass(frozen=True)
class TaskSetup:
    """Where a task is made: what it may lean on, on which device, how fast."""

    helpers: Path
    """Folder with the weights of networks that a task needs and does not train."""
    start: Start | None = None
    shard: Shard = WHOLE
    may_compile: bool = False
    """Compile networks and losses where that is worth it (`model.training.rate`)."""

    def given(self) -> Given | None:
        """The weights to begin with; None for a training from nothing.

        Raises:
            CheckpointError: see `Start.read`.
        """
        return None if self.start is None else self.start.read()

    def put_weights_into(
        self, network: nn.Module, given: Given | None, *, may_lack: bool = False
    ) -> None:
        """Let a network hear with the speech encoder among the helpers, if it hears with one, and
        begin with the weights that are given, which may know of none.

        Args:
            may_lack: whether they may know of other parts as little.

        Raises:
            CheckpointError: if the encoder is missing, or weights are of another shape.
        """
        listener = getattr(network, "listener", None)
        if isinstance(listener, Listener):
            listener.become(load_codes(self.helpers))
            may_lack = True
        if given is not None:
            (given.load_known_into if may_lack else given.load_into)(network)


@runtime_checkable
class Task(Protocol):
    """What the training loop needs of a family. Every random number of a step follows from the
    generator it is given, so that a resumed run equals one that was not stopped."""

    window_frames: int
    context: int
    """Frames of speech before and after each window."""

    def step(self, number: int, batch: Batch, generator: torch.Generator) -> dict[str, float]:
        """Change the weights once; what to log.

        Raises:
            FloatingPointError: if a loss is no number; the weights are as before then.
        """
        ...

    def validate(self, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
        """Losses of the weights that would be exported, ``total`` among them."""
        ...

    def export(self) -> dict[str, Tensor]:
        """What to save as weights."""
        ...

    def state(self) -> dict[str, Any]:
        """Everything that a resumed run needs, as `torch.save` writes it."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of `state`."""
        ...


@dataclass(frozen=True)
class StepLoss:
    """The loss to descend, and its parts for the log."""

    total: Float[Tensor, ""]
    parts: dict[str, Float[Tensor, ""]]
    """Detached, with ``total`` among them."""

    @staticmethod
    def of(means: Mapping[str, Float[Tensor, ""]]) -> "StepLoss":
        """The sum of weighted terms."""
        total = torch.stack(list(means.values())).sum()
        parts = {name: mean.detach() for name, mean in means.items()}
        return StepLoss(total, parts | {"total": total.detach()})


StepFunction = Callable[[nn.Module, Batch, torch.Generator, Shard], StepLoss]
"""It draws its random numbers for the whole batch and computes its shard of it, so that several
processes together do what one does alone."""


@dataclass
class DescentTask:
    """One network that descends one loss with AdamW, and a moving average of its weights."""

    config: TrainConfig
    network: nn.Module
    step_loss: StepFunction
    normaliser: Normaliser
    """Statistics of the input, saved with the weights."""
    window_frames: int
    context: int = 0
    shard: Shard = WHOLE
    compiles: bool = False
    statistics: dict[str, Tensor] = field(default_factory=dict)
    """What else is saved with the weights."""

    def __post_init__(self) -> None:
        config = self.config
        self.network = self.network.to(self.shard.device)
        self.average = torch.optim.swa_utils.AveragedModel(
            self.network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(config.ema_decay)
        )
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(),
            lr=config.learning_rate,
            weight_decay=config.weight_decay,
            fused=True,
        )
        if self.compiles:
            self.network.compile(dynamic=False)

    @cached_property
    def parallel(self) -> nn.Module:
        """The network with gradients averaged over all processes; made at the first step, when all
        of them are there: tasks are made by one after the other."""
        return self.shard.wrap(self.network)

    def step(self, number: int, batch: Batch, generator: torch.Generator) -> dict[str, float]:
        """See `Task`."""
        config = self.config
        for group in self.optimizer.param_groups:
            group["lr"] = config.learning_rate * learning_rate_factor(number, config)
        self.network.train()
        loss = self.step_loss(self.parallel, batch, generator, self.shard)
        self.optimizer.zero_grad(set_to_none=True)
        loss.total.backward()
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), config.clip_norm)
        numbers = self.shard.mean(loss.parts | {"gradient_norm": norm})
        losses.finite_or_raise(numbers, number, batch.clips)
        self.optimizer.step()
        if number < 2 * config.warmup_steps:  # average only what has left the start behind
            self.average.module.load_state_dict(self.network.state_dict())
        else:
            self.average.update_parameters(self.network)
        return numbers

    @torch.no_grad()
    def validate(self, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
        """See `Task`."""
        network = self.average.module.eval()
        return self.step_loss(network, batch, generator, self.shard).parts

    def export(self) -> dict[str, Tensor]:
        """The averaged weights and the statistics."""
        found = {f"network.{name}": t for name, t in self.average.module.state_dict().items()}
        found |= self.normaliser.tensors() | self.statistics
        return {name: tensor.cpu() for name, tensor in found.items()}

    def state(self) -> dict[str, Any]:
        """See `Task`."""
        return {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """See `Task`."""
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimizer.load_state_dict(state["optimizer"])


def learning_rate_factor(step: int, config: TrainConfig) -> float:
    """Linear warm-up, then a cosine from 1 down to 0.02."""
    if step < config.warmup_steps:
        return (step + 1) / config.warmup_steps
    done = (step - config.warmup_steps) / max(1, config.steps - config.warmup_steps)
    return 0.02 + 0.98 * (1 + math.cos(math.pi * done)) / 2


def check_speakers(data: PreparedData, table_size: int) -> None:
    """A table holds speaker numbers below its size; 0 is "no speaker".

    Raises:
        DataError: with the speakers that do not fit.
    """
    outside = [
        f"{number} ({name})"
        for number, name in data.speakers.items()
        if not 0 < number < table_size
    ]
    if outside:
        raise DataError(
            f"The speakers {', '.join(outside)} do not fit the table of {table_size}; number them "
            f"from 1 to {table_size - 1}."
        )
