"""What a network hears while it learns."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from model.data.prepared import Batch
from model.speech.features import augment_mel
from model.training.config import TrainConfig


def heard(
    config: TrainConfig, network: nn.Module, batch: Batch, generator: torch.Generator
) -> Float[Tensor, "B T dim"]:
    """The speech features of the whole batch; in training as some microphone might have caught
    them."""
    if network.training and config.augment_speech:
        return augment_mel(batch.speech, generator)
    return batch.speech
