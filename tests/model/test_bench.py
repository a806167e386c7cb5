from types import SimpleNamespace

import pytest

from model import bench
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError
from model.systems.registry import load_system
from tests.model.made import made_speech, make_weights


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


def test_generation_is_told_for_each_frame_of_each_sample(monkeypatch, tmp_path):
    system = load_system("globaldiff/global", make_weights(tmp_path))
    clock = iter([0.0, 1.2])
    monkeypatch.setattr(bench, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    found = bench.generation_ms(system, made_speech(16_000), steps=1, samples=4)
    assert found == pytest.approx(10.0)  # 1.2 s for 4 x 30 frames
