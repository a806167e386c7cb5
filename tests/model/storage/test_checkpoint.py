import torch

from model.storage.checkpoint import load_weights, save_weights


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
