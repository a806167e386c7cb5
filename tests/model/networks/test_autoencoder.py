"""The motion autoencoder: its scales, what it sees, and its bundled weights."""

from dataclasses import replace

import pytest
import torch

from model.networks.autoencoder import MotionAutoencoder, autoencoder_input
from model.networks.config import AutoencoderConfig
from model.systems.helpers.config import presets
from tests.model.made import shaken

TINY = AutoencoderConfig(width=8, blocks_per_scale=1, latent_dim=4)


def made_network(config: AutoencoderConfig) -> MotionAutoencoder:
    return shaken(MotionAutoencoder(config), by=0.1)


def test_codes_lie_at_their_scales_and_decode_to_every_frame():
    network = made_network(replace(TINY, scales=(2, 8)))
    restored, codes = network(torch.randn(3, 64, 333), None, None)
    assert [mean.shape for mean, _ in codes] == [(3, 32, 4), (3, 8, 4)]
    assert restored.shape == (3, 64, 333)
    coarse, fine = ([c + (k == i) for k, (c, _) in enumerate(codes)] for i in (0, 1))
    for changed in (coarse, fine):  # both scales reach the motion
        assert (network.decode(changed) - restored).abs().max() > 1e-3


def test_codes_of_a_frame_do_not_depend_on_batch_or_distant_frames():
    network = made_network(TINY)
    motion = torch.randn(4, 240, 333)
    whole = network.encode(motion)[-1][0]
    alone = network.encode(motion[1:2, :120])[-1][0]
    torch.testing.assert_close(whole[1:2, :20], alone[:, :20], atol=1e-5, rtol=1e-4)


def test_hidden_frames_do_not_reach_the_codes():
    network = made_network(TINY)
    motion, hidden = torch.randn(2, 60, 333), torch.zeros(2, 60, dtype=torch.bool)
    hidden[:, 20:40] = True
    other = motion.clone()
    other[:, 20:40] += 1.0
    for (a, _), (b, _) in zip(
        network.encode(motion, hidden), network.encode(other, hidden), strict=True
    ):
        torch.testing.assert_close(a, b)
    assert (network.encode(motion)[0][0] - network.encode(other)[0][0]).abs().max() > 1e-3


def test_noise_is_scaled_by_the_codes_own_spread():
    network = made_network(TINY)
    motion = torch.randn(2, 60, 333)
    codes = network.encode(motion)
    noise = [torch.ones_like(mean) for mean, _ in codes]
    expected = network.decode([mean + (log_var / 2).exp() for mean, log_var in codes])
    torch.testing.assert_close(network(motion, None, noise)[0], expected)


@pytest.mark.parametrize(
    ("system", "body", "face"),
    [("motion-vae", 333, 0), ("fgd-encoder", 333, 0), ("fmd-encoder", 333, 52),
     ("fed-encoder", 0, 52)],
)  # fmt: skip
def test_what_each_network_sees(system, body, face):
    shape = presets(system)["smoke"].autoencoder
    assert (shape.motion_channels, shape.face_channels) == (body, face)
    motion = 0.3 * torch.randn(1, 16, 165), torch.randn(1, 16, 3), torch.rand(1, 16, 52)
    seen = autoencoder_input(shape, *motion)
    other_body = autoencoder_input(shape, motion[0] + 0.1, motion[1], motion[2])
    other_face = autoencoder_input(shape, motion[0], motion[1], motion[2] + 0.1)
    assert seen.shape == (1, 16, body + face)
    assert (other_body != seen).any() == (body > 0)
    changed = (other_face != seen).any(dim=(0, 1))
    assert changed.tolist() == [False] * body + [True] * face
    restored, _ = made_network(shape)(seen, None, None)
    assert restored.shape == seen.shape
