import json

import pytest

from model.generation.family import UnknownNameError
from model.storage.cards import CheckpointError, file_stem, load_card
from model.systems.registry import list_speakers, list_systems, load_system
from tests.model.made import make_weights


@pytest.fixture
def folder(tmp_path):
    return make_weights(tmp_path / "weights")


def test_folder_is_listed_without_loading(folder):
    assert list_systems(folder) == ("globaldiff/local", "globaldiff/global")
    assert list_speakers(folder) == ("ann", "bob")
    assert list_systems(folder / "nowhere") == () == list_speakers(folder / "nowhere")
    assert file_stem("globaldiff/global") == "globaldiff-global"


def test_a_loaded_system_knows_its_speakers(folder):
    system = load_system("globaldiff/local", folder)
    assert system.config.rotation_space == "local" and system.speaker_index("bob") == 2
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
