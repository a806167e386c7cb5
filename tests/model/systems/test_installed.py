"""Families of other packages, found by what pip writes of them."""

from dataclasses import replace
from importlib.metadata import entry_points

import pytest
from frame_regression import FAMILY

from model.generation.family import FamilyError
from model.storage.cards import CheckpointError
from model.systems import registry
from model.systems.registry import GROUP, check_family, register_installed


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
    install(tmp_path, "e_good", "from frame_regression import FAMILY")
    monkeypatch.syspath_prepend(tmp_path)
    found = []
    sentences = register_installed(found.append)
    assert found == [FAMILY]
    told = {sentence.split("'")[1]: sentence for sentence in sentences}
    assert told["a_missing"] == (
        "The family 'a_missing' of the package a_missing (a_missing:FAMILY) is left out: "
        "ModuleNotFoundError: No module named 'nowhere_to_be_found'."
    )
    assert told["b_leaves"].endswith("SystemExit: no licence.")
    assert told["c_other"].endswith("is left out: it names a int, not a Family.")
    assert "has no attribute 'FAMILIES'" in told["d_unnamed"]
    assert len(sentences) == 4


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"systems": ("regression/mean", "../x")}, "the name '../x' must be small letters"),
        ({"about": {}}, "nothing is said about regression/mean"),
        ({"samplers": ()}, "regression/mean has no sampler"),
    ],
)
def test_what_cannot_be_shown_or_asked_is_left_out(changed, why):
    check_family(FAMILY)
    with pytest.raises(FamilyError, match=why):
        check_family(replace(FAMILY, **changed))


def test_weights_that_a_package_brings_must_have_a_card_with_speakers(tmp_path):
    family = replace(FAMILY, weights=tmp_path)
    (tmp_path / "regression-mean.safetensors").write_bytes(b"")
    with pytest.raises(CheckpointError, match=r"regression-mean\.json is missing"):
        check_family(family)
    (tmp_path / "regression-mean.json").write_text('{"sha256": ""}')
    with pytest.raises(FamilyError, match="the card of regression/mean names no speakers"):
        check_family(family)


def test_code_of_a_package_that_fails_when_it_is_read_is_told(tmp_path):
    (tmp_path / "regression-mean.safetensors").write_bytes(b"")
    registry.register(replace(FAMILY, package="frame_regression.nowhere"))
    try:
        with pytest.raises(FamilyError, match=r"the package frame_regression\.nowhere fails: Mod"):
            registry.load_system("regression/mean", tmp_path)
    finally:
        registry.unregister(FAMILY.name)


def test_none_is_installed_here():
    assert not entry_points(group=GROUP) and registry.left_out() == ()
