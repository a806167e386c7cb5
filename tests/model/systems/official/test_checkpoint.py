"""Checkpoints as the authors' script saves them, as people pass them on, and such as are none."""

import pickle
import zipfile
from collections import OrderedDict
from pathlib import Path

import pytest
import torch
from torch import Tensor

from model.storage.cards import CheckpointError
from model.storage.torch_file import read_tensors
from model.systems.official.checkpoint import load_network, make_network
from tests.model.systems.official.filled import fill, sha256_of


@pytest.fixture(scope="module")
def expression() -> OrderedDict[str, Tensor]:
    return OrderedDict(fill(make_network("expression")).state_dict())


def _same(tensors: dict[str, Tensor], wanted: OrderedDict[str, Tensor]) -> bool:
    return list(tensors) == list(wanted) and all(
        torch.equal(tensors[key], wanted[key]) for key in wanted
    )


def _zipped(path: Path, *names: str) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.write(path.with_name(name.rsplit("/", 1)[-1]), name)
    return path


def test_a_file_of_the_script_fills_the_network(expression, tmp_path):
    torch.save(expression, tmp_path / "best.pt")
    network = load_network("expression", tmp_path / "best.pt")
    assert sha256_of(network) == sha256_of(fill(make_network("expression")))
    assert not network.training and not any(p.requires_grad for p in network.parameters())


def test_other_ways_of_saving_are_read_alike(expression, tmp_path):
    small = OrderedDict(list(expression.items())[-6:])
    ways = {
        "prefixed.pt": {f"module.{key}": tensor for key, tensor in small.items()},
        "wrapped.pt": {"epoch": 3, "state_dict": dict(small)},
        "epoch_19": small,
    }
    for name, content in ways.items():
        torch.save(content, tmp_path / name)
        assert _same(read_tensors(tmp_path / name), small), name
    torch.save(small, tmp_path / "old.pt", _use_new_zipfile_serialization=False)
    assert _same(read_tensors(tmp_path / "old.pt"), small)
    assert _same(read_tensors(_zipped(tmp_path / "best.zip", "folder/epoch_19")), small)
    halves = {key: tensor.half() for key, tensor in small.items()}
    torch.save(halves, tmp_path / "half.pt")
    assert all(
        tensor.dtype == torch.float32 for tensor in read_tensors(tmp_path / "half.pt").values()
    )


def test_the_first_name_that_differs_is_told_with_both_shapes(expression, tmp_path):
    path = tmp_path / "best.pt"
    wider = OrderedDict(expression)
    wider["audio_feature_map.weight"] = torch.zeros(512, 832)
    wider["vertice_map_r.bias"] = torch.zeros(99)
    torch.save(wider, path)
    with pytest.raises(
        CheckpointError,
        match=r"audio_feature_map.weight is of shape \[512, 832\] in place of \[512, 1088\] \(1",
    ):
        load_network("expression", path)
    lacking = OrderedDict(expression)
    del lacking["style_embed.mlp.2.bias"]
    torch.save(lacking, path)
    with pytest.raises(CheckpointError, match=r"style_embed.mlp.2.bias is missing; give a file"):
        load_network("expression", path)
    torch.save(OrderedDict(expression, extra=torch.zeros(1)), path)
    with pytest.raises(CheckpointError, match="extra is not known"):
        load_network("expression", path)
    with pytest.raises(CheckpointError, match="not the authors' vae2 network: mask_val is missing"):
        load_network("vae2", path)


def test_weights_that_are_no_numbers_are_refused(expression, tmp_path):
    broken = OrderedDict(expression)
    broken["vertice_map_r.bias"] = torch.full((100,), torch.nan)
    torch.save(broken, tmp_path / "best.pt")
    with pytest.raises(CheckpointError, match=r"not finite .* in vertice_map_r.bias first"):
        load_network("expression", tmp_path / "best.pt")


class _Harmful:
    """What a file could do if it were trusted."""

    def __reduce__(self):
        return Path.touch, (Path(self.path),)

    def __init__(self, path: Path) -> None:
        self.path = str(path)


def test_nothing_in_a_file_is_executed(tmp_path):
    mark = tmp_path / "executed"
    torch.save({"weight": _Harmful(mark)}, tmp_path / "new.pt")
    (tmp_path / "old.pt").write_bytes(pickle.dumps({"weight": _Harmful(mark)}, protocol=2))
    for name in ("new.pt", "old.pt"):
        with pytest.raises(CheckpointError, match=f"{name} cannot be read as a checkpoint"):
            read_tensors(tmp_path / name)
    assert not mark.exists()


def test_what_is_no_checkpoint_is_told(tmp_path):
    for name, content in (("empty.pt", b""), ("text.pt", b"hello"), ("zip.zip", b"PK\x05\x06")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CheckpointError, match=f"{name} (cannot be read|holds)"):
            read_tensors(tmp_path / name)
    torch.save([1, 2], tmp_path / "list.pt")
    with pytest.raises(CheckpointError, match=r"list.pt holds no table of tensors"):
        read_tensors(tmp_path / "list.pt")
    torch.save({"epoch": 3}, tmp_path / "number.pt")
    with pytest.raises(CheckpointError, match=r"number.pt holds a int as 'epoch'"):
        read_tensors(tmp_path / "number.pt")
    both = _zipped(tmp_path / "two.zip", "list.pt", "number.pt")
    with pytest.raises(CheckpointError, match=r"two.zip holds 2 files; a zip of one checkpoint"):
        read_tensors(both)
    whole = (tmp_path / "list.pt").read_bytes()
    (tmp_path / "half.pt").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CheckpointError, match=r"half.pt cannot be read as a checkpoint"):
        read_tensors(tmp_path / "half.pt")
