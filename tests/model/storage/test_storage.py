"""Weights and their cards, settings told as text, and errors of writing."""

import errno
import json
import os
import pickle
from dataclasses import replace

import pytest
import torch

from model.networks.config import MatchingConfig
from model.storage.cards import CheckpointError, WeightsCard, load_card, override_setting
from model.storage.checkpoint import load_module, load_weights, save_weights
from model.storage.files import WriteError, parse_toml, written_atomically
from model.systems.asynfusion.config import presets
from model.systems.registry import families


def test_weights_come_back_as_fp16_rounds_them(tmp_path):
    tensors = {"network.a": torch.randn(3, 4), "normaliser.mean": torch.randn(5) * 1e-5}
    save_weights(tmp_path, "globaldiff/global", tensors, {"steps": 3})
    back, card = load_weights(tmp_path, "globaldiff/global")
    assert card["system"] == "globaldiff/global" and card["steps"] == 3
    torch.testing.assert_close(back["network.a"], tensors["network.a"].half().float())
    torch.testing.assert_close(back["normaliser.mean"], tensors["normaliser.mean"])
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["globaldiff-global.json", "globaldiff-global.safetensors"]


@pytest.mark.parametrize(
    ("saved", "said"),
    [
        ({"weight": (2, 3)}, r"bias is missing\."),
        ({"weight": (3, 2), "bias": (2,)}, r"weight has the shape \[3, 2\] instead of \[2, 3\]\."),
        ({"bias": (2,), "more": (1,)}, r"weight is missing \(1 more differ\)\."),
        ({"weight": (2, 3), "bias": (2,), "more": (1,)}, r"more is not part of the network\."),
    ],
)
def test_weights_that_do_not_fit_are_told_by_the_first_that_differs(saved, said):
    tensors = {f"network.{name}": torch.zeros(shape) for name, shape in saved.items()}
    with pytest.raises(
        CheckpointError, match="of toy do not match the network in their model card: " + said
    ):
        load_module(torch.nn.Linear(3, 2), tensors, "network.", "toy")


def test_what_a_card_lacks_or_misstates_is_told_with_the_weights_name():
    card = WeightsCard(
        {"config": {"network": {"hidden": 8}}, "speakers": ["hana"]}, "globaldiff/local"
    )
    for read, what in (
        (lambda: card.sha256, "'sha256'"),
        (lambda: card.encoder, "'encoder'"),
        (lambda: card.speakers, "'list' object has no attribute 'items'"),
        (lambda: card.config(MatchingConfig, "matching"), "'matching'"),
        (lambda: card.config(MatchingConfig, "network"), "MatchingConfig has no field hidden"),
    ):
        with pytest.raises(CheckpointError, match=r"card .* of globaldiff/local has a") as caught:
            read()
        assert what in str(caught.value)
    assert (card.training_data_hours, card.training_steps, card.origin_note) == (0.0, None, None)
    told = WeightsCard({"speakers": {"hana": 3}, "training_hours": 2.5, "steps": 9}, "gan/5")
    assert (told.speakers, told.training_data_hours, told.training_steps) == ({"hana": 3}, 2.5, 9)


def test_a_setting_changes_one_field_of_any_config_and_nothing_besides():
    config = presets("asynfusion/ddim")["demo"]
    faster = override_setting(config, "loss.velocity=3")
    assert faster == replace(config, loss=replace(config.loss, velocity=3.0))
    trained = [(family, system) for family in families() for system in family.trainable_networks]
    found = [config for family, name in trained for config in family.presets(name).values()]
    assert len(found) > 10
    for config in found:
        assert override_setting(config, "random_seed=3") == replace(config, random_seed=3)


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ("network.width", "is not a setting"),
        ("network.depth=2", "no field network.depth"),
        ("steps.many=2", "no field steps.many"),
        ("steps=many", "must have the type of"),
        ("aim=2", "must have the type of"),
        ("aim=data", "use noise or teacher"),
        ("network.width=65", "width 65 is not a multiple"),
    ],
)
def test_what_is_wrong_with_a_setting_is_said(setting, says):
    with pytest.raises(ValueError, match=says):
        override_setting(presets("asynfusion/ddim")["demo"], setting)


def test_a_write_error_is_one_sentence_and_knows_its_cause_in_another_process_too(tmp_path):
    with pytest.raises(WriteError) as caught, written_atomically(tmp_path / "a.npz"):
        raise OSError(errno.ENOSPC, "No space left on device")
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert isinstance(error, WriteError) and error.errno == errno.ENOSPC
        assert str(error) == (
            f"{tmp_path / 'a.npz'} could not be written: the disk is full; free some space or "
            "choose another folder."
        )


def test_a_stranger_s_folder_of_weights_is_told_of_whatever_lies_in_it(tmp_path):
    card, weights = tmp_path / "a.json", tmp_path / "a.safetensors"
    for content in ("[" * 10**5, '{"sha256": ' + "[" * 10**5, "\0"):
        card.write_text(content)
        with pytest.raises(CheckpointError, match="cannot be read"):
            load_card(tmp_path, "a")
    told = {"sha256": "", "speakers": {"ann": "x", "bea": 1e999}, "training_hours": "many"}
    card.write_text(json.dumps(told))
    for name in ("speakers", "training_data_hours"):
        with pytest.raises(CheckpointError, match="has a missing or wrong entry"):
            getattr(load_card(tmp_path, "a"), name)
    os.mkfifo(weights)
    with pytest.raises(CheckpointError, match="not a regular file"):
        load_weights(tmp_path, "a")
    for make in (os.mkfifo, lambda path: os.symlink("/dev/zero", path)):
        card.unlink()
        make(card)
        with pytest.raises(CheckpointError, match="not a regular file"):
            load_card(tmp_path, "a")


@pytest.mark.parametrize(
    "before", ["", 'x = "\\""\n', "x = '\\'\n", 'x = """a"""""\n', "# '\n[t]\n"]
)
@pytest.mark.parametrize("part", ["a", "'a b'", '"\\""', "''", "a \t", "a_-1"])
def test_long_keys_are_refused_however_they_are_spelled(before, part):
    for statement in ("{} = 1", "[{}]", "[[{}]]", 'y = {{z = "\'", {} = 1}}'):
        parse_toml(before + statement.format(".".join([part] * 32)))
        with pytest.raises(ValueError, match="a key has more than 32 parts"):
            parse_toml(before + statement.format(".".join([part] * 33)))


def test_dots_in_strings_and_comments_are_no_keys():
    dots = "a." * 100
    text = f'x = \'{dots}\'\ny = """\n"{dots}"""" # {dots}\nz = "{dots}"'
    assert parse_toml(text) == {"x": dots, "y": f'"{dots}"', "z": dots}


def test_documents_nested_too_deeply_are_refused_in_linear_time():
    deep = "x = " + ("{" + "a." * 20 + "a = ") * 200 + "1" + "}" * 200
    with pytest.raises(ValueError, match="nested too deeply"):
        parse_toml(deep)
    for text in (
        '\\"' * 10**6,
        "'" * 10**6,
        "a" * 10**6,
        '"""' * 10**6,
        ("a ." * 31 + "\n") * 10**4,
    ):
        with pytest.raises(ValueError, match=r"line 1|end of"):
            parse_toml(f"x = {text}")
