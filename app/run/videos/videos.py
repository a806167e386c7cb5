"""Several videos drawn at once in child processes, each told of as soon as it is whole; posters."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import CancelledRun
from app.run.requests.request import ShouldCancel

if TYPE_CHECKING:
    from renderer.video.worker_process import RenderJob, RenderResult

PARALLEL_VIDEOS = 2
_POLL_S = 0.05


def draw_videos(
    jobs: Mapping[str, RenderJob],
    on_progress: Callable[[float], None],
    on_done: Callable[[str], None],
    should_cancel: ShouldCancel,
    parallel: int = PARALLEL_VIDEOS,
) -> dict[str, RenderResult]:
    """Draw every job and return the results under the same names.

    ``parallel`` of them at once. Where there are no more cores than that, at the end so many more
    that none is drawn alone beside an idle core: of five by two, the last three together.

    Args:
        on_progress: called with the share of all frames done, 0 to 1.
        on_done: called with a name when its file is whole, in the order in which they end.

    Raises:
        CancelledRun: when ``should_cancel`` said so; the children are ended and left no file.
        BodyError, GLError, VideoError: of the first job that failed; the others are ended.
    """
    from renderer.video.pool import RenderPool, num_cores

    fractions = dict.fromkeys(jobs, 0.0)
    weights = {name: job.motion.num_frames for name, job in jobs.items()}
    total = sum(weights.values())
    waiting, tasks = list(jobs), {}
    results: dict[str, RenderResult] = {}
    last_together = parallel + (len(jobs) % parallel if num_cores() <= parallel else 0)
    with RenderPool(min(last_together, len(jobs))) as pool:
        while len(results) < len(jobs):
            if should_cancel():
                raise CancelledRun  # leaving the block by an error ends the children
            for name, task in tasks.items():
                if name not in results and task.done():
                    results[name] = task.result()
                    fractions[name] = 1.0
                    on_done(name)
            left = len(jobs) - len(results)
            running = last_together if left <= last_together else parallel
            while waiting and len(tasks) - len(results) < running:
                name = waiting.pop(0)
                tasks[name] = pool.submit(
                    jobs[name], lambda done, name=name: fractions.__setitem__(name, done)
                )
            on_progress(sum(weights[name] * fractions[name] for name in jobs) / total)
            if len(results) < len(jobs):
                time.sleep(_POLL_S)
    return results


POSTER_SUFFIX = ".jpg"
WIDTH_PX = 240
_QUALITY = 4
"""Of ffmpeg's JPEG, from 2, the best, to 31."""


def write_poster(video: Path, out: Path) -> None:
    """
    Raises:
        VideoError: if ffmpeg cannot read what this program has drawn.
    """
    from processes.ended import Ended
    from renderer.video.encoder import VideoError, ffmpeg_path

    command = [
        *(ffmpeg_path(), "-hide_banner", "-loglevel", "error", "-nostats", "-y"),
        *("-i", str(video), "-frames:v", "1", "-vf", f"scale={WIDTH_PX}:-2"),
        *("-q:v", str(_QUALITY), "-f", "mjpeg", str(out)),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        end, said = Ended(done.returncode).how, done.stderr.strip() or "it said nothing"
        raise VideoError(
            f"The picture of {video.name} cannot be written: ffmpeg ended {end}; {said}"
        )
