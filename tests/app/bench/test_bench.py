"""The benchmark measures what it says."""

from types import SimpleNamespace

import av
import pytest

from app.bench import drawing
from app.bench import runs as bench
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError
from tests.renderer.scene.test_camera import waving_motion

pytestmark = pytest.mark.slow


def test_training_rate_counts_the_windows_of_the_timed_steps(monkeypatch, weights):
    clock = iter([100.0, 102.0])  # as if the steps after the warm-up had taken two seconds
    monkeypatch.setattr(bench, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    rate = bench.training_rate(
        "globaldiff/global", BUNDLED_WEIGHTS, "smoke", fast=False, num_steps=1
    )
    assert rate == bench.BATCH / 2.0
    with pytest.raises(CheckpointError, match="motion-vae"):  # what L_m needs
        bench.training_rate("globaldiff/full", weights, "smoke", fast=False)


@pytest.mark.gl
def test_every_stage_and_video_costs_something(tmp_path):
    costs = drawing.stages(waving_motion(8), tmp_path)
    names = [cost.name.partition(",")[0] for cost in costs]
    assert names == ["skinning", "normals", "ground shadow", "drawing", "encoding"]
    costs += drawing.video_rates(waving_motion(8), tmp_path)
    assert all(cost.value > 0 and cost.cpu for cost in costs)
    for name in ("bench", "bench0", "bench4", "comparison"):
        with av.open(str(tmp_path / f"{name}.mp4")) as video:
            assert video.streams.video[0].frames == 8
