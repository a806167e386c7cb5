"""Checkpoints as the authors' script saves them, as people pass them on, and such as are none."""

import pickle
import zipfile
from collections import OrderedDict
from pathlib import Path

import pytest
import torch
from torch import Tensor

from model.storage.cards import CheckpointError
from model.storage.checkpoint import read_torch_checkpoint
from model.systems.official.checkpoints import network_by_file_name, official_file, official_folder
from model.systems.official.networks import load_network, make_network
from tests.model.systems.official.filled import fill
from tests.model.training.made import assert_equal_states

MOTION = (
    "ckpt/split/DiffusionDITNetPartsFixedExpressions2PostNorm_LL_split_HorizonFlip_MaskedVAE3_W02"
)


def _made(folder: Path, *names: str) -> Path:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder


@pytest.fixture(scope="module")
def expression() -> OrderedDict[str, Tensor]:
    return OrderedDict(fill(make_network("expression")).state_dict())


@pytest.mark.parametrize(
    ("name", "part"),
    [
        (f"{MOTION}/epoch_999", "motion"),
        (f"{MOTION}/best.pt", "motion"),
        ("epoch_19", "motion"),
        ("SimpleSpeechModel/best.pt", "expression"),
        ("SimpleSpeechModel/best.zip", "expression"),
        ("VAE/ckpt/split/global/MaskedVAE2-HorizonFlip/best.pt", None),
        ("best.pt", None),
        (f"{MOTION}/log.txt", None),
        (f"{MOTION}/epoch_999_results", None),
    ],
)
def test_names_tell_the_network(name, part):
    assert network_by_file_name(Path(name)) == part


def test_the_last_epoch_is_taken_unless_one_is_called_best(tmp_path, monkeypatch):
    monkeypatch.setenv("OFFICIAL_DIR", str(_made(tmp_path / "SimpleSpeechModel", "best.pt")))
    assert official_file("expression").name == "best.pt"
    folder = _made(tmp_path / "all", *(f"{MOTION}/epoch_{n}" for n in (19, 999, 99)))
    monkeypatch.setenv("OFFICIAL_DIR", str(folder))
    assert official_file("motion").name == "epoch_999"
    _made(folder, f"{MOTION}/best.pt")
    assert official_file("motion").name == "best.pt"


def test_what_is_missing_is_told(tmp_path, monkeypatch):
    monkeypatch.delenv("OFFICIAL_DIR", raising=False)
    assert official_folder() is None
    with pytest.raises(CheckpointError, match="give the folder with --official FOLDER"):
        official_file("motion")
    monkeypatch.setenv("OFFICIAL_DIR", str(tmp_path / "nowhere"))
    with pytest.raises(CheckpointError, match=r"There is no folder .*nowhere; name the one"):
        official_folder()
    monkeypatch.setenv("OFFICIAL_DIR", str(_made(tmp_path, "epoch_19")))
    with pytest.raises(CheckpointError, match=r"no file of the expression model; .* Simple"):
        official_file("expression")


def _zipped(path: Path, *names: str) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.write(path.with_name(name.rsplit("/", 1)[-1]), name)
    return path


def test_a_file_of_the_script_fills_the_network(expression, tmp_path):
    torch.save(expression, tmp_path / "best.pt")
    network = load_network("expression", tmp_path / "best.pt")
    assert_equal_states(dict(network.state_dict()), dict(expression))
    assert not network.training and not any(p.requires_grad for p in network.parameters())


def test_other_ways_of_saving_are_read_alike(expression, tmp_path):
    small = OrderedDict(list(expression.items())[-6:])
    for name, content in {
        "prefixed.pt": {f"module.{key}": tensor for key, tensor in small.items()},
        "wrapped.pt": {"epoch": 3, "state_dict": dict(small)},
        "epoch_19": small,
    }.items():
        torch.save(content, tmp_path / name)
    torch.save(small, tmp_path / "old.pt", _use_new_zipfile_serialization=False)
    _zipped(tmp_path / "best.zip", "folder/epoch_19")
    for path in tmp_path.iterdir():
        assert_equal_states(dict(read_torch_checkpoint(path)), dict(small))
    torch.save({key: tensor.half() for key, tensor in small.items()}, tmp_path / "half.pt")
    read = read_torch_checkpoint(tmp_path / "half.pt").values()
    assert {tensor.dtype for tensor in read} == {torch.float32}


def test_the_first_name_that_does_not_fit_is_told(expression, tmp_path):
    path, bias = tmp_path / "best.pt", "vertice_map_r.bias"
    lacking = {name: each for name, each in expression.items() if name != "style_embed.mlp.2.bias"}
    wider = {"audio_feature_map.weight": torch.zeros(512, 832), bias: torch.zeros(99)}
    told = {
        r"map.weight has the shape \[512, 832\] instead of \[512, 1088\] \(1": expression | wider,
        r"style_embed.mlp.2.bias is missing; give a file": lacking,
        "extra is not part of the network": expression | {"extra": torch.zeros(1)},
        rf"not finite .* first in {bias}": expression | {bias: torch.full((100,), torch.nan)},
    }
    for sentence, content in told.items():
        torch.save(OrderedDict(content), path)
        with pytest.raises(CheckpointError, match=sentence):
            load_network("expression", path)


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
            read_torch_checkpoint(tmp_path / name)
    assert not mark.exists()


def test_what_is_no_checkpoint_is_told(tmp_path):
    torch.save([1, 2], tmp_path / "list.pt")
    torch.save({"epoch": 3}, tmp_path / "number.pt")
    _zipped(tmp_path / "two.zip", "list.pt", "number.pt")
    whole = (tmp_path / "list.pt").read_bytes()
    contents = {"empty.pt": b"", "text.pt": b"hello", "half.pt": whole[: len(whole) // 2]}
    for name, content in (contents | {"zip.zip": b"PK\x05\x06"}).items():
        (tmp_path / name).write_bytes(content)
    for name, sentence in {
        **dict.fromkeys(contents, "cannot be read as a checkpoint"),
        "zip.zip": "(cannot be read|holds)",
        "list.pt": "holds no dictionary of tensors",
        "number.pt": "holds a int as 'epoch'",
        "two.zip": "holds 2 files, but a zip must hold exactly one checkpoint",
    }.items():
        with pytest.raises(CheckpointError, match=f"{name} {sentence}"):
            read_torch_checkpoint(tmp_path / name)
