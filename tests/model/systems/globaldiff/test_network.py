"""The two-branch network, its configs, and what it predicts from another's speech."""

import json
from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from model.motion.packing import HAND_CHANNELS, NON_HAND_CHANNELS
from model.sampling.samplers import UnknownNameError
from model.storage.cards import from_dict, to_json
from model.systems.globaldiff.config import (
    ABLATION,
    GlobalDiffTrainConfig,
    NetworkConfig,
    presets,
)
from model.systems.globaldiff.system import MotionNetwork
from model.systems.registry import family_of
from model.training.loop import differing_fields
from tests.model.made import TINY_NETWORK, shaken


def inputs(size: int = 2, config: NetworkConfig = TINY_NETWORK) -> dict:
    generator = torch.Generator().manual_seed(0)
    frames, seed = config.window_frames, config.seed_frames
    heard = frames + 2 * config.speech_context
    return {
        "x_t": torch.randn(size, frames, 333, generator=generator),
        "t": torch.rand(size, generator=generator),
        "speech": torch.randn(size, heard, config.speech_dim, generator=generator),
        "expression": torch.rand(size, frames, config.expression_dim, generator=generator),
        "seed": torch.randn(size, seed, 333, generator=generator),
        "speaker": torch.ones(size, dtype=torch.long),
        "has_seed": torch.ones(size, dtype=torch.bool),
        "has_speech": torch.ones(size, dtype=torch.bool),
    }


@pytest.fixture
def network() -> MotionNetwork:
    torch.manual_seed(0)
    return shaken(MotionNetwork(TINY_NETWORK), by=0.1)


@pytest.mark.parametrize("changed", ["x_t", "t", "speech", "expression", "seed", "speaker"])
def test_every_condition_reaches_both_regions(network, changed):
    given = inputs()
    other = dict(given)
    other[changed] = given[changed] * 0 + 2 if changed == "speaker" else given[changed] + 0.3
    difference = (network(**given) - network(**other)).abs()
    assert difference[..., HAND_CHANNELS].max() > 1e-4
    assert difference[..., NON_HAND_CHANNELS].max() > 1e-4


def test_hidden_speech_and_seed_have_no_influence(network):
    given = inputs()
    for flag, hidden in (("has_speech", ("speech", "expression")), ("has_seed", ("seed",))):
        blind = {**given, flag: torch.zeros(2, dtype=torch.bool)}
        other = {**blind, **{name: given[name] + 1 for name in hidden}}
        torch.testing.assert_close(network(**blind), network(**other))
        assert (network(**blind) - network(**given)).abs().max() > 1e-4


def test_samples_of_a_batch_do_not_mix(network):
    given = inputs(3)
    alone = network(**{name: value[1:2] for name, value in given.items()})
    torch.testing.assert_close(network(**given)[1:2], alone, atol=1e-5, rtol=1e-5)


def test_config_survives_json_and_refuses_unknown_fields():
    config = presets("globaldiff/local")["smoke"]
    assert from_dict(GlobalDiffTrainConfig, json.loads(to_json(config))) == config
    with pytest.raises(ValueError, match="NetworkConfig has no field depth"):
        from_dict(NetworkConfig, {"depth": 3})
    with pytest.raises(ValueError, match="choose one of demo, paper, smoke"):
        family_of("globaldiff/local").config("huge", "globaldiff/local")
    with pytest.raises(UnknownNameError, match="globaldiff/local, globaldiff/global"):
        family_of("emage")
    with pytest.raises(ValueError, match="not a multiple"):
        replace(TINY_NETWORK, num_heads=3)


@pytest.mark.parametrize("size", ["demo", "paper"])
def test_each_rung_differs_from_the_one_before_in_one_thing(size):
    rungs = [json.loads(to_json(presets(name)[size])) for name in ABLATION]
    changes = [
        [name for name in differing_fields(a, b) if name != "system"] for a, b in pairwise(rungs)
    ]
    assert changes == [
        ["network.rotation_space"],
        ["loss.joint"],
        ["loss.skeleton"],
        ["loss.motion"],
    ]
    first, last = rungs[0]["loss"], rungs[-1]["loss"]
    assert first["joint"] == first["skeleton"] == first["motion"] == 0
    assert min(last[name] for name in ("simple", "position", "joint", "skeleton", "motion")) > 0
    assert first["simple"] > 0 and first["position"] > 0


@pytest.mark.parametrize("name", ABLATION)
def test_an_untrained_network_predicts_the_mean_or_a_pose_that_it_starts_at(name):
    config = presets(name)["smoke"].network
    network, pose = MotionNetwork(config), torch.randn(333)
    found = network(**inputs(config=config))
    assert (found == 0).all()
    network.initialise_output(pose)
    torch.testing.assert_close(network(**inputs(config=config)), pose.expand_as(found))
