"""Settings told as text change one field, and nothing that is not there."""

from dataclasses import replace

import pytest

from model.storage.cards import with_setting
from model.systems.asynfusion.config import named_config
from model.systems.registry import families


def test_a_field_is_changed_and_nothing_besides() -> None:
    config = named_config("small", "asynfusion/ddim")
    gated = with_setting(config, "network.interaction=gated")
    assert gated == replace(config, network=replace(config.network, interaction="gated"))
    assert with_setting(config, "loss.velocity=3") == replace(
        config, loss=replace(config.loss, velocity=3.0)
    )


@pytest.mark.parametrize(
    ("family", "preset"),
    [(f, preset) for f in families() for preset in f.presets],
    ids=lambda each: getattr(each, "name", each),
)
def test_every_config_can_be_set(family, preset: str) -> None:
    for system in family.trained:
        try:
            config = family.config(preset, system)
        except ValueError:  # not every system of a family has every preset
            continue
        assert with_setting(config, "random_seed=3") == replace(config, random_seed=3)


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ("network.interaction", "sets nothing"),
        ("network.depth=2", "no field network.depth"),
        ("steps.many=2", "no field steps.many"),
        ("steps=many", "another kind"),
        ("network.interaction=2", "another kind"),
        ("network.width=65", "width 65 is no multiple"),
    ],
)
def test_what_is_wrong_with_a_setting_is_said(setting: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        with_setting(named_config("small", "asynfusion/ddim"), setting)
