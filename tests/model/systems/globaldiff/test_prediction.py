from dataclasses import replace

import numpy as np
import pytest
import torch

from conventions.joints import NUM_JOINTS
from model.motion.motion import Motion
from model.systems.globaldiff.config import NetworkConfig
from model.systems.globaldiff.network import MotionNetwork
from model.systems.globaldiff.system import load
from tests.helpers import smooth_motion_example
from tests.model.made import TINY_NETWORK, make_weights

FRAMES, SHIFT = 240, 120


class Listener(MotionNetwork):
    """A network that hears which frame of the recording it is, and nothing else."""

    def __init__(self, config: NetworkConfig, frames: torch.Tensor) -> None:
        super().__init__(config)
        self.frames = frames

    def forward(self, x_t, t, *, speech, **_):
        return self.frames[speech[..., 0].long()]


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    local = replace(TINY_NETWORK, rotation_space="local")
    return load(
        "globaldiff/local",
        make_weights(tmp_path_factory.mktemp("weights"), {"globaldiff/local": local}),
    )


def recorded_frames(system, motion: Motion) -> torch.Tensor:
    """Normalised motion vectors, written out: row-6D, then (velocity x, height, velocity z)."""
    rows = motion.local_rotations()[..., :2, :].reshape(FRAMES, NUM_JOINTS * 6)
    steps = np.diff(motion.trans, axis=0)[:, [0, 2]] * 30
    steps = np.concatenate([steps[:1], steps])
    root = np.stack([steps[:, 0], motion.trans[:, 1], steps[:, 1]], axis=1)
    return system.normaliser.normalise(torch.cat([rows, torch.from_numpy(root)], dim=1)).float()


def test_a_network_that_listens_is_right_with_its_own_speech_alone(system):
    motion = smooth_motion_example(FRAMES)
    frames = recorded_frames(system, motion)
    listening = replace(system, network=Listener(system.config, frames))
    count = np.zeros((FRAMES, 68), np.float32)
    count[:, 0] = np.arange(FRAMES)
    tracks = {"right": count, "shifted": np.roll(count, SHIFT, axis=0), "foreign": 0 * count}
    found = listening.predict_with(motion, tracks, 1, batch_size=3)
    assert found.errors["right"] == pytest.approx(0, abs=1e-8)
    assert max(found.position_error_by_depth_m) < 1e-5
    wanted = (torch.roll(frames, SHIFT, 0) - frames).square().mean()
    assert found.errors["shifted"] == pytest.approx(float(wanted), rel=1e-4)
    still = (frames[:1] - frames).square().mean()
    assert found.errors["foreign"] == pytest.approx(float(still), rel=1e-4)
