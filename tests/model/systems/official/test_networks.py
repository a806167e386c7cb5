"""The networks are the authors': the same names, shapes and numbers."""

import json

import numpy as np
import pytest
import torch
from torch import nn

from model.systems.official import sizes
from model.systems.official.checkpoint import make_network
from model.systems.official.files import PARTS, Part
from tests.helpers import official_folder
from tests.model.systems.official.filled import fill, sha256_of

CLOSE = 2e-5
"""The reference itself is within 6e-6 of double precision."""
FILLED = {
    "motion": "5ec722cd8caa270e7918e6c90e50407ab154c8424352ffc1ef9285145aa81dfc",
    "expression": "97925f15533821560e3eecd965dd8d771df4a89754c4d4df302afd52098c15f6",
    "vae2": "6be11ce04984851280fc6f32aff6700e10a06b63719763234b1ae5df6d7adf5c",
    "vae3": "6d2e2cea8da7bf5d18a470c22532f6c5061088e8b3a18f837cf83da7b1c86131",
}
"""SHA-256 of the authors' networks filled by the rule: over all names and bytes, in their order."""


@pytest.fixture(scope="module")
def networks() -> dict[str, nn.Module]:
    return {part: fill(make_network(part)) for part in PARTS}


@pytest.mark.parametrize("part", PARTS)
def test_names_shapes_and_filling_are_the_authors(networks, part: Part):
    assert sha256_of(networks[part]) == FILLED[part]


@pytest.mark.parametrize("part", PARTS)
def test_names_and_shapes_are_listed(networks, part: Part):
    listed = json.loads((official_folder() / f"keys-{part}.json").read_text())
    own = {name: list(tensor.shape) for name, tensor in networks[part].state_dict().items()}
    assert own == {entry["key"]: entry["shape"] for entry in listed["tensors"]}
    assert list(own) == [entry["key"] for entry in listed["tensors"]]
    assert sum(p.numel() for p in networks[part].parameters()) == listed["parameters"]


def test_branches_take_the_authors_channels_in_their_order():
    listed = json.loads((official_folder() / "channels.json").read_text())["channels"]
    assert list(sizes.HAND_CHANNELS) == listed["hand"]
    assert list(sizes.BODY_CHANNELS) == listed["body"]


def test_every_channel_is_of_one_branch():
    both = (*sizes.HAND_CHANNELS, *sizes.BODY_CHANNELS)
    assert sorted(both) == list(range(sizes.MOTION_DIM))


def _reference(name: str) -> dict[str, torch.Tensor]:
    with np.load(official_folder() / f"reference-{name}.npz") as archive:
        return {key: torch.from_numpy(archive[key]) for key in archive.files}


@torch.inference_mode()
def test_motion_network_equals_the_authors_inside_and_out(networks):
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
    names = [key.removeprefix("mid_") for key in wanted if key.startswith("mid_")]
    names.remove("frames")
    assert len(names) == 13
    for name in names:
        own, kept = inside[name], wanted[f"mid_{name}"]
        own = own if own.shape == kept.shape else own[:1, wanted["mid_frames"]]
        torch.testing.assert_close(own, kept, atol=CLOSE, rtol=0, msg=name)


@torch.inference_mode()
def test_expression_model_equals_the_authors(networks):
    wanted, heard = _reference("expression"), _reference("motion")["in_features"]
    face = networks["expression"](heard, wanted["in_pid"])
    torch.testing.assert_close(face, wanted["out_expressions"], atol=CLOSE, rtol=0)


@torch.inference_mode()
@pytest.mark.parametrize("part", ["vae2", "vae3"])
def test_autoencoders_equal_the_authors(networks, part):
    wanted, network = _reference("vae"), networks[part]
    motion, hidden = wanted["in_x"], wanted["in_mask"]
    for own, name in (
        (network.encode(motion), "encode"),
        (network.encode(motion)[..., :128], "mu"),
        (network.encode(motion)[..., 128:], "logvar"),
        (network(motion), "rec"),
        (network.encode(motion, hidden)[..., :128], "mu_masked"),
        (network(motion, hidden), "rec_masked"),
    ):
        torch.testing.assert_close(own, wanted[f"{part}_out_{name}"], atol=CLOSE, rtol=0, msg=name)
