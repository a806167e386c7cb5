"""Weights on disk: our fp16 safetensors with JSON cards, and untrusted ``torch.save`` files.

A card states the sha256 of its weights; nothing in untrusted files is executed.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Shaped
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from conventions.names import safe_file_stem
from model.storage.cards import CheckpointError, WeightsCard, load_card
from model.storage.files import read_within_limit, write_atomically

KEEP_FLOAT32 = ("normaliser.", "prior.")


def save_weights(
    folder: Path, system: str, tensors: dict[str, Shaped[Tensor, " ..."]], card: dict
) -> None:
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
    card_json = (json.dumps(card, indent=1) + "\n").encode()
    for suffix, data in ((".safetensors", content), (".json", card_json)):
        path = folder / (safe_file_stem(system) + suffix)
        write_atomically(path, data)


def load_weights(folder: Path, system: str) -> tuple[dict[str, Tensor], WeightsCard]:
    """Load tensors (as float32) and card; raises CheckpointError if missing or damaged."""
    card = load_card(folder, system)
    path = folder / f"{safe_file_stem(system)}.safetensors"
    content = read_within_limit(path, MAX_BYTES, CheckpointError)
    digest = hashlib.sha256(content).hexdigest()
    if digest != card.sha256:
        raise CheckpointError(
            f"{path} has the sha256 {digest[:12]}..., but its model card (.json) states "
            f"{card.sha256[:12]}...; restore both files from the same source."
        )
    try:
        tensors = load(content)
    except SafetensorError as error:
        raise CheckpointError(f"{path} is not a safetensors file: {error}") from None
    return {name: tensor.float() for name, tensor in tensors.items()}, card


def load_module(
    module: torch.nn.Module, tensors: dict[str, Shaped[Tensor, " ..."]], prefix: str, name: str
) -> None:
    """Copy exactly the tensors with a prefix into ``module``; raises CheckpointError."""
    state = {key.removeprefix(prefix): t for key, t in tensors.items() if key.startswith(prefix)}
    wrong = tensor_mismatches(module.state_dict(), state)
    if wrong:
        more = f" ({len(wrong) - 1} more differ)" if len(wrong) > 1 else ""
        raise CheckpointError(
            f"The weights of {name} do not match the network in their model card: {wrong[0]}{more}."
        )
    module.load_state_dict(state, strict=True)


def tensor_mismatches(
    expected: Mapping[str, Shaped[Tensor, " ..."]], tensors: Mapping[str, Shaped[Tensor, " ..."]]
) -> list[str]:
    """Describe each mismatch between a module's tensors and others, in the module's order."""
    wrong = []
    for key, tensor in expected.items():
        if key not in tensors:
            wrong.append(f"{key} is missing")
        elif tensors[key].shape != tensor.shape:
            shapes = (list(tensors[key].shape), list(tensor.shape))
            wrong.append(f"{key} has the shape {shapes[0]} instead of {shapes[1]}")
    return wrong + [f"{key} is not part of the network" for key in tensors if key not in expected]


MAX_BYTES = 2 * 10**9
"""Largest file of weights that is read (bytes), also inside a zip; the largest known: 172 MB."""
_PREFIX = "module."
_WRAPPERS = ("state_dict", "model", "model_state_dict", "model_state", "net", "gen_dict")


def read_torch_checkpoint(path: Path) -> dict[str, Tensor]:
    """Read a checkpoint's tensors by the names of the bare network, floats as float32.

    Files of any version of ``torch.save`` are read, alone or in a zip, with or without a parallel
    network's prefix, from any device; nothing is executed. Raises CheckpointError for other files.
    """
    try:
        content = _loaded(path)
    except CheckpointError:
        raise
    except Exception as error:  # a damaged file makes torch's reader raise almost anything
        reason = str(error).splitlines()[0][:160] if str(error) else type(error).__name__
        raise CheckpointError(f"{path.name} cannot be read as a checkpoint: {reason}.") from None
    for name in _WRAPPERS:
        if isinstance(content, Mapping) and isinstance(content.get(name), Mapping):
            content = content[name]
    if not isinstance(content, Mapping) or not content:
        raise CheckpointError(
            f"{path.name} holds no dictionary of tensors; give a saved state_dict."
        )
    tensors: dict[str, Tensor] = {}
    for key, tensor in content.items():
        if not isinstance(tensor, Tensor):
            raise CheckpointError(
                f"{path.name} holds a {type(tensor).__name__} as {key!r} where a tensor is "
                "needed; give a saved state_dict."
            )
        tensors[str(key)] = tensor.float() if tensor.is_floating_point() else tensor
    if all(key.startswith(_PREFIX) for key in tensors):
        tensors = {key.removeprefix(_PREFIX): tensor for key, tensor in tensors.items()}
    return tensors


def _loaded(path: Path) -> Any:
    """Load the content of a file with ``weights_only``."""
    if not zipfile.is_zipfile(path):
        return torch.load(path, map_location="cpu", weights_only=True)
    with zipfile.ZipFile(path) as archive:
        members = [item for item in archive.infolist() if not item.is_dir()]
        if any(item.filename.rsplit("/", 1)[-1] == "data.pkl" for item in members):
            return torch.load(path, map_location="cpu", weights_only=True, mmap=True)
        inside = [item for item in members if "__MACOSX" not in item.filename]
        if len(inside) != 1:
            raise CheckpointError(
                f"{path.name} holds {len(inside)} files, but a zip must hold exactly one "
                "checkpoint; unpack it and use the checkpoint file itself."
            )
        if inside[0].file_size > MAX_BYTES:
            raise CheckpointError(
                f"{path.name} would unpack to {inside[0].file_size / 1e9:.1f} GB; the limit is "
                f"{MAX_BYTES / 1e9:.0f} GB."
            )
        content = io.BytesIO(archive.read(inside[0]))
    return torch.load(content, map_location="cpu", weights_only=True)


def check_tensors(
    expected: Mapping[str, Shaped[Tensor, " ..."]],
    tensors: Mapping[str, Shaped[Tensor, " ..."]],
    name: str,
    network: str,
    advice: str,
) -> None:
    """Check that tensors are all those of a network, no others, and finite.

    In the message, ``network`` is the required one, and ``advice``, at its end, which file to use.
    Raises CheckpointError with the first key that differs.
    """
    wrong = tensor_mismatches(expected, tensors)
    if wrong:
        more = f" ({len(wrong) - 1} more differ)" if len(wrong) > 1 else ""
        raise CheckpointError(f"{name} is not {network}: {wrong[0]}{more}; give {advice}.")
    unknown = [key for key, tensor in tensors.items() if not tensor.isfinite().all()]
    if unknown:
        raise CheckpointError(
            f"{name} holds values that are not finite (NaN or infinite), first in {unknown[0]}; "
            "use another copy of the file, or a checkpoint of another epoch."
        )
