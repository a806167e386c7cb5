"""Trained weights from which networks are made: tensors with statistics, and the model card."""

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from torch import Tensor, nn

from model.motion.packing import Normaliser
from model.sampling.prior import GaussianPrior
from model.storage.cards import WeightsCard
from model.storage.checkpoint import load_module, load_weights

Network = TypeVar("Network", bound=nn.Module)


@dataclass(frozen=True)
class TrainedWeights:
    """Saved result of a training under one name."""

    name: str
    tensors: dict[str, Tensor]
    card: WeightsCard

    @staticmethod
    def read(folder: Path, name: str) -> "TrainedWeights":
        """Read the weights of that name; raises CheckpointError if files are missing or damaged."""
        return TrainedWeights(name, *load_weights(folder, name))

    @property
    def sha256(self) -> str:
        """Digest of the weights."""
        return self.card.sha256

    @property
    def normaliser(self) -> Normaliser:
        """Statistics of the training input."""
        with self.card.reporting_errors():
            return Normaliser.of_tensors(self.tensors)

    def prior(self, seed_frames: int) -> GaussianPrior:
        """Return the linear-Gaussian prior of the network."""
        with self.card.reporting_errors():
            return GaussianPrior(self.tensors["prior.covariance"], seed_frames)

    def load_into(self, network: Network) -> Network:
        """Load the weights into an untrained network, and freeze it."""
        load_module(network, self.tensors, "network.", self.name)
        return network.eval().requires_grad_(False)

    as_of = load_into
    """Earlier name of `load_into`, for system families of users."""
