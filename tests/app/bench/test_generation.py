from types import SimpleNamespace

import pytest

from app.bench import generation as bench
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError
from tests.model.made import make_weights


def test_training_rate_counts_the_windows_of_the_timed_steps(monkeypatch):
    clock = iter([100.0, 102.0])  # as if the steps after the warm-up had taken two seconds
    monkeypatch.setattr(bench, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    rate = bench.training_rate(
        "globaldiff/global", BUNDLED_WEIGHTS, "smoke", fast=False, num_steps=1
    )
    assert rate == bench.BATCH / 2.0


def test_training_with_l_m_needs_its_encoder(tmp_path):
    with pytest.raises(CheckpointError, match="motion-vae"):
        bench.training_rate("globaldiff/full", make_weights(tmp_path), "smoke", fast=False)
