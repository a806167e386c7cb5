"""What each stage of rendering costs, measured apart, on one clip."""

import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import TypeVar

import numpy as np

from renderer.body.body import Body, BodyMotion
from renderer.body.skinning import VertexNormals
from renderer.draw.offscreen import OffscreenRenderer
from renderer.draw.probe import choose_backend
from renderer.scene.stage import set_stage
from renderer.scene.studio import FramePreparer, Subject
from renderer.video.compose import compose_videos
from renderer.video.encoder import VideoWriter
from renderer.video.naive import draw_naively
from renderer.video.pool import RenderPool
from renderer.video.settings import RenderSettings
from renderer.video.worker_process import RenderJob

_CHUNK_FRAMES = 16
Result = TypeVar("Result")


@dataclass(frozen=True)
class Cost:
    """What one stage takes for one frame, on average."""

    stage: str
    wall_ms: float
    cpu_ms: float
    """CPU time of this process, its threads and its children: steadier than the clock when the
    machine is busy."""


def stage_costs(
    body: Body, motion: BodyMotion, folder: Path, settings: RenderSettings | None = None
) -> tuple[Cost, ...]:
    """Cost of skinning, normals, ground shadow, drawing and encoding, one after the other.

    Vertices of the whole clip are held: use a clip of some seconds.

    Args:
        folder: where the measured video is written, and left.

    Raises:
        GLError, VideoError: as ``render_video``.
    """
    settings = settings or RenderSettings()
    stage = set_stage(body, [motion], settings.view, settings.aspect)
    num_frames = motion.num_frames
    chunks, skinning = _timed(
        "skinning", num_frames, lambda: list(body.vertices(motion, chunk=_CHUNK_FRAMES))
    )
    frames = list(chain.from_iterable(chunks))
    normals = VertexNormals(body.faces, body.num_vertices)
    _, normals_cost = _timed("normals", num_frames, lambda: [normals(each) for each in frames])
    prepare = FramePreparer(body.faces, body.num_vertices, stage, settings.studio)
    _, shadow = _timed(
        "ground shadow", num_frames, lambda: [prepare.ground.texture(each) for each in frames]
    )
    subject = Subject(body.faces, body.vertex_colors, prepare.ground.corners(), settings.studio)
    with OffscreenRenderer(
        *(subject, settings.width, settings.height, settings.backend or choose_backend()),
        antialias="supersample" if settings.antialias else "none",
    ) as renderer:
        posed = [prepare(each) for each in frames]
        renderer.draw(posed[0], stage.camera)  # compiles what draws

        def draw() -> list[np.ndarray]:
            return [renderer.draw(frame, stage.camera).copy() for frame in posed]

        pictures, drawing = _timed("drawing", num_frames, draw)

    def encode() -> None:
        size = (settings.width, settings.height)
        with VideoWriter(folder / "bench.mp4", *size, num_frames, crf=settings.crf) as video:
            for picture in pictures:
                video.write(picture)

    _, encoding = _timed("encoding", num_frames, encode)
    return skinning, normals_cost, shadow, drawing, encoding


def end_to_end_cost(
    motions: Sequence[BodyMotion],
    folder: Path,
    settings: RenderSettings | None = None,
    body_path: Path | None = None,
) -> Cost:
    """Cost of one frame of a finished comparison: a video of each motion, then all side by side.

    As the app does it, with processes that have to start. One motion is not compared with itself.

    Args:
        motions: of equal length.

    Raises:
        BodyError, GLError, VideoError: as ``render_video``.
    """
    settings = settings or RenderSettings()
    settings = replace(settings, backend=settings.backend or choose_backend())
    paths = [folder / f"bench{number}.mp4" for number in range(len(motions))]

    def draw() -> None:
        with RenderPool(min(len(motions), 2)) as pool:
            tasks = [
                pool.submit(RenderJob(motion, path, settings=settings, body_path=body_path))
                for motion, path in zip(motions, paths, strict=True)
            ]
            for task in tasks:
                task.result()
        if len(paths) > 1:
            compose_videos(paths, [path.stem for path in paths], folder / "comparison.mp4")

    _, cost = _timed("end to end", motions[0].num_frames, draw)
    return cost


def naive_cost(
    body: Body,
    motion: BodyMotion,
    settings: RenderSettings | None = None,
    max_frames: int = 30,
) -> Cost:
    """Cost of the usual pyrender loop on ready vertices, without skinning and encoding.

    Args:
        max_frames: it is slow, so only so many frames are drawn.

    Raises:
        GLError: where there is no OpenGL.
    """
    settings = settings or RenderSettings()
    backend = choose_backend()
    stage = set_stage(body, [motion], settings.view, settings.aspect)
    chunks = body.vertices(motion, chunk=_CHUNK_FRAMES)
    frames = list(islice(chain.from_iterable(chunks), max_frames))
    colors = body.vertex_colors

    def draw() -> None:
        for _ in draw_naively(
            frames, body.faces, colors, settings=settings, stage=stage, backend=backend
        ):
            pass

    _, cost = _timed("naive pyrender loop", len(frames), draw)
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
