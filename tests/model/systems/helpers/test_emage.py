"""EMAGE's encoder against a slow version of it, and its file's keys."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from model.storage.cards import CheckpointError
from model.systems.helpers.emage import CODE_DIM, emage_codes, load_emage_encoder
from tests.helpers import smooth_motion_example
from tests.model.systems.helpers.made_emage import emage_tensors

TENSORS = emage_tensors(3)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "AESKConv_240_100.bin"
    torch.save({"model_state": {f"module.{key}": each for key, each in TENSORS.items()}}, path)
    return path


def slow_conv(frames: np.ndarray, weight: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Every second frame, as far as the weights reach beside zeros."""
    width = weight.shape[2]
    padded = np.pad(frames, (((width - 1) // 2,) * 2, (0, 0)))
    return np.array(
        [
            bias + sum(weight[:, :, tap] @ padded[2 * k + tap] for tap in range(width))
            for k in range(len(frames) // 2)
        ]
    )


def slow_codes(frames: np.ndarray) -> np.ndarray:
    for place in range(4):
        start = f"encoder.layers.{place}.0."
        kept = {key.removeprefix(start): each.double().numpy() for key, each in TENSORS.items()}
        wide, narrow = (
            slow_conv(frames, kept[f"{part}weight"] * kept[f"{part}mask"], kept[f"{part}bias"])
            for part in ("residual.0.", "shortcut.")
        )
        groups = wide.reshape(len(wide), 10, -1)  # of channels, over all frames
        spread = np.sqrt(groups.var((0, 2), keepdims=True) + 1e-5)
        normed = ((groups - groups.mean((0, 2), keepdims=True)) / spread).reshape(wide.shape)
        frames = narrow + normed * kept["residual.1.weight"] + kept["residual.1.bias"]
        pool = kept.get("common.0.weight")
        frames = np.tanh(frames if pool is None else frames @ pool.T)
    return frames


def test_codes_are_those_of_a_slow_version(path):
    motion = smooth_motion_example(70, 5)
    found = emage_codes(load_emage_encoder(path), motion)
    assert found.shape == (64 // 16, CODE_DIM)
    rotvec = motion.poses[:64].reshape(-1, 3).astype(float)
    wanted = slow_codes(Rotation.from_rotvec(rotvec).as_matrix()[:, :2, :].reshape(64, 55 * 6))
    assert found == pytest.approx(wanted, abs=2e-5)
    assert np.abs(wanted).mean() > 0.1  # and not all near 0, where everything is equal


def test_a_clip_too_short_has_no_codes(path):
    encoder = load_emage_encoder(path)
    assert emage_codes(encoder, smooth_motion_example(31, 0)).shape == (0, CODE_DIM)
    longer = smooth_motion_example(63, 0)
    assert emage_codes(encoder, longer).shape == (2, CODE_DIM)


def test_a_file_that_does_not_fit_is_told_by_its_first_key(path):
    key = "encoder.layers.1.0.residual.0.mask"
    torch.save({name: each for name, each in TENSORS.items() if name != key}, path)
    told = f"AESKConv_240_100.bin is not EMAGE's encoder: {key} is missing; give AESKConv"
    with pytest.raises(CheckpointError, match=told):
        load_emage_encoder(path)
