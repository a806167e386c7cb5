"""What docs/official.md says of sizes is counted."""

import re
from collections.abc import Iterable

from torch import nn

from model.systems.globaldiff.config import named_config
from model.systems.globaldiff.network import MotionNetwork
from model.systems.official.checkpoint import make_network
from model.systems.official.files import PARTS
from tests.helpers import ROOT

DOCUMENT = (ROOT / "docs" / "official.md").read_text("utf-8")
BOTH = ("hands", "torso")
PARTS_OF_OURS = {
    "speech": ("speech",),
    "time and speaker": ("condition",),
    "what comes in, both branches": tuple(
        f"{branch}.{part}" for branch in BOTH for part in ("region_in", "body_in", "fuse")
    ),
    "seed": tuple(
        f"{branch}.{part}"
        for branch in BOTH
        for part in ("seed_in", "seed_to_condition", "no_seed")
    ),
    "blocks, both branches": tuple(f"{branch}.blocks" for branch in BOTH),
    "what goes out": tuple(f"{branch}.{part}" for branch in BOTH for part in ("norm_out", "out")),
    "no speech": ("no_speech",),
    "motion network": ("",),
}
PARTS_OF_THEIRS = {
    "speech": ("hubert_prj",),
    "time and speaker": ("time_embed", "style_embed"),
    "what comes in, both branches": (
        "in_hand", "in_body", "in_x_hand", "in_x_body", "hand_fuse", "body_fuse",
    ),
    "seed": ("seed_prj_hand", "seed_prj_body"),
    "blocks, both branches": ("transformer_hand", "transformer_body"),
    "what goes out": ("hand", "body"),
    "no speech": (),
    "motion network": ("",),
}  # fmt: skip


def _count(network: nn.Module, parts: Iterable[str]) -> int:
    return sum(
        tensor.numel()
        for name, tensor in network.named_parameters()
        if any(not part or f"{name}.".startswith(f"{part}.") for part in parts)
    )


def test_the_table_counts_both_networks_by_part():
    rows = re.findall(r"^\| ([a-z, ]+) \| ([\d,]+) \| ([\d,]+) \|$", DOCUMENT, re.MULTILINE)
    told = {name: (_number(theirs), _number(ours)) for name, theirs, ours in rows}
    theirs = make_network("motion")
    ours = MotionNetwork(named_config("paper", "globaldiff/full").network)
    assert told == {
        part: (_count(theirs, PARTS_OF_THEIRS[part]), _count(ours, PARTS_OF_OURS[part]))
        for part in PARTS_OF_OURS
    }
    sums = [sum(pair[k] for name, pair in told.items() if name != "motion network") for k in (0, 1)]
    assert tuple(sums) == told["motion network"]  # every part is in one row


def test_sizes_of_all_networks_are_told():
    for part in PARTS:
        assert f"{_count(make_network(part), ['']):,}" in DOCUMENT, part


def _number(text: str) -> int:
    return int(text.replace(",", ""))
