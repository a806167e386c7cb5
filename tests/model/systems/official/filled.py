"""Weights that follow from their names alone: the same for whoever fills a network by the rule."""

import hashlib
import zlib
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor, nn

Network = TypeVar("Network", bound=nn.Module)


def drawn(name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Standard normal numbers (float64) that follow from a name."""
    return np.random.default_rng(zlib.crc32(name.encode())).standard_normal(shape)


def rule(name: str, shape: tuple[int, ...]) -> np.ndarray:
    """What a tensor of that name holds, float32."""
    z = drawn(name, shape)
    if name.endswith("running_mean"):
        filled = 0.1 * z
    elif name.endswith("running_var"):
        filled = 1 + 0.1 * abs(z)
    elif len(shape) >= 2:
        filled = z / np.sqrt(np.prod(shape[1:]))
    elif name.endswith("weight"):
        filled = 1 + 0.1 * z
    else:
        filled = 0.02 * z
    return filled.astype(np.float32)


def fill(network: Network) -> Network:
    """The network, filled by the rule, ready to be asked."""
    state = {
        name: tensor
        if name.endswith("inv_freq") or not tensor.is_floating_point()
        else torch.from_numpy(rule(name, tuple(tensor.shape)))
        for name, tensor in network.state_dict().items()
    }
    network.load_state_dict(state)
    return network.eval().requires_grad_(False)


def sha256_of(network: nn.Module) -> str:
    """Of all names and all bytes, in order."""
    told = hashlib.sha256()
    for name, tensor in network.state_dict().items():
        told.update(name.encode())
        told.update(tensor.numpy().tobytes())
    return told.hexdigest()


def made(name: str, shape: tuple[int, ...]) -> Tensor:
    """An input that follows from its name."""
    return torch.from_numpy(drawn(name, shape).astype(np.float32))
