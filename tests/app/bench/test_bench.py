"""The benchmark measures what it says."""

from types import SimpleNamespace

import av
import numpy as np
import pytest

from app.bench import drawing
from app.bench import runs as bench
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError
from renderer.body.body import load_body
from renderer.draw.offscreen import OffscreenRenderer
from renderer.draw.probe import choose_backend
from renderer.scene.studio import PosedFrameBuilder, StaticBody
from renderer.video.baseline import draw_with_plain_pyrender
from renderer.video.render import RenderSettings, camera_setup_for
from tests.renderer.scene.test_camera import waving_motion

pytestmark = pytest.mark.slow


def test_training_rate_counts_the_windows_of_the_timed_steps(monkeypatch, weights):
    clock = iter([100.0, 102.0])  # as if the steps after the warm-up had taken two seconds
    monkeypatch.setattr(bench, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    rate = bench.measure_training_windows_per_s("globaldiff/global", BUNDLED_WEIGHTS, "smoke")
    assert rate == bench.TIMED_STEPS * bench.BATCH / 2.0
    with pytest.raises(CheckpointError, match="motion-vae"):  # what L_m needs
        bench.measure_training_windows_per_s("globaldiff/full", weights, "smoke")


@pytest.mark.gl
def test_the_naive_loop_draws_the_same_body():
    body, motion = load_body(), waving_motion(2)
    stage = camera_setup_for(body, [motion], RenderSettings(drawing.SIZE_PX, drawing.SIZE_PX))
    frames = next(iter(body.posed_vertices(motion, 2)))
    prepare = PosedFrameBuilder(body.faces, body.num_vertices, stage)
    subject = StaticBody(body.faces, body.vertex_colors, prepare.ground.corners())
    with OffscreenRenderer(choose_backend()) as renderer:
        canvas = renderer.make_canvas(subject, drawing.SIZE_PX, drawing.SIZE_PX)
        ours = [canvas.draw(prepare(each), stage.camera).copy() for each in frames]
    for naive, our in zip(
        draw_with_plain_pyrender(list(frames), body, stage, drawing.SIZE_PX), ours, strict=True
    ):
        upper = np.s_[: drawing.SIZE_PX // 2]  # no floor
        far = np.abs(naive[upper].astype(int) - our[upper]).max(axis=-1) > 60
        assert far.mean() < 0.02


@pytest.mark.gl
def test_every_stage_and_video_costs_something(tmp_path):
    costs = drawing.measure_render_stages(waving_motion(8), tmp_path)
    names = [cost.name.partition(",")[0] for cost in costs]
    naive = "speed-up of our rendering over a plain pyrender loop"
    assert names == ["skinning", "normals", "ground shadow", "drawing", "encoding", naive]
    costs += drawing.measure_video_rates(waving_motion(8), tmp_path)
    assert all(cost.value > 0 and cost.value_by_cpu_time for cost in costs)
    for name in ("bench", "bench0", "bench4", "comparison"):
        with av.open(str(tmp_path / f"{name}.mp4")) as video:
            assert video.streams.video[0].frames == 8
