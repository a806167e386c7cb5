"""A small generator with random weights, alone and saved beside an expression network."""

from pathlib import Path

import torch

from model.systems.gan.config import WEIGHTS, GanTrainConfig, GeneratorConfig
from model.systems.gan.network import Generator
from tests.model.made import made_components, made_prior, make_weights, save_made, shaken

TINY = GeneratorConfig(width=16, num_blocks=1, num_heads=2, num_speakers=4, speech_context=6)


def made_generator(config: GeneratorConfig = TINY) -> Generator:
    """Untrained: the prior and nothing else."""
    mean = torch.zeros(config.channels)
    return Generator(config, made_prior(config.channels), made_components(mean, 0.1))


def make_gan_weights(folder: Path) -> Path:
    """The family's weights and the expression network with complete cards."""
    make_weights(folder, {})
    torch.manual_seed(1)
    generator = shaken(made_generator())
    mean = torch.zeros(TINY.channels)
    mean[-2] = 1.2
    statistics = made_components(mean, 0.1).tensors()
    statistics["prior.covariance"] = generator.prior.covariance
    save_made(folder, GanTrainConfig(system=WEIGHTS, generator=TINY), generator, statistics)
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
