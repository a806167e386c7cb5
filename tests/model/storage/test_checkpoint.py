import json

import pytest
import torch

from model.storage.cards import CheckpointError, file_stem, list_speakers, list_systems, load_card
from model.storage.checkpoint import load_weights, save_weights
from model.systems.base import UnknownNameError, load_system, warm_up
from tests.model.made import make_weights


@pytest.fixture
def folder(tmp_path):
    return make_weights(tmp_path / "weights")


def test_weights_come_back_as_fp16_rounds_them(tmp_path):
    tensors = {"network.a": torch.randn(3, 4), "normaliser.mean": torch.randn(5) * 1e-5}
    save_weights(tmp_path, "globaldiff/global", tensors, {"steps": 3})
    back, card = load_weights(tmp_path, "globaldiff/global")
    assert card["system"] == "globaldiff/global" and card["steps"] == 3
    torch.testing.assert_close(back["network.a"], tensors["network.a"].half().float())
    torch.testing.assert_close(back["normaliser.mean"], tensors["normaliser.mean"])
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "globaldiff-global.json", "globaldiff-global.safetensors",
    ]  # fmt: skip


def test_folder_is_listed_without_loading(folder):
    assert list_systems(folder) == ("globaldiff/local", "globaldiff/global")
    assert list_speakers(folder) == ("ann", "bob")
    assert list_systems(folder / "nowhere") == () == list_speakers(folder / "nowhere")
    assert file_stem("globaldiff/global") == "globaldiff-global"


def test_a_loaded_system_runs(folder):
    system = load_system("globaldiff/local", folder)
    assert system.config.rotation_space == "local" and system.speaker_index("bob") == 2
    warm_up(system)
    with pytest.raises(UnknownNameError, match="no speaker 'eve'; choose one of ann, bob"):
        system.speaker_index("eve")


def test_unknown_system_lists_those_that_are_there(folder):
    with pytest.raises(UnknownNameError, match="globaldiff/local, globaldiff/global"):
        load_system("globaldiff/huge", folder)


def test_changed_weights_are_refused(folder):
    path = folder / "globaldiff-local.safetensors"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(CheckpointError, match="sha256"):
        load_system("globaldiff/local", folder)


def test_card_of_another_shape_is_refused(folder):
    path = folder / "globaldiff-local.json"
    card = json.loads(path.read_text())
    card["config"]["network"]["num_blocks"] = 2
    path.write_text(json.dumps(card))
    with pytest.raises(CheckpointError, match="do not fit"):
        load_system("globaldiff/local", folder)
    del card["speakers"]
    path.write_text(json.dumps(card))
    with pytest.raises(CheckpointError, match="speakers"):
        load_system("globaldiff/local", folder)


def test_damaged_cards_are_refused(folder):
    for content in ("{", "[]", "{}"):
        (folder / "expression.json").write_text(content)
        with pytest.raises(CheckpointError):
            load_card(folder, "expression")
    (folder / "expression.json").unlink()
    with pytest.raises(CheckpointError, match="is missing"):
        load_system("globaldiff/local", folder)
