"""Reads the files that the authors' training script saves, and tells what was found."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import torch
from torch import nn

from model.generation.family import FileReport
from model.storage.cards import CheckpointError
from model.storage.torch_file import check_tensors, read_tensors
from model.systems.official.files import PARTS, OfficialFiles, Part
from model.systems.official.networks import (
    OfficialExpressionNetwork,
    OfficialMaskedVAE,
    OfficialMotionNetwork,
)
from model.systems.official.speech import official_encoder

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


_ADVICE = "see docs/official.md"


def reports_of(files: OfficialFiles) -> Iterator[FileReport]:
    """Of each network, and of what hears for them."""
    for part in PARTS:
        name, is_needed = f"official {part}", part in ("motion", "expression")
        try:
            path = files.path(part)
            count = sum(each.numel() for each in load_network(part, path).parameters())
        except Exception as error:  # whatever is wrong with a file is what is told
            yield FileReport(name, error=error, advice=_ADVICE, is_needed=is_needed)
        else:
            detail = f"{path.relative_to(files.folder)}, {count / 1e6:.1f} M parameters"
            yield FileReport(name, detail)
    try:
        official_encoder()
    except Exception as error:  # as above, of what transformers raises
        yield FileReport("official speech", error=error, advice=_ADVICE)
    else:
        yield FileReport("official speech", "WavLM, HuBERT or features are there")
