import ast
import json
from typing import get_args

import pytest

from model.generation.family import Use
from model.sampling.samplers import UnknownNameError
from model.storage.cards import CheckpointError, load_card
from model.systems.registry import (
    families,
    list_speakers,
    list_systems,
    load_system,
    planning_systems,
    usual_systems,
)
from tests.helpers import ROOT
from tests.model.made import make_weights


@pytest.fixture
def folder(tmp_path):
    return make_weights(tmp_path / "weights")


def test_folder_is_listed_without_loading(folder):
    assert list_systems(folder) == ("globaldiff/local", "globaldiff/global")
    assert list_speakers(folder) == ("ann", "bob")
    assert list_systems(folder / "nowhere") == () == list_speakers(folder / "nowhere")


def test_families_are_those_of_the_folders_in_the_order_of_their_places():
    beside = [each.parent.name for each in (ROOT / "model" / "systems").glob("*/__init__.py")]
    found = [family for family in families() if family.package.startswith("model.systems.")]
    assert sorted(family.package.rsplit(".", 1)[1] for family in found) == sorted(beside)
    assert [family.place for family in found] == sorted(family.place for family in found)
    assert [family.name for family in found][:2] == ["planned", "globaldiff"]


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


def test_families_declare_only_systems_of_their_own():
    for family in families():
        declared = {name for names in family.usual.values() for name in names} | {*family.plans}
        declared |= set() if family.ladder is None else set(family.ladder.systems)
        declared |= {*family.about, *family.guidance, *family.own_samplers, *family.whole_speech}
        assert declared <= {*family.systems}
        assert {*family.about} == {*family.systems}
    assert planning_systems() and all(usual_systems(use) for use in get_args(Use))


def test_every_sampler_has_one_title_wherever_it_is():
    titles: dict[str, str] = {}
    for family in families():
        for sampler in (one for name in family.systems for one in family.samplers_of(name)):
            assert sampler.title and titles.setdefault(sampler.name, sampler.title) == sampler.title


def test_nothing_outside_the_families_knows_a_system_by_its_name():
    names = {name for family in families() for name in family.systems}
    roots = ("app", "model", "renderer", "tools", "processes", "conventions")
    paths = [path for root in roots for path in (ROOT / root).rglob("*.py")]
    others = [path for path in paths if path.parent.parent != ROOT / "model" / "systems"]
    assert len(others) > 300
    for path in others:
        strings = {node.value for node in ast.walk(ast.parse(path.read_text())) if _is_string(node)}
        assert not strings & names, path


def _is_string(node) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)
