"""The benchmark measures what it says, against a loop that draws the same body."""

import av
import numpy as np
import pytest

from app.bench.drawing import end_to_end_cost, naive_cost, stage_costs
from renderer.body.body import load_body
from renderer.draw.probe import choose_backend
from renderer.scene.stage import set_stage
from renderer.video.naive import draw_naively
from renderer.video.render import render_stills
from renderer.video.settings import RenderSettings
from tests.renderer.scene.test_camera import waving_motion

pytestmark = pytest.mark.gl


def small() -> RenderSettings:
    return RenderSettings(width=128, height=128, backend=choose_backend())


def test_every_stage_costs_something(tmp_path):
    body, motion = load_body(), waving_motion(8)
    costs = stage_costs(body, motion, tmp_path, small())
    names = [cost.stage for cost in costs]
    assert names == ["skinning", "normals", "ground shadow", "drawing", "encoding"]
    whole = end_to_end_cost([motion, motion], tmp_path, small())
    naive = naive_cost(body, motion, small(), max_frames=2)
    for cost in (*costs, whole, naive):
        assert 0.0 < cost.wall_ms and 0.0 < cost.cpu_ms < 10_000.0
    ours = sum(cost.cpu_ms for cost in costs if cost.stage in ("normals", "drawing"))
    assert naive.cpu_ms > ours
    for name in ("bench", "bench0", "bench1", "comparison"):
        with av.open(str(tmp_path / f"{name}.mp4")) as video:
            assert video.streams.video[0].frames == 8


def test_the_naive_loop_draws_the_same_body():
    body, motion, settings = load_body(), waving_motion(8), small()
    stage = set_stage(body, [motion])
    frames = [next(body.vertices(motion))[i] for i in (0, 5)]
    naive = draw_naively(
        *(frames, body.faces, body.vertex_colors),
        settings=settings,
        stage=stage,
        backend=choose_backend(),
    )
    ours = render_stills(body, motion, [0, 5], settings, stage=stage)
    for theirs, our in zip(naive, ours, strict=True):
        # Other shaders, so not the same pixels; but the same body in the same place.
        np.testing.assert_allclose(dark_box(theirs), dark_box(our), atol=4)
        assert (theirs != our).any()


def dark_box(picture: np.ndarray) -> list[int]:
    """First and last row and column of the trousers and the jersey: all else is light."""
    rows, columns = np.nonzero(picture.astype(int).sum(axis=2) < 360)
    return [rows.min(), rows.max(), columns.min(), columns.max()]
