"""Benchmark of drawing: finished videos, and each stage against the usual pyrender loop."""

import os
from collections.abc import Callable
from itertools import chain
from pathlib import Path

from app.bench.runs import BenchResult, Result, measure_time
from renderer.body.body import BodyMotion, load_body
from renderer.body.skinning import VertexNormals
from renderer.draw.offscreen import OffscreenRenderer
from renderer.draw.probe import choose_backend
from renderer.scene.camera_setup import select_frames
from renderer.scene.studio import PosedFrameBuilder, StaticBody
from renderer.video.baseline import draw_with_plain_pyrender
from renderer.video.compose import compose_videos
from renderer.video.encoder import VideoWriter
from renderer.video.render import RenderSettings, camera_setup_for, select_panel_mesh
from renderer.video.workers import MotionRenderJob, run_render_jobs

SIZE_PX = 512
NAIVE_FRAMES = 30
"""Frames drawn by the usual loop, which is slow."""


def measure_video_rates(motion: BodyMotion, folder: Path) -> list[BenchResult]:
    """Measure the frames per second of finished videos, including the start of worker processes.

    Several videos are also composed side by side. The CPU rate assumes that all cores were free.
    """
    choose_backend()  # cached after the first call
    figures = []
    for title, count, settings, aim in (
        ("video, 512 x 512", 1, RenderSettings(512, 512), 75),
        ("video, 720 x 720", 1, RenderSettings(720, 720), 50),
        ("five videos side by side, 320 x 480 each", 5, RenderSettings(320, 480), 35),
    ):
        jobs = {
            f"bench{i}": MotionRenderJob(motion, folder / f"bench{i}.mp4", settings=settings)
            for i in range(count)
        }

        def draw(jobs: dict[str, MotionRenderJob] = jobs) -> None:
            run_render_jobs(jobs)
            if len(jobs) > 1:
                paths = [folder / f"{name}.mp4" for name in jobs]
                compose_videos(paths, list(jobs), folder / "comparison.mp4")

        _, wall_s, cpu_s = measure_time(draw)
        frames, cores = motion.num_frames, len(os.sched_getaffinity(0))
        at_least = f"at least {aim}"
        figures.append(
            BenchResult(title, frames / wall_s, "frames/s", at_least, cores * frames / cpu_s)
        )
        figures.append(BenchResult(f"CPU time, {title}", 1e3 * cpu_s / frames / count, "ms/frame"))
    return figures


def measure_render_stages(motion: BodyMotion, folder: Path) -> list[BenchResult]:
    """Measure skinning, normals, ground shadow, drawing and encoding of a clip of some seconds.

    The vertices of all frames are in memory. The last figure compares normals, shadow and drawing
    with the usual loop, which also gets its vertices ready-made.
    """
    whole, settings, figures = load_body(), RenderSettings(SIZE_PX, SIZE_PX), []
    stage = camera_setup_for(whole, [motion], settings)
    body = select_panel_mesh(whole, stage, stage.panel_cameras[0], settings.panels[0])

    def timed(name: str, work: Callable[[], Result]) -> Result:
        result, *seconds = measure_time(work)
        wall, cpu = (1e3 * one / motion.num_frames for one in seconds)
        figures.append(
            BenchResult(f"{name}, {SIZE_PX} x {SIZE_PX}", wall, "ms/frame", value_by_cpu_time=cpu)
        )
        return result

    chunks = timed("skinning", lambda: list(body.posed_vertices(motion)))
    frames = list(chain.from_iterable(chunks))
    normals_of = VertexNormals(body.faces, body.num_vertices)
    timed("normals", lambda: [normals_of(one) for one in frames])
    prepare = PosedFrameBuilder(body.faces, body.num_vertices, stage)
    timed(
        "ground shadow",
        lambda: [prepare.ground.texture(prepare.ground.shadow(one)) for one in frames],
    )
    posed = [prepare(one) for one in frames]
    subject = StaticBody(body.faces, body.vertex_colors, prepare.ground.corners())
    with OffscreenRenderer(choose_backend()) as renderer:
        canvas = renderer.make_canvas(subject, SIZE_PX, SIZE_PX)
        canvas.draw(posed[0], stage.camera)  # compiles the shaders
        images = timed("drawing", lambda: [canvas.draw(one, stage.camera).copy() for one in posed])

    def encode() -> None:
        with VideoWriter(folder / "bench.mp4", SIZE_PX, SIZE_PX, len(images)) as video:
            for picture in images:
                video.write(picture)

    timed("encoding", encode)
    few = [*chain.from_iterable(whole.posed_vertices(select_frames(motion, slice(NAIVE_FRAMES))))]
    _, *seconds = measure_time(lambda: draw_with_plain_pyrender(few, whole, stage, SIZE_PX))
    wall, cpu = (1e3 * one / len(few) for one in seconds)
    ours = [one for one in figures if not one.name.startswith(("skinning", "encoding"))]
    own_wall, own_cpu = (
        sum(one.value for one in ours),
        sum(one.value_by_cpu_time or 0.0 for one in ours),
    )
    title = "speed-up of our rendering over a plain pyrender loop"
    return [
        *figures,
        BenchResult(title, wall / own_wall, "x", "at least 35 (CPU 40)", cpu / own_cpu),
    ]
