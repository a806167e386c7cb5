"""The networks are the authors': the same names, shapes and numbers.

`carried.npz` is a slice of reference numbers of the official code (Apache-2.0; commit 9a1202df,
PyTorch 2.13, float32, weights by `filled`): what it gave at a few frames, and the few inputs that
do not follow from a seed.
"""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from model.systems.official.config import PARTS
from model.systems.official.networks import make_network
from model.systems.official.system import smoothed
from tests.model.systems.official.filled import fill, made, sha256_of
from tests.model.systems.official.given_windows import GivenWindows, Networks

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
    return {part: fill(make_network(part)) for part in PARTS}


@pytest.fixture(scope="module")
def both(networks) -> Networks:
    return networks["motion"], networks["expression"]


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
def test_two_windows(carried, both, kind):
    given = GivenWindows(
        speaker=2,
        start_poses=carried["start_poses"],
        start_trans=carried["start_trans"],
        features=torch.stack([heard(3000), heard(3001)]),
        noise=torch.stack([normal(4000, 2, 60, 333)[0], normal(4001, 2, 60, 333)[0]]),
    )
    (first, _), whole = given.run(both, kind == "filtered")
    if kind == "filtered":
        np.testing.assert_allclose(first.vectors[0, -8:], carried["next_seed"], atol=1e-4)
    np.testing.assert_allclose(whole.vectors[0, ENDS, :330], carried[f"{kind}_rot6d"], atol=1e-4)
    np.testing.assert_allclose(whole.root[0, ENDS], carried[f"{kind}_trans"], atol=1e-4)
    np.testing.assert_allclose(whole.expression[0, ENDS], carried["face"], atol=1e-4)


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


@pytest.mark.parametrize("part", PARTS)
def test_names_shapes_and_filling_are_the_authors(networks, part):
    assert sha256_of(networks[part]) == FILLED[part]
