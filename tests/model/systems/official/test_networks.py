"""The networks are the authors': the same names, shapes and numbers.

`carried.npz` is a slice of reference numbers of the official code (Apache-2.0; commit 9a1202df,
PyTorch 2.13, float32, weights by `filled`): what it gave at a few frames, and the few inputs that
do not follow from a seed.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from model.generation.base import SpeechWindow, Windowing, WindowSpec
from model.storage.cards import WeightsCard
from model.systems.official.checkpoints import OFFICIAL_NETWORKS
from model.systems.official.config import FAMILY, FILTERED
from model.systems.official.networks import make_network
from model.systems.official.speech import OfficialEncoder, windows_to_frames
from model.systems.official.system import OfficialSystem, seed_pose_of, smoothed
from tests.helpers import smooth_motion_example
from tests.model.systems.official.filled import fill, made, sha256_of

AT = [0, 1, 7, 8, 30, 59]
"""Frames of a window that are carried."""
ENDS = [0, 8, 51, 52, 59, 60, 111]
"""Frames of two joined windows that are carried: around the seed, the overlap and the end."""


@pytest.fixture(scope="module")
def carried() -> dict[str, np.ndarray]:
    with np.load(Path(__file__).with_name("carried.npz")) as archive:
        return {name: archive[name] for name in archive.files}


def normal(seed: int, *shape: int) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).standard_normal(shape).astype(np.float32))


def heard(seed: int) -> Tensor:
    """99 vectors of speech, as 60 frames."""
    vectors = normal(seed, 99, 1024).T[None]
    size = {"size": 60, "mode": "linear", "align_corners": True}
    return nn.functional.interpolate(vectors, **size)[0].T


@pytest.fixture(scope="module")
def networks() -> dict[str, nn.Module]:
    return {part: fill(make_network(part)) for part in OFFICIAL_NETWORKS}


@torch.inference_mode()
def test_one_pass_of_each_network(carried, networks):
    """The first of the reference's batch of two."""
    speech = normal(103, 2, 60, 1024)[:1]
    x_1 = networks["motion"](
        normal(101, 2, 60, 333)[:1],
        torch.tensor([0.25]),
        speech=speech,
        expression=normal(104, 2, 60, 100)[:1] / 2,
        seed=torch.from_numpy(carried["seed"]),
        speaker=torch.tensor([2]),
    )
    np.testing.assert_allclose(x_1[0, AT], carried["motion"], atol=1e-4)
    face = networks["expression"](speech, torch.tensor([0]))
    np.testing.assert_allclose(face[0, AT], carried["expression"], atol=1e-4)


@pytest.mark.parametrize("kind", ["filtered", "unfiltered"])
def test_two_windows(carried, networks, kind, monkeypatch):
    noise = torch.stack([normal(seed, 2, 60, 333)[:1] for seed in (4000, 4001)])
    monkeypatch.setattr(WindowSpec, "noise", lambda draw, shape: noise[draw.index])
    start = replace(
        smooth_motion_example(8), poses=carried["start_poses"], trans=carried["start_trans"]
    )
    system = OfficialSystem(
        name="official",
        card=WeightsCard({}, "given"),
        sha256s={},
        speakers={},
        encoder=OfficialEncoder(lambda windows: torch.zeros(len(windows), 60, 1024)),
        windowing=Windowing(60, 8, 0),
        samplers=FAMILY.samplers_of(FILTERED),
        rotation_frame="global",
        root_format="place",
        network=networks["motion"],
        expression_network=networks["expression"],
        initial_seed_pose=seed_pose_of(start),
        smooths_windows=kind == "filtered",
    )
    frames = windows_to_frames(torch.stack([heard(3000), heard(3001)]))
    draw = WindowSpec(2, 0, num_samples=1, index=0, sampler="reinterpolate", steps=5, guidance=1.0)
    first = system.window(SpeechWindow(frames[:60]), None, draw)
    second = system.window(SpeechWindow(frames[52:]), first, replace(draw, index=1))
    joined = system.join(first.part(slice(52, 60)), second)
    if kind == "filtered":
        np.testing.assert_allclose(first.vectors[0, -8:], carried["next_seed"], atol=1e-4)
    vectors, face = (
        torch.cat([getattr(first, name)[0, :52], getattr(joined, name)[0]])[ENDS]
        for name in ("vectors", "expression")
    )
    np.testing.assert_allclose(vectors[:, :330], carried[f"{kind}_rot6d"], atol=1e-4)
    np.testing.assert_allclose(vectors[:, 330:], carried[f"{kind}_trans"], atol=1e-4)
    np.testing.assert_allclose(face, carried["face"], atol=1e-4)


FILLED = {
    "motion": "5ec722cd8caa270e7918e6c90e50407ab154c8424352ffc1ef9285145aa81dfc",
    "expression": "97925f15533821560e3eecd965dd8d771df4a89754c4d4df302afd52098c15f6",
}
"""SHA-256 of the authors' networks filled by the rule: over all names and bytes, in their order."""


def test_the_filter_changes_only_the_middle():
    vectors = made("vectors", (2, 60, 7))
    changed = (smoothed(vectors) != vectors).any(-1).any(0)
    assert changed.nonzero().flatten().tolist() == list(range(8, 57))
    parabola = (torch.linspace(-1, 1, 60)[:, None] ** 2).expand(1, -1, 3)
    torch.testing.assert_close(smoothed(parabola), parabola, atol=1e-6, rtol=0)


@pytest.mark.parametrize("part", OFFICIAL_NETWORKS)
def test_names_shapes_and_filling_are_the_authors(networks, part):
    assert sha256_of(networks[part]) == FILLED[part]
