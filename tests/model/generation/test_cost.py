from types import SimpleNamespace

import pytest

from model.generation import cost
from model.systems.registry import load_system
from tests.model.made import made_speech, make_weights


def test_generation_is_told_for_each_frame_of_each_sample(monkeypatch, tmp_path):
    system = load_system("globaldiff/global", make_weights(tmp_path))
    clock = iter([0.0, 1.2])
    monkeypatch.setattr(cost, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    found = cost.generation_ms(system, made_speech(16_000), steps=1, samples=4)
    assert found == pytest.approx(10.0)  # 1.2 s for 4 x 30 frames
