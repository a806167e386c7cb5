"""What a network hears while it learns."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from model.data.prepared import Batch
from model.speech.features import augment_mel, in_other_throats
from model.training.config import TrainConfig


def heard(
    config: TrainConfig, network: nn.Module, batch: Batch, generator: torch.Generator
) -> Float[Tensor, "B T dim"]:
    """The speech features of the whole batch; in training as some microphone might have caught
    them, of some throat."""
    speech = batch.speech
    if network.training and config.throats:
        speech = in_other_throats(speech, config.throats, generator)
    if network.training and config.augment_speech:
        speech = augment_mel(speech, generator)
    return speech
