import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from model.generation.base import Draw
from model.generation.stitching import SpeechStream
from model.generation.windows import GenerateOptions, generate_motion, stream_motion
from model.storage.cards import CheckpointError
from model.systems.gan.config import SOLVERS, STEP_COUNTS, SYSTEMS
from model.systems.gan.system import GanSystem
from model.systems.registry import list_systems, load_system
from tests.model.made import made_speech
from tests.model.systems.gan.made_generator import make_gan_weights

SPEECH = made_speech(16_000 * 5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_gan_weights(tmp_path_factory.mktemp("gan"))


@pytest.fixture(scope="module")
def system(folder) -> GanSystem:
    found = load_system("gan/5", folder)
    assert isinstance(found, GanSystem)
    return found


def test_three_systems_move_with_one_network_in_their_own_numbers_of_steps(folder):
    assert list_systems(folder) == tuple(SYSTEMS)
    loaded = [load_system(name, folder) for name in SYSTEMS]
    assert [one.samplers[0].steps for one in loaded] == [20, 10, 5]
    assert all(one.sha256s == loaded[0].sha256s for one in loaded)
    moved = [generate_motion(one, SPEECH, GenerateOptions("ann"))[0].poses for one in loaded]
    asked = generate_motion(loaded[0], SPEECH, GenerateOptions("ann", steps=5))[0].poses
    assert np.abs(moved[0] - moved[2]).max() > 0.01
    np.testing.assert_array_equal(asked, moved[2])


@pytest.mark.parametrize("steps", STEP_COUNTS)
def test_every_number_of_steps_of_the_paper_gives_motion(system, steps):
    (motion,) = generate_motion(system, SPEECH, GenerateOptions("ann", steps=steps))
    assert motion.num_frames == 150 and np.isfinite(motion.poses).all()
    assert np.abs(np.diff(motion.poses, axis=0)).mean() > 1e-4


def test_every_solver_follows_the_mean_instead_of_drawing(system, monkeypatch):
    made = {}
    for name in ("posterior", *SOLVERS):
        options = GenerateOptions("ann", sampler=name, steps=3)
        made[name] = generate_motion(system, SPEECH, options)[0].poses
        assert np.isfinite(made[name]).all()
    kinds = list(made.values())
    assert all(np.abs(a - b).max() > 1e-3 for a, b in itertools.combinations(kinds, 2))
    monkeypatch.setattr(type(system), "step_noise", None)
    again = generate_motion(system, SPEECH, GenerateOptions("ann", sampler="ddim", steps=3))
    np.testing.assert_array_equal(again[0].poses, made["ddim"])


def test_a_sample_does_not_depend_on_those_beside_it(system):
    options = GenerateOptions("ann", seed=3)
    (alone,) = generate_motion(system, SPEECH, options)
    beside = generate_motion(system, SPEECH, replace(options, samples=3))
    np.testing.assert_allclose(beside[0].poses, alone.poses, atol=1e-4)
    assert np.abs(beside[1].poses - alone.poses).max() > 0.01
    (again,) = generate_motion(system, SPEECH, options)
    np.testing.assert_array_equal(again.poses, alone.poses)
    (other,) = generate_motion(system, SPEECH, replace(options, seed=4))
    assert np.abs(other.poses - alone.poses).max() > 0.01


def test_noise_of_every_step_window_and_sample_is_its_own(system):
    draw = Draw(1, seed=5, samples=2, index=0, sampler="posterior", steps=5, guidance=1.0)
    drawn = [system.step_noise(replace(draw, index=i), k) for i in (0, 1) for k in (1, 2)]
    numbers = torch.cat([*drawn, draw.noise((60, 168))[:, None]], dim=1).flatten(0, 1).flatten(1)
    assert (torch.corrcoef(numbers) - torch.eye(len(numbers))).abs().max() < 0.06
    assert torch.equal(system.step_noise(replace(draw, samples=1), 2), drawn[1][:1])


def test_streamed_motion_equals_that_of_the_whole(system):
    options = GenerateOptions("ann", samples=2)
    whole = generate_motion(system, SPEECH, options)
    cut = system.windowing
    features = torch.from_numpy(system.encoder.encode(SPEECH.waveform, 164))
    pieces = list(stream_motion(system, features.split(7), options))
    assert cut.frames + 2 * cut.advance == 164 and len(pieces) > 2
    for sample in (0, 1):
        poses = np.concatenate([piece[sample].poses for piece in pieces])[:150]
        trans = np.concatenate([piece[sample].trans for piece in pieces])[:150]
        np.testing.assert_allclose(poses, whole[sample].poses, atol=1e-5)
        np.testing.assert_allclose(trans, whole[sample].trans, atol=1e-5)


def test_a_window_goes_on_from_the_one_before(system):
    speech = SpeechStream([torch.randn(200, 68)], system.windowing.context)
    draw = Draw(1, seed=0, samples=4, index=0, sampler="posterior", steps=5, guidance=1.0)
    first = system.window(speech.window(0, 60), None, draw)
    second = system.window(speech.window(52, 60), first, replace(draw, index=1))
    apart = (second.rotmat[:, :8] - first.rotmat[:, -8:]).abs().mean()
    unlike = (second.rotmat[:, -8:] - first.rotmat[:, -8:]).abs().mean()
    assert apart < 0.3 * unlike


def test_guidance_1_asks_once_and_others_a_batch_of_two(system):
    sizes = []
    forward = system.network.denoised

    def watched(x_t, *rest, **told):
        sizes.append(len(x_t))
        return forward(x_t, *rest, **told)

    system.network.denoised = watched
    try:
        plain, again, louder, deaf = (
            generate_motion(system, SPEECH, GenerateOptions("ann", guidance=guidance))[0].poses
            for guidance in (1.0, 1.0, 3.0, 0.0)
        )
    finally:
        del system.network.denoised
    count = len(sizes) // 4
    assert sizes == [1] * 2 * count + [2] * 2 * count
    np.testing.assert_array_equal(plain, again)
    assert np.abs(louder - plain).max() > 1e-3 and np.abs(deaf - plain).max() > 1e-3


def test_a_card_that_misstates_the_generator_is_told(folder, tmp_path):
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    card = tmp_path / "gan-20.json"
    card.write_text(card.read_text().replace('"generator"', '"other"'))
    with pytest.raises(CheckpointError, match="The card of gan/20 lacks or misstates 'generator'"):
        load_system("gan/10", tmp_path)
