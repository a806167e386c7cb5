"""Weights on disk: fp16 safetensors beside a JSON card that names their sha256."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from conventions.names import file_stem
from model.storage.cards import Card, CheckpointError, load_card
from model.storage.files import written_atomically

KEEP_FLOAT32 = ("normaliser.", "prior.")


def save_weights(folder: Path, system: str, tensors: dict[str, Tensor], card: dict) -> None:
    """Write ``<system>.safetensors`` (fp16, statistics fp32) and ``<system>.json``, atomically."""
    folder.mkdir(parents=True, exist_ok=True)
    packed = {
        name: tensor.contiguous()
        if name.startswith(KEEP_FLOAT32) or not tensor.is_floating_point()
        else tensor.half().contiguous()
        for name, tensor in tensors.items()
    }
    content = save(packed)
    card = {"system": system, "sha256": hashlib.sha256(content).hexdigest(), **card}
    for suffix, data in ((".safetensors", content), (".json", _json_bytes(card))):
        path = folder / (file_stem(system) + suffix)
        with written_atomically(path) as temporary:
            temporary.write_bytes(data)


def load_weights(folder: Path, system: str) -> tuple[dict[str, Tensor], Card]:
    """Tensors (as float32) and card of a system.

    Raises:
        CheckpointError: if a file is missing or damaged, or the sha256 differs from the card's.
    """
    card = load_card(folder, system)
    path = folder / f"{file_stem(system)}.safetensors"
    try:
        content = path.read_bytes()
    except OSError as error:
        raise CheckpointError(f"{path} cannot be read: {error.strerror}.") from None
    found = hashlib.sha256(content).hexdigest()
    if found != card.sha256:
        raise CheckpointError(
            f"{path} has sha256 {found[:12]}..., its card says {card.sha256[:12]}...; "
            "restore both files from the same source."
        )
    try:
        tensors = load(content)
    except SafetensorError as error:
        raise CheckpointError(f"{path} is no safetensors file: {error}") from None
    return {name: tensor.float() for name, tensor in tensors.items()}, card


def load_into(module: torch.nn.Module, tensors: dict[str, Tensor], prefix: str, name: str) -> None:
    """Copy the tensors that start with ``prefix`` into ``module``, all of them and no other.

    Raises:
        CheckpointError: with the first tensor that differs, and how many do.
    """
    state = {key.removeprefix(prefix): t for key, t in tensors.items() if key.startswith(prefix)}
    wrong = misfits(module.state_dict(), state)
    if wrong:
        more = f" ({len(wrong) - 1} more differ)" if len(wrong) > 1 else ""
        raise CheckpointError(f"The weights of {name} do not fit their card: {wrong[0]}{more}.")
    module.load_state_dict(state, strict=True)


def misfits(wanted: Mapping[str, Tensor], found: Mapping[str, Tensor]) -> list[str]:
    """What keeps tensors from being a module's, in its order, each as part of a sentence."""
    wrong = []
    for key, tensor in wanted.items():
        if key not in found:
            wrong.append(f"{key} is missing")
        elif found[key].shape != tensor.shape:
            shapes = (list(found[key].shape), list(tensor.shape))
            wrong.append(f"{key} is of shape {shapes[0]} in place of {shapes[1]}")
    return wrong + [f"{key} is not known" for key in found if key not in wanted]


def _json_bytes(card: dict) -> bytes:
    return (json.dumps(card, indent=1, sort_keys=False) + "\n").encode()
