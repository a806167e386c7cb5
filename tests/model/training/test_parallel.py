import pytest
import torch

from model.storage.checkpoint import load_weights
from model.systems.autoencoders.config import named_config
from model.systems.autoencoders.task import make_task
from model.train import main
from model.training.loop import train
from model.training.parallel import WHOLE, Shard
from model.training.run_folder import TrainingError
from tests.model.made import make_data_folder
from tests.model.training.made import log_of, train_in_two_processes


def test_shards_share_a_batch_without_overlap():
    rows = torch.arange(8)
    parts = [Shard(rank, 4).of(rows) for rank in range(4)]
    assert sorted(torch.cat(parts).tolist()) == rows.tolist()
    assert {len(part) for part in parts} == {2}
    assert torch.equal(WHOLE.of(rows), rows)


def test_a_batch_that_cannot_be_shared_is_refused(tmp_path):
    with pytest.raises(TrainingError, match="batch_size is 4; it must be a multiple of the 3"):
        train(
            named_config("smoke", "motion-vae"),
            make_task,
            tmp_path,
            tmp_path / "out",
            helpers=tmp_path,
            shard=Shard(0, 3),
        )


def test_two_processes_train_as_one_does(tmp_path):
    """torchrun and a single process: same loss, same gradient, same weights, up to rounding.

    The variational network draws the most kinds of random numbers: windows, mirrors, masks, noise.
    """
    data = make_data_folder(tmp_path / "data")
    arguments = ["smoke", "--system", "motion-vae", "--steps", "6", "--data", str(data)]
    arguments += ["--fp32"]  # bf16 rounds the sums of another batch differently
    assert main([*arguments, "--out", str(tmp_path / "one")]) == 0
    train_in_two_processes(arguments, tmp_path / "two")
    one, two = log_of(tmp_path / "one"), log_of(tmp_path / "two")
    assert [row["split"] for row in one] == [row["split"] for row in two] == ["val", "train"]
    for row, other in zip(one, two, strict=True):
        for column in row:
            if row[column] and column != "split":
                assert float(other[column]) == pytest.approx(float(row[column]), rel=1e-4)
    weights, others = (
        load_weights(tmp_path / name / "weights", "motion-vae")[0] for name in ("one", "two")
    )
    for key, tensor in weights.items():
        torch.testing.assert_close(others[key], tensor, rtol=1e-2, atol=1e-4)
