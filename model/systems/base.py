"""A system: a trained generator with a name, its weights, its card and its expression network."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from model.motion.packing import Normaliser
from model.networks.expression import Face
from model.networks.prior_network import PriorNetwork
from model.sampling.prior import GaussianPrior
from model.speech.encoder import SpeechEncoder
from model.speech.encoders import make_encoder
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError, list_systems
from model.storage.checkpoint import load_into, load_weights
from model.storage.settings import ExpressionConfig, NetworkConfig, from_dict
from model.systems.globaldiff.network import MotionNetwork

EXPRESSION_BASIS = "arkit52"
EXPRESSION = "expression"


class UnknownNameError(ValueError):
    """A system or speaker that does not exist; the message lists those that do."""


@dataclass(frozen=True)
class System:
    """Everything needed to generate motion with one trained generator."""

    name: str
    card: dict[str, Any]
    sha256: str
    speakers: dict[str, int]
    """Speaker name -> index in the network's table."""
    network: MotionNetwork | PriorNetwork
    normaliser: Normaliser
    face: Face
    encoder: SpeechEncoder

    @property
    def config(self) -> NetworkConfig:
        assert isinstance(self.network.config, NetworkConfig)
        return self.network.config

    def speaker_index(self, speaker: str) -> int:
        """Index of a speaker by name.

        Raises:
            UnknownNameError: if these weights were not trained on that speaker.
        """
        if speaker not in self.speakers:
            raise UnknownNameError(
                f"There is no speaker {speaker!r}; choose one of {', '.join(self.speakers)}."
            )
        return self.speakers[speaker]


def load_system(name: str, folder: Path = BUNDLED_WEIGHTS) -> System:
    """Read a system and the expression network beside it.

    Raises:
        UnknownNameError: if there is no such system; the message lists those that are there.
        CheckpointError: if its files are missing or damaged.
    """
    available = list_systems(folder)
    if name not in available:
        found = ", ".join(available) if available else f"none in {folder}"
        raise UnknownNameError(f"There is no system {name!r}; available: {found}.")
    tensors, card = load_weights(folder, name)
    try:
        config = from_dict(NetworkConfig, card["config"]["network"])
        speakers = {str(k): int(v) for k, v in card["speakers"].items()}
        encoder = make_encoder(card["config"]["encoder"])
        normaliser = Normaliser.of_tensors(tensors)
        if config.prior:
            network: MotionNetwork | PriorNetwork = PriorNetwork(
                config,
                GaussianPrior(tensors["prior.covariance"], config.seed_frames),
                channels=config.motion_dim,
                expression_dim=config.expression_dim,
            )
        else:
            network = MotionNetwork(config)
    except (KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(f"The card of {name} lacks or misstates {error}.") from None
    load_into(network, tensors, "network.", name)
    network.eval().requires_grad_(False)
    return System(
        name=name,
        card=card,
        sha256=card["sha256"],
        speakers=speakers,
        network=network,
        normaliser=normaliser,
        face=load_face(folder),
        encoder=encoder,
    )


def load_face(folder: Path = BUNDLED_WEIGHTS) -> Face:
    """Read the expression network.

    Raises:
        CheckpointError: if its files are missing or damaged.
    """
    tensors, card = load_weights(folder, EXPRESSION)
    try:
        config = from_dict(ExpressionConfig, card["config"]["expression"])
        normaliser = Normaliser.of_tensors(tensors)
        prior = GaussianPrior(tensors["prior.covariance"], config.seed_frames)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise CheckpointError(f"The card of {EXPRESSION} lacks or misstates {error}.") from None
    network = PriorNetwork(config, prior, channels=config.expression_dim, expression_dim=0)
    load_into(network, tensors, "network.", EXPRESSION)
    network.eval().requires_grad_(False)
    return Face(network, normaliser, card["sha256"])


def warm_up(system: System) -> None:
    """One evaluation, so that the first visitor waits no longer than the second."""
    config = system.config
    with torch.inference_mode():
        system.network(
            torch.zeros(1, config.window_frames, config.motion_dim),
            torch.zeros(1),
            speech=torch.zeros(
                1, config.window_frames + 2 * config.speech_context, config.speech_dim
            ),
            expression=torch.zeros(1, config.window_frames, config.expression_dim),
            seed=torch.zeros(1, config.seed_frames, config.motion_dim),
            speaker=torch.zeros(1, dtype=torch.long),
            has_seed=torch.zeros(1, dtype=torch.bool),
            has_speech=torch.ones(1, dtype=torch.bool),
        )
