"""Three systems of two files: as they are asked, streamed and guided."""

from typing import Any

import numpy as np
import pytest

from model.generation.windows import GenerateOptions, generate_motion
from model.sampling.samplers import DEFAULT_SAMPLING
from model.systems.asynfusion import system as module
from model.systems.asynfusion.network import Pair
from model.systems.registry import list_systems, load_system
from tests.model.made import made_speech
from tests.model.systems.asynfusion.made import make_asynfusion

SPEECH = made_speech(40_000)


def moved(system, **options):
    return generate_motion(system, SPEECH, GenerateOptions(speaker="ann", **options))


@pytest.fixture(scope="module")
def folder(made_once):
    return made_once("asynfusion", make_asynfusion)


def test_three_systems_move_by_two_files(folder):
    assert list_systems(folder) == (
        "asynfusion/ddim",
        "asynfusion/lcm-sync",
        "asynfusion/lcm-async",
    )
    ddim, sync, apart = (load_system(name, folder) for name in list_systems(folder))
    assert sync.sha256s == apart.sha256s != ddim.sha256s
    assert [s.samplers[0].default_steps for s in (ddim, sync, apart)] == [25, 8, 8]
    assert sync.network.consistent and not ddim.network.consistent


def test_the_face_is_its_own_and_lives(folder):
    system = load_system("asynfusion/lcm-async", folder)
    one, two = moved(system, num_samples=2, steps=4)
    assert one.num_frames == SPEECH.num_motion_frames == len(one.expressions)
    units = one.expressions[:, :52]
    assert (units >= 0).all() and (units <= 1).all() and units.std(0).max() > 1e-3
    assert not one.expressions[:, 52:].any()
    assert np.abs(one.expressions - two.expressions).max() > 1e-3
    again = moved(system, steps=4)[0]
    np.testing.assert_allclose(again.expressions, one.expressions, atol=1e-4)
    np.testing.assert_allclose(again.poses, one.poses, atol=1e-3)


def test_the_systems_of_one_network_differ_by_the_steps_of_the_face_alone(folder, monkeypatch):
    sync, apart = (load_system(f"asynfusion/lcm-{kind}", folder) for kind in ("sync", "async"))
    assert np.abs(moved(apart)[0].poses - moved(sync)[0].poses).max() > 1e-5
    counts, real = [], module.sample

    def sample(*args: Any, **told: Any) -> Pair:
        counts.append(args[3])
        return real(*args, **told)

    monkeypatch.setattr(module, "sample", sample)
    for system, steps in ((sync, 8), (apart, 8), (apart, 5), (apart, 1)):
        moved(system, steps=steps)
    assert list(dict.fromkeys(counts)) == [(8, 8), (4, 8), (2, 5), (1, 1)]


def test_what_it_cannot_do_is_said(folder, tmp_path):
    ddim = load_system("asynfusion/ddim", folder)
    with pytest.raises(ValueError, match="asynfusion/ddim has no sampler 'lcm'"):
        moved(ddim, sampler="lcm")
    assert ddim.resolve_sampling(DEFAULT_SAMPLING).guidance == ddim.guidance == 2.5
    always_heard = load_system("asynfusion/ddim", make_asynfusion(tmp_path, speech_dropout=0.0))
    assert always_heard.guidance is None
    moved(always_heard, guidance=1.0, steps=1)
    with pytest.raises(ValueError, match="does not support guidance"):
        moved(always_heard, guidance=2.0)
