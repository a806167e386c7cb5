"""Trained weights as networks are made of them: tensors, statistics among them, and their card."""

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from torch import Tensor, nn

from model.motion.packing import Normaliser
from model.sampling.prior import GaussianPrior
from model.storage.cards import Card
from model.storage.checkpoint import load_into, load_weights

Network = TypeVar("Network", bound=nn.Module)


@dataclass(frozen=True)
class Trained:
    """What is saved of a training under one name."""

    name: str
    tensors: dict[str, Tensor]
    card: Card

    @staticmethod
    def read(folder: Path, name: str) -> "Trained":
        """The weights of that name.

        Raises:
            CheckpointError: if files are missing or damaged.
        """
        return Trained(name, *load_weights(folder, name))

    @property
    def sha256(self) -> str:
        """Of the weights."""
        return self.card.sha256

    @property
    def normaliser(self) -> Normaliser:
        """Statistics of the input that the weights learned with."""
        with self.card.reading():
            return Normaliser.of_tensors(self.tensors)

    def prior(self, seed_frames: int) -> GaussianPrior:
        """The linear-Gaussian prior that the network stands on."""
        with self.card.reading():
            return GaussianPrior(self.tensors["prior.covariance"], seed_frames)

    def as_of(self, network: Network) -> Network:
        """An untrained network with these weights, never changed again."""
        load_into(network, self.tensors, "network.", self.name)
        return network.eval().requires_grad_(False)
