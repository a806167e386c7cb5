"""Jobs in child processes: results, errors, cancellation, and nothing left behind."""

import os
import signal
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processes import ended
from processes.ended import Ended
from renderer.body.body import load_body
from renderer.body.body_file import BodyError
from renderer.draw.offscreen import GLError
from renderer.scene.stage import set_stage
from renderer.video.encoder import Cancelled, VideoError, read_facts
from renderer.video.parallel import processes_worth
from renderer.video.pool import RenderPool
from renderer.video.render import PIECE_FRAMES, render_stills
from renderer.video.settings import RenderSettings
from renderer.video.worker_process import RenderJob, failure
from tests.processes.made import wait_for
from tests.renderer.scene.test_camera import waving_motion
from tests.renderer.video.test_encoder import processes_that_mention, tone, write_wav

pytestmark = pytest.mark.gl

PATIENCE_S = 60.0
SLOW = pytest.mark.slow


def settings(**changes) -> RenderSettings:
    return RenderSettings(**{"width": 64, "height": 64, **changes})


def children_of(process_id: int, module: bytes = b"renderer.video.worker_child") -> list[int]:
    """Those that run a module of ours; other tests draw beside this one."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = (entry / "stat").read_text().rsplit(")", 1)[1].split()[1]
            command = (entry / "cmdline").read_bytes()
        except OSError:  # it has just ended
            continue
        if int(parent) == process_id and module in command.split(b"\0"):
            found.append(int(entry.name))
    return found


def has_ended(process_id: int) -> bool:
    """Whether a child waits for nothing but to be counted, and its last thread is gone."""
    process = Path(f"/proc/{process_id}")
    state = (process / "stat").read_text().rsplit(")", 1)[1].split()[0]
    return state == "Z" and len(list((process / "task").iterdir())) == 1


def check_nothing_is_left(folder: Path) -> None:
    assert list(folder.iterdir()) == []
    assert children_of(os.getpid()) == []
    assert processes_that_mention(folder) == []


def long_job(tmp_path: Path) -> RenderJob:
    return RenderJob(waving_motion(1500), tmp_path / "v.mp4", settings=settings())


def started(pool: RenderPool, job: RenderJob) -> tuple:
    """A job that has drawn a frame, and the process that does it."""
    running = threading.Event()
    task = pool.submit(job, lambda share: running.set())
    assert running.wait(PATIENCE_S)
    (child,) = children_of(os.getpid())
    return task, child


def test_several_jobs_at_once_equal_the_same_in_this_process(tmp_path, monkeypatch):
    """From a folder of the caller's, one after the other by the same processes."""
    monkeypatch.chdir(tmp_path)
    body, motions = load_body(), [waving_motion(8), waving_motion(8, walk_m=0.4)]
    stage = set_stage(body, motions)
    write_wav(tmp_path / "s.wav", tone(0.4))
    shares: list[float] = []
    first = RenderJob(motions[0], Path("0.mp4"), Path("s.wav"), settings(), still_frames=(3,))
    jobs = [
        replace(first, stage=stage),
        replace(first, motion=motions[1], out=Path("1.mp4"), stage=stage),
        replace(first, settings=settings(view="side"), out=Path("2.mp4")),
        replace(first, motion=waving_motion(4, walk_m=4.0), out=None, still_frames=(3, 0)),
    ]
    with RenderPool(max_workers=2) as pool:
        tasks = [
            pool.submit(job, None if place else shares.append) for place, job in enumerate(jobs)
        ]
        results = [task.result(PATIENCE_S) for task in tasks]
        assert len(children_of(os.getpid())) == 2
    for job, result in zip(jobs, results, strict=True):
        frames = list(job.still_frames)
        expected = render_stills(body, job.motion, frames, job.settings, stage=job.stage)
        # chunks of other sizes round vertices differently, by one grey level here and there
        assert np.abs(result.stills.astype(int) - expected.astype(int)).max() <= 1
        assert result.out == (job.out and tmp_path / job.out)
        assert job.out is None or read_facts(result.out).num_frames == 8
    np.testing.assert_allclose(shares, np.arange(1, 9) / 8)
    for name in ("s.wav", "0.mp4", "1.mp4", "2.mp4"):
        (tmp_path / name).unlink()
    check_nothing_is_left(tmp_path)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"body_path": Path("/nowhere/body.npz")}, BodyError, "no body file"),
        pytest.param({"out": Path("/nowhere/v.mp4")}, VideoError, "not a folder", marks=SLOW),
        pytest.param({"still_frames": (9,)}, ValueError, "Frame 9 was asked", marks=SLOW),
    ],
)
def test_errors_come_back_as_they_were_raised_and_their_process_is_replaced(
    tmp_path, changes, error, message
):
    good = RenderJob(waving_motion(2), settings=settings(), still_frames=(1,))
    with RenderPool(max_workers=1) as pool:
        with pytest.raises(error, match=message):
            pool.submit(replace(good, **{"out": tmp_path / "v.mp4", **changes})).result(PATIENCE_S)
        assert children_of(os.getpid()) == []
        pool.submit(good).result(PATIENCE_S)
    check_nothing_is_left(tmp_path)


def test_a_crash_is_an_error_here_and_one_while_idle_is_made_good(tmp_path):
    good = RenderJob(waving_motion(2), settings=settings(), still_frames=(1,))
    with RenderPool(max_workers=1) as pool:
        pool.submit(good).result(PATIENCE_S)
        (first,) = children_of(os.getpid())
        os.kill(first, signal.SIGKILL)
        wait_for(lambda: has_ended(first))
        task, child = started(pool, long_job(tmp_path))
        assert child != first
        os.kill(child, signal.SIGSEGV)
        with pytest.raises(GLError, match=r"\(SIGSEGV\)\. .*fresh process") as told:
            task.result(PATIENCE_S)
    assert "Fatal Python error: Segmentation fault" in str(told.value)
    assert "memory" not in str(told.value) and "\n" not in str(told.value)
    check_nothing_is_left(tmp_path)


def test_a_crash_is_the_drivers_where_there_is_one():
    crash = Ended(-signal.SIGSEGV)
    assert "most likely the OpenGL driver" in str(failure("It", crash))
    assert isinstance(failure("It", crash), GLError)
    left = failure("It", Ended(1, ("KeyError: 'x'",)))
    assert not isinstance(left, GLError) and "KeyError" in str(left) and "driver" not in str(left)


@pytest.mark.parametrize(
    ("kills", "words"),
    [
        (1, "want of memory, as the system"),
        pytest.param(0, "tells of no want of memory", marks=SLOW),
    ],
)
def test_a_child_that_is_killed_lacks_memory_only_where_the_system_says_so(
    tmp_path, monkeypatch, kills, words
):
    counter = tmp_path / "memory.events"
    counter.write_text("oom_kill 0\n")
    monkeypatch.setattr(ended, "_counters", lambda: iter([counter]))
    with RenderPool(max_workers=1) as pool:
        task, child = started(pool, long_job(tmp_path))
        counter.write_text(f"oom_kill {kills}\n")
        os.kill(child, signal.SIGKILL)
        with pytest.raises(GLError, match=rf"signal 9 \(SIGKILL\).*{words}"):
            task.result(PATIENCE_S)


def test_an_error_in_the_block_ends_what_runs_and_what_waits(tmp_path):
    with pytest.raises(KeyboardInterrupt), RenderPool(max_workers=1) as pool:
        task, _ = started(pool, long_job(tmp_path))
        waiting = pool.submit(long_job(tmp_path))
        wait_for(lambda: list(tmp_path.iterdir()))  # the partial file
        raise KeyboardInterrupt
    for each in (task, waiting):
        with pytest.raises(Cancelled):
            each.result(PATIENCE_S)
    check_nothing_is_left(tmp_path)


def test_several_processes_make_the_same_file_as_one(tmp_path):
    motion = waving_motion(2 * PIECE_FRAMES + 1, walk_m=4.0)  # the camera follows
    job = RenderJob(motion, tmp_path / "1.mp4", settings=settings(), still_frames=(0, 20, 32))
    jobs, shares = [], []
    for count in (1, 2):
        jobs.append(replace(job, out=tmp_path / f"{count}.mp4", num_processes=count))
    with RenderPool(max_workers=1) as pool:
        one, two = (pool.submit(job, shares.append).result(PATIENCE_S) for job in jobs)
    np.testing.assert_allclose(shares, np.tile(np.arange(1, 34) / 33, 2))
    assert one.out.read_bytes() == two.out.read_bytes()
    np.testing.assert_array_equal(one.stills, two.stills)


@pytest.mark.parametrize(
    ("num_frames", "cores", "processes"),
    [(1, 8, 1), (599, 8, 1), (600, 8, 2), (9000, 3, 3), (9000, 64, 4)],
)
def test_a_further_process_has_to_be_worth_its_start(num_frames, cores, processes):
    assert processes_worth(num_frames, cores) == processes


def draws(process_id: int) -> bool:
    """Whether it draws a share of a video still."""
    try:
        return b"renderer.video.parallel" in Path(f"/proc/{process_id}/cmdline").read_bytes()
    except OSError:  # it has ended
        return False


@pytest.mark.parametrize(
    "end",
    ["kill the leader", pytest.param("cancel", marks=SLOW), pytest.param("crash", marks=SLOW)],
)
def test_processes_that_share_a_video_end_together(tmp_path, end):
    with suppress(KeyboardInterrupt), RenderPool() as pool:
        task, leader = started(pool, replace(long_job(tmp_path), num_processes=2))
        painters = children_of(leader, b"renderer.video.parallel")
        assert len(painters) == 2
        if end == "cancel":
            raise KeyboardInterrupt
        os.kill(painters[0] if end == "crash" else leader, signal.SIGKILL)
    with pytest.raises(Cancelled if end == "cancel" else GLError):
        task.result(PATIENCE_S)
    wait_for(lambda: not any(map(draws, painters)))
    check_nothing_is_left(tmp_path)
