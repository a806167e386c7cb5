"""The networks are the authors': the same names, shapes and numbers.

`carried.npz` is a slice of reference numbers of the official code (Apache-2.0; commit 9a1202df,
PyTorch 2.13, float32, weights by `filled`): what it gave at a few frames, and the few inputs that
do not follow from a seed, so that equality is tested anywhere. `official_folder` has all of them.
"""

import copy
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from model.motion.kinematics import local_from_global
from model.motion.rotations import matrix_from_axis_angle
from model.systems.official import files as sizes
from model.systems.official.files import PARTS
from model.systems.official.networks import make_network
from model.systems.official.system import smoothed
from tests.helpers import official_folder
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
def reference() -> dict[str, np.ndarray]:
    with np.load(official_folder() / "reference-inference.npz") as archive:
        return {name: archive[name] for name in archive.files}


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


CLOSE = 2e-5
"""The reference itself is within 6e-6 of double precision."""
FILLED = {
    "motion": "5ec722cd8caa270e7918e6c90e50407ab154c8424352ffc1ef9285145aa81dfc",
    "expression": "97925f15533821560e3eecd965dd8d771df4a89754c4d4df302afd52098c15f6",
}
"""SHA-256 of the authors' networks filled by the rule: over all names and bytes, in their order."""


def _reference(name: str) -> dict[str, torch.Tensor]:
    with np.load(official_folder() / f"reference-{name}.npz") as archive:
        return {key: torch.from_numpy(archive[key]) for key in archive.files}


@torch.inference_mode()
def test_networks_equal_the_authors_inside_and_out(networks):
    wanted, network = _reference("motion"), networks["motion"]
    inside: dict[str, torch.Tensor] = {}

    def watch(name: str, module: nn.Module) -> None:
        def keep(_module, given, answer):
            inside[f"{name}_in"], inside[name] = given[0], answer

        module.register_forward_hook(keep)

    for branch in ("hand", "body"):
        blocks = getattr(network, f"transformer_{branch}")
        watch(f"{branch}_block0", blocks[0])
        watch(f"{branch}_block5", blocks[5])
        watch(f"{branch}_fused", getattr(network, f"{branch}_fuse"))
        watch(f"seed_{branch}_projected", getattr(network, f"seed_prj_{branch}"))
    watch("speech_projected", network.hubert_prj)
    watch("time_embedding", network.time_embed)
    watch("speaker_embedding", network.style_embed)
    x_1 = network(
        wanted["in_x"],
        wanted["in_t"],
        speech=wanted["in_features"],
        expression=wanted["in_expressions"],
        seed=wanted["in_seed"],
        speaker=wanted["in_pid"],
    )
    torch.testing.assert_close(x_1, wanted["out_x1"], atol=CLOSE, rtol=0)
    face = networks["expression"](wanted["in_features"], _reference("expression")["in_pid"])
    told = _reference("expression")["out_expressions"]
    torch.testing.assert_close(face, told, atol=CLOSE, rtol=0)
    names = [key.removeprefix("mid_") for key in wanted if key.startswith("mid_")]
    names.remove("frames")
    assert len(names) == 13
    for name in names:
        own, kept = inside[name], wanted[f"mid_{name}"]
        own = own if own.shape == kept.shape else own[:1, wanted["mid_frames"]]
        torch.testing.assert_close(own, kept, atol=CLOSE, rtol=0, msg=name)


def _given(reference: dict[str, np.ndarray], clip: int) -> GivenWindows:
    return GivenWindows(
        speaker=int(reference["pid"][clip]),
        start_poses=reference["seed_poses_axis_angle_local"][clip],
        start_trans=reference["seed_trans"][clip],
        features=torch.from_numpy(reference["features"][clip, :2]),
        noise=torch.from_numpy(reference["noise"][:2, clip]),
    )


def test_two_windows_equal_the_authors_to_the_last_number(reference, both):
    """In double precision, without our own rounding: the reference's is left."""
    networks = tuple(copy.deepcopy(network).double() for network in both)
    _, whole = _given(reference, 0).run(networks, True, torch.float64)
    wanted = reference["filtered_stitched_rot6d"][0]
    np.testing.assert_allclose(whole.vectors[0, :, :330], wanted, atol=1e-4)


@pytest.mark.parametrize("clip", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_written_poses_and_each_evaluation_are_the_authors(reference, both, clip):
    """What the network is given and what it says, ten times in each of two windows."""
    asked: list[tuple[float, Tensor, Tensor]] = []

    def keep(_module, given, answer) -> None:
        asked.append((float(given[1][0]), given[0][0].clone(), answer[0].clone()))

    handle = both[0].register_forward_hook(keep)
    _, whole = _given(reference, clip).run(both, True)
    handle.remove()
    local = local_from_global(whole.rotmat[0].double())
    written = torch.from_numpy(reference[f"filtered_poses_{clip}"]).double().unflatten(-1, (55, 3))
    error = (local - matrix_from_axis_angle(written)).abs().amax((-1, -2)).numpy()
    sure = ~reference["filtered_axis_angle_unreliable"][clip]  # near pi theirs is no rotation
    assert sure.mean() > 0.98 and error[sure].max() < 2e-3
    if clip == 0:
        at = reference["trace_frames"]
        times, given, told = zip(*asked, strict=True)
        np.testing.assert_allclose(times, reference["trace_t"], atol=1e-7)
        for found, name in ((given, "trace_x"), (told, "trace_x1")):
            np.testing.assert_allclose(np.stack([x[at] for x in found]), reference[name], atol=1e-4)


def test_the_filter_is_the_authors():
    with np.load(official_folder() / "reference-rotations.npz") as wanted:
        given = torch.from_numpy(wanted["filter_in"])
        led = torch.cat([torch.zeros(1, 5, given.shape[-1]), given], dim=1)
        np.testing.assert_allclose(smoothed(led)[:, 5:], wanted["filter_out"], atol=1e-6)


def test_the_filter_changes_only_the_middle():
    vectors = made("vectors", (2, 60, 7))
    changed = (smoothed(vectors) != vectors).any(-1).any(0)
    assert changed.nonzero().flatten().tolist() == list(range(8, 57))
    parabola = (torch.linspace(-1, 1, 60)[:, None] ** 2).expand(1, -1, 3)
    torch.testing.assert_close(smoothed(parabola), parabola, atol=1e-6, rtol=0)


@pytest.mark.parametrize("part", PARTS)
def test_names_shapes_and_filling_are_the_authors(networks, part):
    assert sha256_of(networks[part]) == FILLED[part]


@pytest.mark.parametrize("part", PARTS)
def test_names_shapes_and_channels_are_as_listed(networks, part):
    listed = json.loads((official_folder() / f"keys-{part}.json").read_text())
    own = {name: list(tensor.shape) for name, tensor in networks[part].state_dict().items()}
    assert list(own.items()) == [(entry["key"], entry["shape"]) for entry in listed["tensors"]]
    assert sum(p.numel() for p in networks[part].parameters()) == listed["parameters"]
    channels = json.loads((official_folder() / "channels.json").read_text())["channels"]
    assert list(sizes.HAND_CHANNELS) == channels["hand"]
    assert list(sizes.BODY_CHANNELS) == channels["body"]
    both = (*sizes.HAND_CHANNELS, *sizes.BODY_CHANNELS)
    assert sorted(both) == list(range(sizes.MOTION_DIM))
