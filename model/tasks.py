"""What there is to train, by name: a network, the loss of a step, and the input's statistics."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from model.autoencoder import MotionAutoencoder, load_encoder
from model.cards import CheckpointError
from model.checkpoint import load_into, load_weights
from model.config import TrainConfig
from model.data import DataError, PreparedData
from model.expression import ExpressionNetwork
from model.ladder import SYSTEMS
from model.network import MotionNetwork
from model.objectives import (
    StepFunction,
    autoencoder_step,
    expression_step,
    fit_normaliser,
    motion_step,
    predicted_expressions,
)
from model.packing import Normaliser
from model.parallel import CPU


@dataclass(frozen=True)
class Start:
    """Trained weights to begin with."""

    folder: Path
    system: str
    """Whose weights; every rung of the ladder can begin with those of any other."""


@dataclass(frozen=True)
class Task:
    """A network with fresh or given weights, on the CPU or a GPU, and the loss of one step."""

    network: nn.Module
    step_loss: StepFunction
    normaliser: Normaliser | None
    """Statistics of the input, saved with the weights; the expression network has none."""

    def tensors(self, average: nn.Module) -> dict[str, Tensor]:
        """What to save: the averaged weights and the statistics."""
        found = {f"network.{name}": t for name, t in average.state_dict().items()}
        if self.normaliser is not None:
            found["normaliser.mean"] = self.normaliser.mean
            found["normaliser.std"] = self.normaliser.std
        return {name: tensor.cpu() for name, tensor in found.items()}


def _check_speakers(config: TrainConfig, data: PreparedData) -> None:
    """The table holds speaker numbers below its size; 0 is "no speaker"."""
    size = min(config.network.num_speakers, config.expression.num_speakers)
    outside = [f"{number} ({name})" for number, name in data.speakers.items()
               if not 0 < number < size]  # fmt: skip
    if outside:
        raise DataError(
            f"The speakers {', '.join(outside)} do not fit the table of {size}; number them from 1 "
            f"to {size - 1}."
        )


def make_task(
    config: TrainConfig,
    data: PreparedData,
    helpers: Path,
    start: Start | None = None,
    device: torch.device = CPU,
) -> Task:
    """The task of ``config.system``.

    Args:
        helpers: folder with the frozen networks that the task needs: the expression network, and
            L_m's encoder where L_m has a weight.
        start: weights to begin with, and with them their input statistics: other statistics would
            change what the weights mean.

    Raises:
        CheckpointError: if weights are missing, damaged or of another shape.
        DataError: if a speaker's number does not fit the network's table.
    """
    _check_speakers(config, data)
    torch.manual_seed(config.random_seed)
    given = None if start is None else load_weights(start.folder, start.system)[0]

    def statistics(space) -> Normaliser:
        if given is None:
            return fit_normaliser(config, space, data).to(device)
        if "normaliser.mean" not in given:
            raise CheckpointError(f"The weights of {start and start.system} have no statistics.")
        return Normaliser(given["normaliser.mean"], given["normaliser.std"]).to(device)

    normaliser: Normaliser | None = None
    if config.system == "expression":
        network: nn.Module = ExpressionNetwork(config.expression)
        step_loss = expression_step(config)
    elif config.system in SYSTEMS:
        normaliser = statistics(config.network.rotation_space)
        encoder = load_encoder(helpers, "motion-vae", device) if config.loss.motion > 0 else None
        expressions = predicted_expressions(data, helpers)
        network = MotionNetwork(config.network)
        step_loss = motion_step(config, normaliser, expressions, encoder)
    else:
        normaliser = statistics(config.autoencoder.rotation_space)
        network = MotionAutoencoder(config.autoencoder)
        step_loss = autoencoder_step(config, normaliser)
    if given is not None and start is not None:
        load_into(network, given, "network.", start.system)
    return Task(network.to(device), step_loss, normaliser)
