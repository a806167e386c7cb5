"""Numbers that the authors' own code gave, carried here, so that equality is tested anywhere.

`carried.npz` is a slice of reference numbers of the official code (Apache-2.0; commit 9a1202df,
PyTorch 2.13, float32, weights by `filled`): what it gave at a few frames, and the few inputs that
do not follow from a seed. All other inputs are normal numbers of NumPy's generator.
"""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from model.systems.official.checkpoint import make_network
from model.systems.official.files import PARTS
from tests.model.systems.official.filled import fill
from tests.model.systems.official.given_windows import GivenWindows

CLOSE = 1e-4
AT = [0, 1, 7, 8, 30, 59]
"""Frames of a window that are carried."""
ENDS = [0, 8, 51, 52, 59, 60, 111]
"""Frames of two joined windows that are carried: around the seed, the overlap and the end."""


@pytest.fixture(scope="module")
def carried() -> dict[str, np.ndarray]:
    with np.load(Path(__file__).with_name("carried.npz")) as archive:
        return {name: archive[name] for name in archive.files}


@pytest.fixture(scope="module")
def networks() -> dict[str, nn.Module]:
    return {part: fill(make_network(part)) for part in PARTS}


def normal(seed: int, *shape: int) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).standard_normal(shape).astype(np.float32))


def heard(seed: int) -> Tensor:
    """99 vectors of speech, as 60 frames."""
    vectors = normal(seed, 99, 1024).T[None]
    size = {"size": 60, "mode": "linear", "align_corners": True}
    return nn.functional.interpolate(vectors, **size)[0].T


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
    np.testing.assert_allclose(x_1[0, AT], carried["motion"], atol=CLOSE)
    face = networks["expression"](speech, torch.tensor([0]))
    np.testing.assert_allclose(face[0, AT], carried["expression"], atol=CLOSE)


@torch.inference_mode()
@pytest.mark.parametrize("part", ["vae2", "vae3"])
def test_autoencoders(carried, networks, part):
    network, motion = networks[part], torch.from_numpy(carried["vae_motion"])
    hidden = torch.from_numpy(np.random.default_rng(106).random((2, 60))[:1] < 0.3)
    for mask, ending in ((None, ""), (hidden, "_masked")):
        mu = network.encode(motion, mask)[0, [0, 7, 14], :128]
        np.testing.assert_allclose(mu, carried[f"{part}_mu{ending}"], atol=CLOSE)
        again = network(motion, mask)[0, [0, 30]]
        np.testing.assert_allclose(again, carried[f"{part}_rec{ending}"], atol=CLOSE)


@pytest.mark.parametrize("kind", ["filtered", "unfiltered"])
def test_two_windows(carried, networks, kind):
    given = GivenWindows(
        speaker=2,
        start_poses=carried["start_poses"],
        start_trans=carried["start_trans"],
        features=torch.stack([heard(3000), heard(3001)]),
        noise=torch.stack([normal(4000, 2, 60, 333)[0], normal(4001, 2, 60, 333)[0]]),
    )
    both = networks["motion"], networks["expression"]
    (first, _), whole = given.run(both, kind == "filtered")
    if kind == "filtered":
        np.testing.assert_allclose(first.vectors[0, -8:], carried["next_seed"], atol=CLOSE)
    np.testing.assert_allclose(whole.vectors[0, ENDS, :330], carried[f"{kind}_rot6d"], atol=CLOSE)
    np.testing.assert_allclose(whole.root[0, ENDS], carried[f"{kind}_trans"], atol=CLOSE)
    np.testing.assert_allclose(whole.expression[0, ENDS], carried["face"], atol=CLOSE)
