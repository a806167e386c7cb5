"""How many videos are drawn at once, whatever draws them."""

from concurrent.futures import Future
from types import SimpleNamespace

import numpy as np
import pytest

from app.run.videos import videos
from renderer.video import pool
from renderer.video.worker_process import RenderJob, RenderResult
from tests.renderer.scene.test_camera import waving_motion


@pytest.mark.parametrize(
    ("cores", "count", "together"),
    [
        (2, 1, [1]),
        (2, 2, [2, 1]),
        (2, 3, [3, 2, 1]),
        (2, 4, [2, 2, 2, 1]),
        (2, 5, [2, 2, 3, 2, 1]),
        (1, 5, [2, 2, 3, 2, 1]),
        (8, 5, [2, 2, 2, 2, 1]),
    ],
)
def test_at_the_end_none_is_drawn_alone(
    cores: int, count: int, together: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Jobs end one after the other in the order in which they began."""
    open_jobs: list[RenderJob] = []
    futures: dict[int, Future[RenderResult]] = {}
    seen: list[int] = []

    def submit(self: pool.RenderPool, job: RenderJob, on_progress: object) -> Future[RenderResult]:
        open_jobs.append(job)
        futures[id(job)] = Future()
        return futures[id(job)]

    def end_the_first(seconds: float) -> None:
        seen.append(len(open_jobs))
        job = open_jobs.pop(0)
        futures[id(job)].set_result(RenderResult(None, np.zeros((0, 1, 1, 3), np.uint8)))

    monkeypatch.setattr(pool.RenderPool, "submit", submit)
    monkeypatch.setattr(pool, "num_cores", lambda: cores)
    # Not `time.sleep` itself: other threads of the process sleep too.
    monkeypatch.setattr(videos, "time", SimpleNamespace(sleep=end_the_first))
    done: list[str] = []
    jobs = {f"{k}.mp4": RenderJob(waving_motion(3)) for k in range(count)}
    results = videos.draw_videos(jobs, lambda part: None, done.append, lambda: False)
    assert list(results) == done == list(jobs)
    assert seen == together
