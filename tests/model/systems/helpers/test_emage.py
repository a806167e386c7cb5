"""EMAGE's encoder against a slow version that walks over bones, and its file's keys."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from model.storage.cards import CheckpointError
from model.systems.helpers.emage import CODE_DIM, emage_codes, load_emage_encoder
from tests.helpers import smooth_motion_example
from tests.model.systems.helpers.made_emage import Chains, distances, emage_tensors, levels

WITHIN = 2


@pytest.fixture(scope="module")
def tensors() -> dict[str, torch.Tensor]:
    return emage_tensors(3)


@pytest.fixture
def path(tensors: dict[str, torch.Tensor], tmp_path: Path) -> Path:
    torch.save(
        {"model_state": {f"module.{key}": each for key, each in tensors.items()}},
        tmp_path / "AESKConv_240_100.bin",
    )
    return tmp_path / "AESKConv_240_100.bin"


def test_codes_are_those_of_a_walk_over_bones(path, tensors):
    motion = smooth_motion_example(70, 5)
    found = emage_codes(load_emage_encoder(path), motion)
    assert found.shape == (64 // 16, CODE_DIM)
    rotvec = motion.poses[:64].reshape(-1, 3).astype(float)
    rows = Rotation.from_rotvec(rotvec).as_matrix()[:, :2, :].reshape(64, 55 * 6)
    wanted = _slow_codes(rows, {key: each.double().numpy() for key, each in tensors.items()})
    assert found == pytest.approx(wanted, abs=2e-5)
    assert np.abs(wanted).mean() > 0.1  # and not all near 0, where everything is equal


def test_a_clip_too_short_has_no_codes(path):
    encoder = load_emage_encoder(path)
    assert emage_codes(encoder, smooth_motion_example(31, 0)).shape == (0, CODE_DIM)
    longer = smooth_motion_example(63, 0)
    assert emage_codes(encoder, longer).shape == (2, CODE_DIM)


def test_a_file_that_does_not_fit_is_told_by_its_first_key(path, tensors):
    key = "encoder.layers.1.0.residual.0.mask"
    without = {name: each for name, each in tensors.items() if name != key}
    told = {
        f"AESKConv_240_100.bin is not EMAGE's encoder: {key} is missing; give AESKConv": without,
        rf"{key} is of shape \[2\] in place of \[210, 210, 4\]": tensors | {key: torch.zeros(2)},
        "extra.weight is not known": tensors | {"extra.weight": torch.zeros(2)},
        "not finite .* in encoder.layers.3.0.shortcut.bias first": tensors
        | {"encoder.layers.3.0.shortcut.bias": torch.full((240,), torch.nan)},
    }
    for sentence, content in told.items():
        torch.save({"model_state": content}, path)
        with pytest.raises(CheckpointError, match=sentence):
            load_emage_encoder(path)


def _slow_codes(rows: np.ndarray, tensors: dict[str, np.ndarray]) -> np.ndarray:
    """Each number of each bone by itself, from its neighbours' alone."""
    bones, pools = levels()
    frames = rows
    for place, edges in enumerate(bones):
        kept = {name: tensors[f"encoder.layers.{place}.0.{name}"] for name in _NAMES}
        apart = distances(edges)
        wide = _slow_conv(frames, kept["residual.0.weight"], kept["residual.0.bias"], apart, 1)
        narrow = _slow_conv(frames, kept["shortcut.weight"], kept["shortcut.bias"], apart, 0)
        normed = np.zeros_like(wide)
        size = wide.shape[1] // 10
        for group in range(10):
            part = wide[:, group * size : (group + 1) * size]
            scaled = (part - part.mean()) / np.sqrt(part.var() + 1e-5)
            normed[:, group * size : (group + 1) * size] = scaled
        normed = normed * kept["residual.1.weight"] + kept["residual.1.bias"]
        frames = np.tanh(_slow_pool(normed + narrow, pools[place], len(edges)))
    return frames


_NAMES = (
    *("residual.0.weight", "residual.0.bias", "residual.1.weight", "residual.1.bias"),
    *("shortcut.weight", "shortcut.bias"),
)


def _slow_conv(
    frames: np.ndarray, weight: np.ndarray, bias: np.ndarray, apart: list[list[int]], before: int
) -> np.ndarray:
    into, out = frames.shape[1] // len(apart), len(bias) // len(apart)
    told = np.zeros((len(frames) // 2, len(bias)))
    for bone, steps in enumerate(apart):
        near = [other for other in range(len(apart)) if steps[other] <= WITHIN]
        channels = [into * other + i for other in near for i in range(into)]
        for frame in range(len(told)):
            for channel in range(out * bone, out * (bone + 1)):
                told[frame, channel] = bias[channel]
                for tap in range(weight.shape[2]):
                    at = 2 * frame + tap - before
                    if 0 <= at < len(frames):
                        told[frame, channel] += (
                            weight[channel, channels, tap] @ frames[at, channels]
                        )
    return told


def _slow_pool(frames: np.ndarray, chains: Chains, bones: int) -> np.ndarray:
    by_bone = frames.reshape(len(frames), bones, -1)
    return np.concatenate([by_bone[:, chain].mean(1) for chain in chains], axis=1)
