"""A small generator with random weights, alone and saved beside an expression network."""

import json
from pathlib import Path

import torch

from model.storage.cards import to_json
from model.storage.checkpoint import save_weights
from model.systems.gan.config import WEIGHTS, GanConfig, GeneratorConfig
from model.systems.gan.generator import Generator
from tests.model.made import made_components, made_prior, make_weights

TINY = GeneratorConfig(width=16, num_blocks=1, num_heads=2, num_speakers=4, speech_context=6)


def made_generator(config: GeneratorConfig = TINY) -> Generator:
    """Untrained: the prior and nothing else."""
    mean = torch.zeros(config.channels)
    return Generator(config, made_prior(config.channels), made_components(mean, 0.1))


def shaken(generator: Generator) -> Generator:
    """Its weights moved, so that its branches say something."""
    generator.eval()
    with torch.no_grad():
        for parameter in generator.parameters():
            parameter += 0.05 * torch.randn_like(parameter)
    return generator


def make_gan_weights(folder: Path) -> Path:
    """The family's weights and the expression network with complete cards."""
    make_weights(folder, {})
    torch.manual_seed(1)
    generator = shaken(made_generator())
    mean = torch.zeros(TINY.channels)
    mean[-2] = 1.2
    tensors = {f"network.{k}": v for k, v in generator.state_dict().items()}
    tensors |= made_components(mean, 0.1).tensors()
    tensors["prior.covariance"] = generator.prior.covariance
    config = GanConfig(system=WEIGHTS, generator=TINY)
    card = {"config": json.loads(to_json(config)), "speakers": {"ann": 1, "bob": 2}, "steps": 0}
    save_weights(folder, WEIGHTS, tensors, card)
    return folder


def told(config: GeneratorConfig, size: int, **changes: torch.Tensor) -> dict[str, torch.Tensor]:
    """What a generator hears and knows of ``size`` windows."""
    heard = config.window_frames + 2 * config.speech_context
    return {
        "speech": torch.randn(size, heard, config.speech_dim),
        "seed": torch.randn(size, config.seed_frames, config.channels),
        "speaker": torch.arange(size) % config.num_speakers,
        "has_seed": torch.arange(size) % 2 == 0,
        "has_speech": torch.ones(size, dtype=torch.bool),
        **changes,
    }
