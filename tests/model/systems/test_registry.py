"""Systems by name and folder, and families, also those of other packages."""

import ast
import json
import shutil
from dataclasses import replace
from typing import get_args

import pytest
from frame_regression.config import FAMILY

from model.generation.family import FamilyUnavailableError, Topic
from model.sampling.samplers import UnknownNameError
from model.storage.cards import CheckpointError, load_card
from model.systems import registry
from model.systems.registry import (
    GROUP,
    check_family,
    families,
    list_systems,
    load_system,
    planning_systems,
    register_installed_reporting_failures,
    representatives,
    shared_speakers,
)
from tests.helpers import ROOT


@pytest.fixture
def folder(weights, tmp_path):
    return shutil.copytree(weights, tmp_path / "weights")


def test_families_are_those_of_the_folders_in_the_order_of_their_places():
    beside = [each.parent.name for each in (ROOT / "model" / "systems").glob("*/__init__.py")]
    found = [family for family in families() if family.package.startswith("model.systems.")]
    assert sorted(family.package.rsplit(".", 1)[1] for family in found) == sorted(beside)
    assert [family.display_order for family in found] == sorted(
        family.display_order for family in found
    )
    assert [family.name for family in found][:2] == ["planned", "globaldiff"]


def test_card_of_another_shape_is_refused(folder):
    path = folder / "globaldiff-local.json"
    card = json.loads(path.read_text())
    card["config"]["network"]["num_blocks"] = 2
    path.write_text(json.dumps(card))
    with pytest.raises(CheckpointError, match="do not match"):
        load_system("globaldiff/local", folder)
    del card["speakers"]
    path.write_text(json.dumps(card))
    with pytest.raises(CheckpointError, match="speakers"):
        load_system("globaldiff/local", folder)


def test_families_declare_only_systems_of_their_own():
    for family in families():
        declared = {name for names in family.representatives.values() for name in names} | {
            *family.planning_systems
        }
        declared |= set() if family.ablation is None else set(family.ablation.explained_systems)
        declared |= {
            *family.descriptions,
            *family.samplers,
            *family.offline_only,
            *family.planning_systems,
        }
        assert declared <= {*family.systems}
        assert {*family.descriptions} == {*family.systems}
    assert planning_systems() and all(representatives(topic) for topic in get_args(Topic))


def test_nothing_outside_the_families_knows_a_system_by_its_name():
    names = {name for family in families() for name in family.systems}
    roots = ("app", "model", "renderer", "tools", "processes", "conventions")
    paths = [path for root in roots for path in (ROOT / root).rglob("*.py")]
    others = [path for path in paths if path.parent.parent != ROOT / "model" / "systems"]
    assert len(others) > 200
    others.remove(ROOT / "conventions" / "colors.py")  # the one table of colours, apart by design
    for path in others:
        if not any(name in path.read_text() for name in names):
            continue
        strings = {node.value for node in ast.walk(ast.parse(path.read_text())) if _is_string(node)}
        assert not strings & names, path


def _is_string(node) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def install(folder, name: str, code: str, entry: str = "FAMILY") -> None:
    """A package of one module, as pip leaves it."""
    (folder / f"{name}.py").write_text(code)
    told = folder / f"{name}-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text(f"[{GROUP}]\n{name} = {name}:{entry}\n")


def test_a_broken_package_is_told_in_a_sentence_and_keeps_none_from_the_others(
    tmp_path, monkeypatch
):
    install(tmp_path, "a_missing", "import nowhere_to_be_found")
    install(tmp_path, "b_leaves", "raise SystemExit('no licence')")
    install(tmp_path, "c_other", "FAMILY = 3")
    install(tmp_path, "d_unnamed", "", entry="FAMILIES")
    install(tmp_path, "e_good", "from frame_regression.config import FAMILY")
    monkeypatch.syspath_prepend(tmp_path)
    found = []
    sentences = register_installed_reporting_failures(found.append)
    assert found == [FAMILY]
    told = {sentence.split("'")[1]: sentence for sentence in sentences}
    assert told["a_missing"] == (
        "The system family 'a_missing' of the package a_missing (a_missing:FAMILY) is left out: "
        "ModuleNotFoundError: No module named 'nowhere_to_be_found'."
    )
    assert told["b_leaves"].endswith("SystemExit: no licence.")
    assert told["c_other"].endswith("is left out: its entry point is a int, not a Family.")
    assert "has no attribute 'FAMILIES'" in told["d_unnamed"]
    assert len(sentences) == 4


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (
            {"systems": ("regression/mean", "../x")},
            "the name '../x' must consist of lower-case letters",
        ),
        ({"descriptions": {}}, "it has no description of regression/mean"),
        ({"samplers": {}}, "regression/mean has no sampler"),
    ],
)
def test_what_cannot_be_shown_or_asked_is_left_out(changed, why):
    check_family(FAMILY)
    with pytest.raises(FamilyUnavailableError, match=why):
        check_family(replace(FAMILY, **changed))


def test_weights_that_a_package_brings_must_have_a_card_with_speakers(tmp_path):
    family = replace(FAMILY, shipped_weights_folder=tmp_path)
    (tmp_path / "regression-mean.safetensors").write_bytes(b"")
    with pytest.raises(CheckpointError, match=r"regression-mean\.json is missing"):
        check_family(family)
    (tmp_path / "regression-mean.json").write_text('{"sha256": ""}')
    with pytest.raises(
        FamilyUnavailableError, match="the model card of regression/mean lists no speakers"
    ):
        check_family(family)


def test_code_of_a_package_that_fails_when_it_is_read_is_told(tmp_path, monkeypatch):
    (tmp_path / "regression-mean.safetensors").write_bytes(b"")
    monkeypatch.setattr(registry, "_FAMILIES", list(registry.families()))
    registry.register(replace(FAMILY, package="frame_regression.nowhere"))
    with pytest.raises(
        FamilyUnavailableError, match=r"the code of frame_regression\.nowhere failed: Mod"
    ):
        registry.load_system("regression/mean", tmp_path)


def test_a_folder_is_listed_without_loading_and_its_systems_know_their_speakers(weights):
    assert list_systems(weights) == ("globaldiff/local", "globaldiff/global")
    assert shared_speakers(weights) == ("ann", "bob")
    assert list_systems(weights / "nowhere") == () == shared_speakers(weights / "nowhere")
    system = load_system("globaldiff/local", weights)
    assert system.config.rotation_space == "local" and system.speaker_index("bob") == 2
    with pytest.raises(UnknownNameError, match="no speaker 'eve'; choose one of ann, bob"):
        system.speaker_index("eve")
    with pytest.raises(UnknownNameError, match="globaldiff/local, globaldiff/global"):
        load_system("globaldiff/huge", weights)


def test_changed_weights_and_damaged_cards_are_refused(folder):
    path = folder / "globaldiff-local.safetensors"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(CheckpointError, match="sha256"):
        load_system("globaldiff/local", folder)
    for damaged in ("{", "[]", "{}"):
        (folder / "expression.json").write_text(damaged)
        with pytest.raises(CheckpointError):
            load_card(folder, "expression")
    (folder / "expression.json").unlink()
    with pytest.raises(CheckpointError, match="is missing"):
        load_system("globaldiff/global", folder)
