"""Jobs in child processes: results, errors, cancellation, and nothing left behind."""

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processes.exit_report import ExitReport
from processes.job import Cancelled
from renderer.body.body import load_body
from renderer.body.body_file import BodyError
from renderer.draw.offscreen import GLError
from renderer.scene.camera_setup import make_camera_setup
from renderer.video.encoder import VideoError
from renderer.video.render import RenderSettings
from renderer.video.workers import MotionRenderJob, run_render_jobs, worker_error
from tests.renderer.drawn import children_that_draw, render_stills
from tests.renderer.scene.test_camera import waving_motion
from tests.renderer.video.test_encoder import (
    decoded_frames,
    processes_that_mention,
    tone,
    write_wav,
)
from tests.waiting import wait_for

pytestmark = pytest.mark.gl

SLOW = pytest.mark.slow


def settings(**changes) -> RenderSettings:
    return RenderSettings(**{"width": 64, "height": 64, **changes})


def has_ended(process_id: int) -> bool:
    """Whether a child waits for nothing but to be counted, and its last thread is gone."""
    process = Path(f"/proc/{process_id}")
    state = (process / "stat").read_text().rsplit(")", 1)[1].split()[0]
    return state == "Z" and len(list((process / "task").iterdir())) == 1


def check_nothing_is_left(folder: Path) -> None:
    assert list(folder.iterdir()) == []
    assert children_that_draw() == []
    wait_for(lambda: not processes_that_mention(folder))  # a child's child is killed, not awaited


def long_job(tmp_path: Path) -> MotionRenderJob:
    return MotionRenderJob(waving_motion(1500), tmp_path / "v.mp4", settings=settings())


def once_drawing(act: Callable[[int], None]) -> Callable[[float], None]:
    """What does something to the only process as soon as it has drawn a frame."""
    done = []

    def on_progress(share: float) -> None:
        if share > 0 and not done:
            done.append(share)
            (child,) = children_that_draw()
            act(child)

    return on_progress


def killed(by: signal.Signals) -> Callable[[float], None]:
    return once_drawing(lambda child: os.kill(child, by))


def test_several_jobs_at_once_equal_the_same_in_this_process(tmp_path, monkeypatch):
    """From a folder of the caller's, one after the other by the same processes; a video shows every
    frame once and in order."""
    monkeypatch.chdir(tmp_path)
    body, motion, far = load_body(), waving_motion(8), waving_motion(8, walk_m=4.0)
    stage = make_camera_setup(body, [motion, far])
    write_wav(tmp_path / "s.wav", tone(0.4))
    first = MotionRenderJob(
        motion, Path("0.mp4"), Path("s.wav"), settings(crf=8), still_frames=(3, 0)
    )
    jobs = {
        0: replace(first, stage=stage),
        1: replace(first, out=Path("1.mp4"), settings=settings(view="side", crf=8)),
        2: replace(first, motion=far, out=None),
        3: replace(first, out=None),
    }
    shares, whole, alive = [], [], []

    def on_done(place: int) -> None:
        whole.append((place, (tmp_path / f"{place}.mp4").exists()))
        alive.append(len(children_that_draw()))

    results = run_render_jobs(jobs, shares.append, on_done)
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert sorted(whole) == [(0, True), (1, True), (2, False), (3, False)]
    assert max(alive) == 2
    for place, job in jobs.items():
        pictures = render_stills(body, job.motion, range(8), job.settings, stage=job.stage)
        # Chunks of other sizes round vertices differently: by one grey level here and there, and
        # a pixel of an outline may be the body's or the ground's.
        away = np.abs(results[place].astype(int) - pictures[[3, 0]]).max(-1)
        assert (away > 1).sum() <= 2
        if job.out is not None:
            frames = decoded_frames(job.out).astype(np.int16)
            distance = np.abs(frames[:, None] - pictures[None]).mean(axis=(2, 3, 4))
            assert distance.argmin(axis=1).tolist() == list(range(8))
    for name in ("s.wav", "0.mp4", "1.mp4"):
        (tmp_path / name).unlink()
    check_nothing_is_left(tmp_path)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"body_path": Path("/nowhere/body.npz")}, BodyError, "no body file"),
        pytest.param({"out": Path("/nowhere/v.mp4")}, VideoError, "not a folder", marks=SLOW),
        pytest.param({"still_frames": (9,)}, ValueError, "Frame 9 is outside", marks=SLOW),
    ],
)
def test_errors_come_back_as_they_were_raised_and_end_the_others(tmp_path, changes, error, message):
    bad = MotionRenderJob(
        waving_motion(2), tmp_path / "b.mp4", settings=settings(), still_frames=(1,)
    )
    with pytest.raises(error, match=message):
        run_render_jobs({"long": long_job(tmp_path), "bad": replace(bad, **changes)})
    check_nothing_is_left(tmp_path)


def test_a_crash_is_an_error_here_and_one_while_idle_is_made_good(tmp_path):
    good = MotionRenderJob(waving_motion(2), settings=settings(), still_frames=(1,))

    def end_it(name: str) -> None:
        (child,) = children_that_draw()
        os.kill(child, signal.SIGKILL)
        wait_for(lambda: has_ended(child))

    assert len(run_render_jobs({"a": good, "b": good}, on_done=end_it, num_parallel=1)) == 2
    with pytest.raises(GLError, match=r"\(SIGSEGV\)\. .*a new process") as told:
        run_render_jobs({"v": long_job(tmp_path)}, killed(signal.SIGSEGV))
    assert "Fatal Python error: Segmentation fault" in str(told.value)
    assert "memory" not in str(told.value) and "\n" not in str(told.value)
    check_nothing_is_left(tmp_path)


def test_a_crash_is_the_drivers_where_there_is_one():
    crash = worker_error(ExitReport(-signal.SIGSEGV))
    assert "most likely cause is the OpenGL driver" in str(crash) and isinstance(crash, GLError)
    left = worker_error(ExitReport(1, ("KeyError: 'x'",)))
    assert not isinstance(left, GLError) and "KeyError" in str(left) and "driver" not in str(left)


def test_whoever_cancels_ends_what_runs_and_what_waits(tmp_path):
    jobs = dict.fromkeys("ab", long_job(tmp_path))
    with pytest.raises(Cancelled):  # once ffmpeg has begun the partial file
        run_render_jobs(jobs, should_cancel=lambda: any(tmp_path.iterdir()), num_parallel=1)
    check_nothing_is_left(tmp_path)
