"""What there is to train, by name: a network, the loss of a step, and the input's statistics."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from model.data.prepared import DataError, PreparedData
from model.motion.packing import Normaliser
from model.motion.skeleton import open_body_skeleton
from model.networks.autoencoder import MotionAutoencoder, load_encoder
from model.networks.prior_network import PriorNetwork
from model.sampling.prior import GaussianPrior
from model.storage.cards import CheckpointError
from model.storage.checkpoint import load_into, load_weights
from model.storage.settings import TrainConfig
from model.systems.globaldiff.config import SYSTEMS
from model.systems.globaldiff.network import MotionNetwork
from model.training.parallel import CPU
from model.training.steps import (
    StepFunction,
    autoencoder_step,
    expression_step,
    fit_face,
    fit_motion_prior,
    fit_normaliser,
    fit_vector_normaliser,
    mean_vector,
    motion_step,
)
from model.training.targets import prepare_targets


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
    normaliser: Normaliser
    """Statistics of the input, saved with the weights."""
    context: int = 0
    """Frames of speech before and after each window."""

    def tensors(self, average: nn.Module) -> dict[str, Tensor]:
        """What to save: the averaged weights and the statistics."""
        found = {f"network.{name}": t for name, t in average.state_dict().items()}
        found |= self.normaliser.tensors()
        if isinstance(self.network, PriorNetwork):
            found["prior.covariance"] = self.network.prior.covariance
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
    compile_step: bool = False,
) -> Task:
    """The task of ``config.system``.

    Args:
        helpers: folder with L_m's frozen encoder, needed where L_m has a weight.
        compile_step: compile the network and the loss of motion systems.
        start: weights to begin with, and with them their input statistics: other statistics would
            change what the weights mean.

    Raises:
        CheckpointError: if weights are missing, damaged or of another shape.
        DataError: if a speaker's number does not fit the network's table.
    """
    _check_speakers(config, data)
    torch.manual_seed(config.random_seed)
    given = None if start is None else load_weights(start.folder, start.system)[0]

    if given is not None and "normaliser.mean" not in given:
        raise CheckpointError(f"The weights of {start and start.system} have no statistics.")
    known = None if given is None else Normaliser.of_tensors(given)
    context = 0
    if config.system == "expression":
        shape = config.expression
        context = shape.speech_context
        if known is None or given is None:
            known, prior = fit_face(config, data)
        else:
            prior = GaussianPrior(given["prior.covariance"], shape.seed_frames)
        normaliser = known.to(device)
        network: nn.Module = PriorNetwork(
            shape, prior, channels=shape.expression_dim, expression_dim=0
        )
        step_loss = expression_step(config, normaliser)
    elif config.system in SYSTEMS:
        shape = config.network
        context = shape.speech_context
        encoder = load_encoder(helpers, "motion-vae", device) if config.loss.motion > 0 else None
        targets = prepare_targets(data, shape.rotation_space, shape.root, open_body_skeleton())
        if shape.prior:
            if known is None or given is None:
                known, prior = fit_motion_prior(config, data, targets)
            else:
                prior = GaussianPrior(given["prior.covariance"], shape.seed_frames)
            normaliser = known.to(device)
            network = PriorNetwork(
                shape, prior, channels=shape.motion_dim, expression_dim=shape.expression_dim
            )
        else:
            normaliser = (known or fit_normaliser(config, data, targets)).to(device)
            network = MotionNetwork(shape)
            network.start_at(mean_vector(normaliser, targets))
        step_loss = motion_step(config, normaliser, targets, encoder, compile_step)
    else:
        space = config.autoencoder.rotation_space
        normaliser = (known or fit_vector_normaliser(config, space, data)).to(device)
        network = MotionAutoencoder(config.autoencoder)
        step_loss = autoencoder_step(config, normaliser)
    if given is not None and start is not None:
        load_into(network, given, "network.", start.system)
    return Task(network.to(device), step_loss, normaliser, context)
