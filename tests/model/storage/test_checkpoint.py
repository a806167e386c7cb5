import pytest
import torch

from model.storage.cards import CheckpointError
from model.storage.checkpoint import load_into, load_weights, save_weights


def test_weights_come_back_as_fp16_rounds_them(tmp_path):
    tensors = {"network.a": torch.randn(3, 4), "normaliser.mean": torch.randn(5) * 1e-5}
    save_weights(tmp_path, "globaldiff/global", tensors, {"steps": 3})
    back, card = load_weights(tmp_path, "globaldiff/global")
    assert card["system"] == "globaldiff/global" and card["steps"] == 3
    torch.testing.assert_close(back["network.a"], tensors["network.a"].half().float())
    torch.testing.assert_close(back["normaliser.mean"], tensors["normaliser.mean"])
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "globaldiff-global.json", "globaldiff-global.safetensors",
    ]  # fmt: skip


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
