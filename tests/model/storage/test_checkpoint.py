import pytest
import torch

from model.networks.config import MatchingConfig
from model.storage.cards import Card, CheckpointError
from model.storage.checkpoint import load_into, load_weights, save_weights


def test_weights_come_back_as_fp16_rounds_them(tmp_path):
    tensors = {"network.a": torch.randn(3, 4), "normaliser.mean": torch.randn(5) * 1e-5}
    save_weights(tmp_path, "globaldiff/global", tensors, {"steps": 3})
    back, card = load_weights(tmp_path, "globaldiff/global")
    assert card["system"] == "globaldiff/global" and card["steps"] == 3
    torch.testing.assert_close(back["network.a"], tensors["network.a"].half().float())
    torch.testing.assert_close(back["normaliser.mean"], tensors["normaliser.mean"])
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "globaldiff-global.json",
        "globaldiff-global.safetensors",
    ]


@pytest.mark.parametrize(
    ("saved", "said"),
    [
        ({"weight": torch.zeros(2, 3)}, r"bias is missing\."),
        ({"weight": torch.zeros(3, 2), "bias": torch.zeros(2)},
         r"weight is of shape \[3, 2\] in place of \[2, 3\]\."),
        ({"bias": torch.zeros(2), "more": torch.zeros(1)},
         r"weight is missing \(1 more differ\)\."),
        ({"weight": torch.zeros(2, 3), "bias": torch.zeros(2), "more": torch.zeros(1)},
         r"more is not known\."),
    ],
)  # fmt: skip
def test_weights_that_do_not_fit_are_told_by_the_first_that_differs(saved, said):
    tensors = {f"network.{name}": tensor for name, tensor in saved.items()}
    with pytest.raises(CheckpointError, match="of toy do not fit their card: " + said):
        load_into(torch.nn.Linear(3, 2), tensors, "network.", "toy")


def test_what_a_card_lacks_or_misstates_is_told_with_the_weights_name():
    card = Card({"config": {"network": {"hidden": 8}}, "speakers": ["hana"]}, "globaldiff/local")
    for read, what in (
        (lambda: card.sha256, "'sha256'"),
        (lambda: card.encoder, "'encoder'"),
        (lambda: card.speakers, "'list' object has no attribute 'items'"),
        (lambda: card.config(MatchingConfig, "matching"), "'matching'"),
        (lambda: card.config(MatchingConfig, "network"), "MatchingConfig has no field hidden"),
    ):
        with pytest.raises(CheckpointError, match="The card of globaldiff/local") as caught:
            read()
        assert what in str(caught.value)
    assert (card.training_hours, card.steps, card.whose) == (0.0, None, None)
    told = Card({"speakers": {"hana": 3}, "training_hours": 2.5, "steps": 9}, "gan/5")
    assert (told.speakers, told.training_hours, told.steps) == ({"hana": 3}, 2.5, 9)
