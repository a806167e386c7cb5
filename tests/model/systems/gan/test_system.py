"""The systems of one generator: steps, solvers, samples, streams and guidance."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from model.generation.base import SpeechWindow, WindowSpec
from model.generation.windows import GenerateOptions, generate_motion
from model.systems.gan.config import STEPS_BY_SYSTEM
from model.systems.gan.system import GanSystem
from model.systems.registry import list_systems, load_system
from tests.model.made import made_speech
from tests.model.systems.gan.made_generator import make_gan_weights

SPEECH = made_speech(32_000)


@pytest.fixture(scope="module")
def system(folder) -> GanSystem:
    found = load_system("gan/5", folder)
    assert isinstance(found, GanSystem)
    return found


@pytest.fixture(scope="module")
def folder(made_once):
    return made_once("gan", make_gan_weights)


def test_three_systems_move_with_one_network_in_their_own_numbers_of_steps(folder):
    assert list_systems(folder) == tuple(STEPS_BY_SYSTEM)
    loaded = [load_system(name, folder) for name in STEPS_BY_SYSTEM]
    assert [one.samplers[0].default_steps for one in loaded] == [20, 10, 5]
    assert all(one.sha256s == loaded[0].sha256s for one in loaded)
    moved = [generate_motion(one, SPEECH, GenerateOptions("ann"))[0].poses for one in loaded]
    assert len(moved[0]) == 60 and np.abs(np.diff(moved[0], axis=0)).mean() > 1e-4
    asked = generate_motion(loaded[0], SPEECH, GenerateOptions("ann", steps=5))[0].poses
    assert np.abs(moved[0] - moved[2]).max() > 0.01
    np.testing.assert_array_equal(asked, moved[2])


def test_ddim_follows_the_mean_instead_of_drawing(system, monkeypatch):
    asked = {name: GenerateOptions("ann", sampler=name, steps=3) for name in ("posterior", "ddim")}
    drawn, followed = (generate_motion(system, SPEECH, one)[0].poses for one in asked.values())
    assert np.isfinite(followed).all() and np.abs(drawn - followed).max() > 1e-3
    monkeypatch.setattr(type(system.network), "sample_x_0", None)
    again = generate_motion(system, SPEECH, asked["ddim"])
    np.testing.assert_array_equal(again[0].poses, followed)


def test_speech_can_be_heard_more_strongly_and_not_at_all(system):
    plain, louder, deaf = (
        generate_motion(system, SPEECH, GenerateOptions("ann", guidance=guidance))[0].poses
        for guidance in (1.0, 3.0, 0.0)
    )
    assert np.abs(louder - plain).max() > 1e-3 and np.abs(deaf - plain).max() > 1e-3


def test_noise_of_every_step_window_and_sample_is_its_own():
    draw = WindowSpec(1, seed=5, num_samples=2, index=0, sampler="posterior", steps=5, guidance=1.0)
    shape = 2, 60, 168
    drawn = [replace(draw, index=i).noise(shape, k) for i in (0, 1) for k in (1, 2)]
    numbers = torch.cat([*drawn, draw.noise((60, 168))[:, None]], dim=1).flatten(0, 1).flatten(1)
    assert (torch.corrcoef(numbers) - torch.eye(len(numbers))).abs().max() < 0.06
    for sample in range(2):  # one of many can be made alone
        alone = replace(draw, num_samples=1, first_sample=sample).noise(shape, 2)
        assert torch.equal(alone[0], drawn[1][sample])
    assert not torch.equal(replace(draw, seed=6).noise(shape, 2), drawn[1])


def test_a_window_goes_on_from_the_one_before(system):
    heard, context = torch.randn(200, 68), system.windowing.context
    draw = WindowSpec(1, seed=0, num_samples=4, index=0, sampler="posterior", steps=5, guidance=1.0)
    first = system.window(SpeechWindow.of(heard, 0, 60, context), None, draw)
    second = system.window(SpeechWindow.of(heard, 52, 60, context), first, replace(draw, index=1))
    apart = (second.rotmat[:, :8] - first.rotmat[:, -8:]).abs().mean()
    unlike = (second.rotmat[:, -8:] - first.rotmat[:, -8:]).abs().mean()
    assert apart < 0.3 * unlike
