"""A system: a trained generator with a name, its weights, its card and its expression network."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from model.cards import BUNDLED_WEIGHTS, CheckpointError, list_systems
from model.checkpoint import load_into, load_weights
from model.config import ExpressionConfig, NetworkConfig, from_dict
from model.expression import ExpressionNetwork
from model.network import MotionNetwork
from model.packing import Normaliser
from model.speech.encoder import SpeechEncoder
from model.speech.encoders import make_encoder

EXPRESSION_BASIS = "arkit52"


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
    network: MotionNetwork
    normaliser: Normaliser
    expression_network: ExpressionNetwork
    expression_sha256: str
    encoder: SpeechEncoder

    @property
    def config(self) -> NetworkConfig:
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
    expression_tensors, expression_card = load_weights(folder, "expression")
    try:
        config = from_dict(NetworkConfig, card["config"]["network"])
        expression_config = from_dict(ExpressionConfig, expression_card["config"]["expression"])
        speakers = {str(k): int(v) for k, v in card["speakers"].items()}
        encoder = make_encoder(card["config"]["encoder"])
        normaliser = Normaliser(tensors["normaliser.mean"], tensors["normaliser.std"])
    except (KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(f"The card of {name} lacks or misstates {error}.") from None
    network = MotionNetwork(config)
    load_into(network, tensors, "network.", name)
    expression_network = ExpressionNetwork(expression_config)
    load_into(expression_network, expression_tensors, "network.", "expression")
    for module in (network, expression_network):
        module.eval().requires_grad_(False)
    return System(
        name=name,
        card=card,
        sha256=card["sha256"],
        speakers=speakers,
        network=network,
        normaliser=normaliser,
        expression_network=expression_network,
        expression_sha256=expression_card["sha256"],
        encoder=encoder,
    )


def warm_up(system: System) -> None:
    """One evaluation, so that the first visitor waits no longer than the second."""
    config = system.config
    with torch.inference_mode():
        system.network(
            torch.zeros(1, config.window_frames, system.normaliser.mean.numel()),
            torch.zeros(1),
            speech=torch.zeros(1, config.window_frames, config.speech_dim),
            expression=torch.zeros(1, config.window_frames, config.expression_dim),
            seed=torch.zeros(1, config.seed_frames, system.normaliser.mean.numel()),
            speaker=torch.zeros(1, dtype=torch.long),
            has_seed=torch.zeros(1, dtype=torch.bool),
            has_speech=torch.ones(1, dtype=torch.bool),
        )
