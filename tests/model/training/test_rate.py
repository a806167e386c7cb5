"""The fast training step beside the plain one."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from model.data.prepared import prepare
from model.networks.layers import Attention
from model.speech.features import MelEncoder
from model.systems.globaldiff.config import named_config
from model.systems.globaldiff.task import make_task
from model.training import rate
from model.training.parallel import WHOLE
from model.training.task import TaskSetup
from tests.helpers import ROOT
from tests.model.made import make_data_folder
from tests.model.training.made import log_of


def test_attention_written_out_is_torchs_own():
    torch.manual_seed(0)
    attention = Attention(24, 3)
    x, memory = torch.randn(2, 60, 24), torch.randn(2, 8, 24)

    def heads(y):
        return y.unflatten(-1, (3, -1)).transpose(1, 2)

    key, value = (heads(part) for part in attention.key_value(memory).chunk(2, dim=-1))
    mixed = torch.nn.functional.scaled_dot_product_attention(heads(attention.query(x)), key, value)
    wanted = attention.out(mixed.transpose(1, 2).flatten(-2))
    torch.testing.assert_close(attention(x, memory), wanted, atol=1e-6, rtol=1e-5)


def losses_of(data, folder, steps: int, shard) -> list[float]:
    config = named_config("smoke", "globaldiff/global")
    config = replace(config, batch_size=8, learning_rate=1e-3, warmup_steps=0, steps=10**6)
    task = make_task(config, data, TaskSetup(folder, shard=shard))
    clips, found = data.of_split("train"), []
    for step in range(steps):
        batch = data.window_batch(clips, 60, 8, np.random.default_rng(step))
        found.append(task.step(step, batch, torch.Generator().manual_seed(step))["total"])
    return found


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    root = tmp_path_factory.mktemp("rate")
    return prepare(make_data_folder(root / "data"), root / "prepared", MelEncoder())


@pytest.mark.parametrize(
    ("steps", "left"), [(60, 0.95), pytest.param(500, 0.7, marks=pytest.mark.slow)]
)
def test_bf16_trains_as_fp32_does(data, tmp_path, monkeypatch, steps, left):
    """Within 1 % of the loss, averaged over the last tenth."""
    monkeypatch.setattr("model.training.parallel.bf16_is_faster", lambda: True)
    fp32 = losses_of(data, tmp_path, steps, replace(WHOLE, bf16=False))
    bf16 = losses_of(data, tmp_path, steps, WHOLE)
    last = slice(-steps // 10, None)
    assert fp32 != bf16
    assert np.mean(fp32[last]) < left * fp32[0]
    assert np.mean(bf16[last]) == pytest.approx(np.mean(fp32[last]), rel=0.01)


@pytest.mark.slow
def test_a_compiled_step_is_the_step(tmp_path):
    """In processes of their own: the tests' checks of shapes are nothing that compiles."""
    if not rate.can_compile():
        pytest.skip("There is no C++ compiler here.")
    data = make_data_folder(tmp_path / "data")
    for name, flags in (("plain", ["--no-compile"]), ("compiled", [])):
        command = [sys.executable, "-m", "model.train", "smoke", "--fp32", "--steps", "3", *flags,
                   "--data", str(data), "--out", str(tmp_path / name)]  # fmt: skip
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=900)
    plain, compiled = (log_of(tmp_path / name) for name in ("plain", "compiled"))
    for row, other in zip(plain, compiled, strict=True):
        for column in (name for name in row if row[name] and name != "split"):
            assert float(other[column]) == pytest.approx(float(row[column]), rel=2e-3, abs=1e-7)


def test_without_a_compiler_the_step_stays_as_it_is(monkeypatch, caplog):
    rate.can_compile.cache_clear()
    monkeypatch.setattr(rate.shutil, "which", lambda name: None)
    with caplog.at_level("INFO"):
        assert not rate.can_compile()
    assert "No C++ compiler was found" in caplog.text
    rate.can_compile.cache_clear()


def test_a_compiler_that_fails_is_told_and_left_alone(monkeypatch, caplog):
    def broken(*_, **__):
        raise RuntimeError("ld: cannot find -lomp\nmore lines")

    rate.can_compile.cache_clear()
    monkeypatch.setattr(rate.shutil, "which", lambda name: "/usr/bin/" + name)
    monkeypatch.setattr(rate.torch, "compile", broken)
    with caplog.at_level("INFO"):
        assert not rate.can_compile()
    assert "ld: cannot find -lomp" in caplog.text and "more lines" not in caplog.text
    rate.can_compile.cache_clear()


def test_bf16_is_used_where_the_probe_finds_it_faster(monkeypatch):
    for faster in (True, False):
        monkeypatch.setattr("model.training.parallel.bf16_is_faster", lambda faster=faster: faster)
        with WHOLE.autocast():
            assert torch.is_autocast_enabled("cpu") == faster
        with replace(WHOLE, bf16=False).autocast():
            assert not torch.is_autocast_enabled("cpu")
