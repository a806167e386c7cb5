"""What drawing costs: finished videos, each stage apart, and the usual loop beside."""

import os
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import TypeVar

from app.bench.measured import Figure
from renderer.body.body import Body, BodyMotion, load_body
from renderer.body.skinning import VertexNormals
from renderer.draw.offscreen import GLError, OffscreenRenderer
from renderer.draw.probe import choose_backend, probe_backends
from renderer.scene.stage import set_stage
from renderer.scene.studio import FramePreparer, Subject
from renderer.video.compose import compose_videos
from renderer.video.encoder import VideoWriter
from renderer.video.naive import draw_naively
from renderer.video.render import PIECE_FRAMES, RenderSettings
from renderer.video.workers import RenderJob, draw_jobs

NAIVE_FRAMES = 30
"""The usual loop is slow."""
Result = TypeVar("Result")


@dataclass(frozen=True)
class Cost:
    """What one stage takes for one frame, on average."""

    stage: str
    wall_ms: float
    cpu_ms: float
    """CPU time of this process, its threads and its children: steadier than the clock when the
    machine is busy."""


def video_rates(motion: BodyMotion, folder: Path) -> list[Figure]:
    """Frames of finished video in a second, as the app draws them."""
    return [
        _rate(title, end_to_end_cost([motion] * count, folder, settings), aim)
        for title, count, settings, aim in (
            ("video, 512 x 512", 1, RenderSettings(512, 512), "at least 30"),
            ("video, 720 x 720", 1, RenderSettings(720, 720), "at least 20"),
            ("five side by side, 320 x 480 each", 5, RenderSettings(320, 480), "at least 12"),
            ("draft, 512 x 512", 1, RenderSettings(512, 512, antialias=False), "at least 60"),
        )
    ]


def backend_rates(motion: BodyMotion, folder: Path) -> list[Figure]:
    """The same video by each backend that works, whichever is used here."""
    return [
        _rate(
            f"video, 512 x 512, {report.name}",
            end_to_end_cost([motion], folder, RenderSettings(512, 512, backend=report.name)),
        )
        for report in probe_backends()
        if report.works
    ]


def stages(motion: BodyMotion, folder: Path) -> list[Figure]:
    """What each stage costs, with and without anti-aliasing, against the usual loop."""
    body = load_body()
    try:
        naive = naive_cost(body, motion, RenderSettings(512, 512))
    except GLError:  # it is a loop over OpenGL
        naive = None
    figures = []
    for kind, is_smooth, aim in (("", True, "at least 4"), (", draft", False, "at least 8")):
        costs = stage_costs(body, motion, folder, RenderSettings(512, 512, antialias=is_smooth))
        figures += [
            Figure(f"{cost.stage}, 512 x 512{kind}", cost.wall_ms, "ms/frame", cpu=cost.cpu_ms)
            for cost in costs
            if is_smooth or cost.stage == "drawing"
        ]
        if naive is not None:
            # The loop has its vertices ready, and encodes nothing: compared with the same part.
            ours = [cost for cost in costs if cost.stage not in ("skinning", "encoding")]
            wall, cpu = sum(c.wall_ms for c in ours), sum(c.cpu_ms for c in ours)
            title = f"naive loop over normals, shadow and drawing{kind}"
            figures.append(Figure(title, naive.wall_ms / wall, "x", aim, naive.cpu_ms / cpu))
    return figures


ALL = (video_rates, backend_rates, stages)


def _rate(title: str, cost: Cost, aim: str = "") -> Figure:
    """Frames in a second by the clock, and by the CPU time if all cores had been free."""
    cores = len(os.sched_getaffinity(0))
    return Figure(title, 1e3 / cost.wall_ms, "frames/s", aim, cores * 1e3 / cost.cpu_ms)


def stage_costs(
    body: Body, motion: BodyMotion, folder: Path, settings: RenderSettings
) -> tuple[Cost, ...]:
    """Cost of skinning, normals, ground shadow, drawing and encoding, one after the other.

    Vertices of the whole clip are held: use a clip of some seconds.

    Args:
        folder: where the measured video is written, and left.

    Raises:
        GLError, VideoError: as ``render_video``.
    """
    stage = set_stage(body, [motion], settings.view, settings.aspect)
    count, size = motion.num_frames, (settings.width, settings.height)
    chunks, skinning = _timed("skinning", count, lambda: list(body.vertices(motion, PIECE_FRAMES)))
    frames = list(chain.from_iterable(chunks))
    normals_of = VertexNormals(body.faces, body.num_vertices)
    _, normals = _timed("normals", count, lambda: [normals_of(each) for each in frames])
    prepare = FramePreparer(body.faces, body.num_vertices, stage, settings.studio)
    texture = prepare.ground.texture
    _, shadow = _timed("ground shadow", count, lambda: [texture(each) for each in frames])
    posed = [prepare(each) for each in frames]
    subject = Subject(body.faces, body.vertex_colors, prepare.ground.corners(), settings.studio)
    backend = settings.backend or choose_backend()
    with OffscreenRenderer(backend, is_smooth=settings.antialias) as renderer:
        canvas = renderer.canvas(subject, *size)
        canvas.draw(posed[0], stage.camera)  # compiles what draws
        pictures, drawing = _timed(
            "drawing", count, lambda: [canvas.draw(each, stage.camera).copy() for each in posed]
        )

    def encode() -> None:
        with VideoWriter(folder / "bench.mp4", *size, count, crf=settings.crf) as video:
            for picture in pictures:
                video.write(picture)

    _, encoding = _timed("encoding", count, encode)
    return skinning, normals, shadow, drawing, encoding


def end_to_end_cost(motions: Sequence[BodyMotion], folder: Path, settings: RenderSettings) -> Cost:
    """Cost of one frame of a finished comparison of motions of one length: a video of each, then
    all side by side, as the app does it, with processes that have to start. One motion is not
    compared with itself."""
    choose_backend()  # which is asked once

    def draw() -> None:
        jobs = {
            f"bench{i}": RenderJob(motion, folder / f"bench{i}.mp4", settings=settings)
            for i, motion in enumerate(motions)
        }
        draw_jobs(jobs)
        if len(jobs) > 1:
            paths = [folder / f"{name}.mp4" for name in jobs]
            compose_videos(paths, list(jobs), folder / "comparison.mp4")

    _, cost = _timed("end to end", motions[0].num_frames, draw)
    return cost


def naive_cost(
    body: Body, motion: BodyMotion, settings: RenderSettings, max_frames: int = NAIVE_FRAMES
) -> Cost:
    """Cost of the usual pyrender loop on ready vertices, without skinning and encoding.

    Raises:
        GLError: where there is no OpenGL.
    """
    backend = choose_backend()
    stage = set_stage(body, [motion], settings.view, settings.aspect)
    vertices = chain.from_iterable(body.vertices(motion, PIECE_FRAMES))
    frames = list(islice(vertices, max_frames))
    pictures = draw_naively(
        *(frames, body.faces, body.vertex_colors), settings=settings, stage=stage, backend=backend
    )
    _, cost = _timed("naive pyrender loop", len(frames), lambda: [None for _ in pictures])
    return cost


def _timed(stage: str, num_frames: int, work: Callable[[], Result]) -> tuple[Result, Cost]:
    cpu_started, started = _cpu_s(), time.perf_counter()
    result = work()
    wall_s, cpu_s = time.perf_counter() - started, _cpu_s() - cpu_started
    return result, Cost(stage, 1e3 * wall_s / num_frames, 1e3 * cpu_s / num_frames)


def _cpu_s() -> float:
    """CPU time of this process and of its children that have ended."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)
