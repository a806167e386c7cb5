"""Reads the files that the authors' training script saves into the networks of this folder."""

import hashlib
from pathlib import Path

import torch
from torch import nn

from model.storage.cards import CheckpointError
from model.storage.torch_file import check_tensors, read_tensors
from model.systems.official.expression_network import OfficialExpressionNetwork
from model.systems.official.files import Part
from model.systems.official.masked_vae import OfficialMaskedVAE
from model.systems.official.motion_network import OfficialMotionNetwork

_NETWORKS = {
    "motion": OfficialMotionNetwork,
    "expression": OfficialExpressionNetwork,
    "vae2": lambda: OfficialMaskedVAE(2),
    "vae3": lambda: OfficialMaskedVAE(3),
}


def make_network(part: Part) -> nn.Module:
    """A network that knows nothing yet."""
    return _NETWORKS[part]()


def load_network(part: Part, path: Path) -> nn.Module:
    """A network with the weights of a file, every one of them and no other.

    Raises:
        CheckpointError: if the file cannot be read, or with the first key that differs.
    """
    tensors = read_tensors(path)
    with torch.device("meta"):
        wanted = make_network(part).state_dict()
    check_tensors(
        wanted,
        tensors,
        path.name,
        f"the authors' {part} network",
        "a file that their training script saved",
    )
    network = make_network(part)
    network.load_state_dict(tensors)
    return network.eval().requires_grad_(False)


def sha256_of(path: Path) -> str:
    """Of the whole file.

    Raises:
        CheckpointError: if it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise CheckpointError(f"{path} cannot be read: {error.strerror}.") from None
