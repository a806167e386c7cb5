"""The benchmark measures what it says, against a loop that draws the same body."""

from types import SimpleNamespace

import av
import numpy as np
import pytest

from app.bench import runs as bench
from app.bench.drawing import end_to_end_cost, naive_cost, stage_costs
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError
from renderer.body.body import load_body
from renderer.draw.probe import choose_backend
from renderer.scene.stage import set_stage
from renderer.video.naive import draw_naively
from renderer.video.render import RenderSettings, render_stills
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
def test_every_stage_costs_something_and_the_naive_loop_draws_the_same_body(tmp_path):
    body, motion = load_body(), waving_motion(8)
    settings = RenderSettings(width=128, height=128, backend=choose_backend())
    costs = stage_costs(body, motion, tmp_path, settings)
    names = [cost.stage for cost in costs]
    assert names == ["skinning", "normals", "ground shadow", "drawing", "encoding"]
    whole = end_to_end_cost([motion, motion], tmp_path, settings)
    naive_one = naive_cost(body, motion, settings, max_frames=2)
    assert all(cost.wall_ms > 0 and cost.cpu_ms > 0 for cost in (*costs, whole, naive_one))
    for name in ("bench", "bench0", "bench1", "comparison"):
        with av.open(str(tmp_path / f"{name}.mp4")) as video:
            assert video.streams.video[0].frames == 8
    stage = set_stage(body, [motion])
    frames = [next(body.vertices(motion))[i] for i in (0, 5)]
    looks = {"settings": settings, "stage": stage}
    naive = draw_naively(frames, body.faces, body.vertex_colors, backend=choose_backend(), **looks)
    ours = render_stills(body, motion, [0, 5], **looks)
    for theirs, our in zip(naive, ours, strict=True):
        # Other shaders, so not the same pixels; but the same body in the same place.
        np.testing.assert_allclose(dark_box(theirs), dark_box(our), atol=4)
        assert (theirs != our).any()


def dark_box(picture: np.ndarray) -> list[int]:
    """First and last row and column of the trousers and the jersey: all else is light."""
    rows, columns = np.nonzero(picture.astype(int).sum(axis=2) < 360)
    return [rows.min(), rows.max(), columns.min(), columns.max()]
