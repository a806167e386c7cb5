"""Jobs in child processes: results, errors, cancellation, and nothing left behind."""

import os
import signal
import threading
import time
from collections.abc import Callable
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
from renderer.draw.probe import choose_backend
from renderer.scene.stage import set_stage
from renderer.video.encoder import Cancelled, VideoError, read_facts
from renderer.video.parallel import processes_worth
from renderer.video.pool import RenderPool
from renderer.video.render import PIECE_FRAMES, render_stills
from renderer.video.settings import RenderSettings
from renderer.video.worker_process import RenderJob, RenderResult, failure
from tests.renderer.scene.test_camera import waving_motion
from tests.renderer.video.test_encoder import processes_that_mention, tone, write_wav

pytestmark = pytest.mark.gl

PATIENCE_S = 300.0
"""A busy machine may be slow to start a process; a test that hangs still ends."""


def run_job(job: RenderJob, on_progress: Callable[[float], None] | None = None) -> RenderResult:
    with RenderPool(max_workers=1) as pool:
        return pool.submit(job, on_progress).result()


def settings() -> RenderSettings:
    return RenderSettings(width=96, height=96, backend=choose_backend())


def test_several_jobs_at_once_equal_the_same_in_this_process(tmp_path):
    body, motions = load_body(), [waving_motion(12), waving_motion(12, walk_m=0.4)]
    stage = set_stage(body, motions)
    wav = write_wav(tmp_path / "s.wav", tone(0.4))
    shares: list[float] = []
    with RenderPool(max_workers=2) as pool:
        tasks = [
            pool.submit(
                RenderJob(
                    *(motion, tmp_path / f"{i}.mp4", wav, settings()),
                    stage=stage,
                    still_frames=(3,),
                ),
                shares.append if i == 0 else None,
            )
            for i, motion in enumerate(motions)
        ]
        results = [task.result(PATIENCE_S) for task in tasks]
    for i, (motion, result) in enumerate(zip(motions, results, strict=True)):
        expected = render_stills(body, motion, [3], settings(), stage=stage)
        # chunks of other sizes round vertices differently, by one grey level here and there
        assert np.abs(result.stills.astype(int) - expected.astype(int)).max() <= 1
        assert result.out == tmp_path / f"{i}.mp4"
        assert read_facts(result.out).num_frames == 12
    np.testing.assert_allclose(shares, np.arange(1, 13) / 12)
    assert processes_that_mention(tmp_path) == []


def test_relative_paths_mean_the_callers_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_wav(tmp_path / "s.wav", tone(0.2))
    run_job(RenderJob(waving_motion(3), Path("v.mp4"), Path("s.wav"), settings()))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.wav", "v.mp4"]


def test_stills_alone_need_no_file():
    motion = waving_motion(9)
    result = run_job(RenderJob(motion, settings=settings(), still_frames=(8, 0)))
    assert result.out is None
    np.testing.assert_array_equal(
        result.stills, render_stills(load_body(), motion, [8, 0], settings())
    )


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"out": Path("/nowhere/v.mp4")}, VideoError, "/nowhere is not a folder"),
        ({"body_path": Path("/nowhere/body.npz")}, BodyError, "no body file"),
        ({"still_frames": (99,)}, ValueError, "Frame 99 was asked for; the motion has 5"),
    ],
)
def test_errors_come_back_as_they_were_raised(changes, error, message):
    with pytest.raises(error, match=message):
        run_job(RenderJob(motion=waving_motion(5), settings=settings(), **changes))


def children_of_this_process() -> list[int]:
    return children_of(os.getpid(), b"renderer.video.worker_child")


def children_of(process_id: int, module: bytes) -> list[int]:
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


def long_job(tmp_path: Path) -> RenderJob:
    return RenderJob(waving_motion(4000), tmp_path / "v.mp4", settings=settings())


@pytest.mark.parametrize("after_progress", [True, False])
def test_an_error_in_the_block_leaves_no_file_and_no_process(tmp_path, after_progress):
    running = threading.Event()
    with pytest.raises(KeyboardInterrupt), RenderPool() as pool:
        task = pool.submit(long_job(tmp_path), lambda share: running.set())
        if after_progress:
            assert running.wait(PATIENCE_S)
            while not list(tmp_path.iterdir()):  # the partial file
                time.sleep(0.01)
        else:
            while not children_of_this_process():
                time.sleep(0.01)
        raise KeyboardInterrupt
    with pytest.raises(Cancelled):
        task.result(PATIENCE_S)
    assert list(tmp_path.iterdir()) == []
    assert children_of_this_process() == []
    assert processes_that_mention(tmp_path) == []


def test_a_job_cancelled_before_it_starts_never_runs(tmp_path):
    with pytest.raises(KeyboardInterrupt), RenderPool(max_workers=1) as pool:
        tasks = [pool.submit(long_job(tmp_path)) for _ in range(2)]
        raise KeyboardInterrupt
    for task in tasks:
        with pytest.raises(Cancelled):
            task.result(PATIENCE_S)
    assert list(tmp_path.iterdir()) == []


def test_a_crash_in_the_child_is_an_error_here(tmp_path):
    running = threading.Event()
    with RenderPool() as pool:
        task = pool.submit(long_job(tmp_path), lambda share: running.set())
        assert running.wait(PATIENCE_S)
        (child,) = children_of_this_process()
        os.kill(child, signal.SIGSEGV)
        with pytest.raises(GLError, match=r"\(SIGSEGV\)\. .*fresh process") as told:
            task.result(PATIENCE_S)
    assert "Fatal Python error: Segmentation fault" in str(told.value)
    assert "memory" not in str(told.value) and "\n" not in str(told.value)
    assert list(tmp_path.iterdir()) == []
    assert processes_that_mention(tmp_path) == []


def test_a_crash_is_the_drivers_where_there_is_one():
    crash = Ended(-signal.SIGSEGV)
    assert "most likely the OpenGL driver" in str(failure("It", crash, "egl"))
    assert "driver" not in str(failure("It", crash, "software"))
    assert isinstance(failure("It", crash, "software"), GLError)
    left = failure("It", Ended(1, ("KeyError: 'x'",)), "egl")
    assert not isinstance(left, GLError) and "KeyError" in str(left) and "driver" not in str(left)


def test_a_child_that_is_killed_lacks_memory_only_where_the_system_says_so(tmp_path, monkeypatch):
    counter = tmp_path / "memory.events"
    counter.write_text("oom_kill 0\n")
    monkeypatch.setattr(ended, "_counters", lambda: iter([counter]))
    for kills, words in enumerate(("tells of no want of memory", "want of memory, as the system")):
        running = threading.Event()
        with RenderPool(max_workers=1) as pool:
            task = pool.submit(long_job(tmp_path), lambda share, running=running: running.set())
            assert running.wait(PATIENCE_S)
            (child,) = children_of_this_process()
            counter.write_text(f"oom_kill {kills}\n")
            os.kill(child, signal.SIGKILL)
            with pytest.raises(GLError, match=r"signal 9 \(SIGKILL\)") as told:
                task.result(PATIENCE_S)
        assert words in str(told.value)


def test_one_process_draws_one_video_after_the_other(tmp_path):
    body, seen = load_body(), set()
    jobs = [
        RenderJob(
            motion=waving_motion(4, walk_m=walk_m),
            out=tmp_path / f"{view}.mp4",
            settings=RenderSettings(width, 96, view=view),
            still_frames=(2,),
        )
        for view, width, walk_m in (("front", 96, 0.0), ("side", 64, 0.0), ("front", 128, 4.0))
    ]
    with RenderPool(max_workers=1) as pool:
        for job in jobs:
            task = pool.submit(job, lambda share: seen.update(children_of_this_process()))
            shown = task.result(PATIENCE_S).stills
            alone = render_stills(body, job.motion, [2], job.settings)
            assert np.abs(shown.astype(int) - alone.astype(int)).max() <= 1
        assert len(seen) == 1
        assert set(children_of_this_process()) == seen
    assert children_of_this_process() == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["front.mp4", "side.mp4"]


@pytest.mark.parametrize("end", ["error", "crash while idle"])
def test_a_process_that_came_to_a_bad_end_is_replaced(tmp_path, end):
    good = RenderJob(waving_motion(2), tmp_path / "good.mp4", settings=settings())
    with RenderPool(max_workers=1) as pool:
        pool.submit(good).result(PATIENCE_S)
        (first,) = children_of_this_process()
        if end == "error":
            with pytest.raises(ValueError, match="Frame 9 was asked for"):
                pool.submit(replace(good, still_frames=(9,))).result(PATIENCE_S)
        else:
            os.kill(first, signal.SIGKILL)
            while not has_ended(first):
                time.sleep(0.01)
        (tmp_path / "good.mp4").unlink()
        pool.submit(good).result(PATIENCE_S)
        (second,) = children_of_this_process()
        assert second != first
    assert [path.name for path in tmp_path.iterdir()] == ["good.mp4"]
    assert children_of_this_process() == []


def test_several_processes_make_the_same_file_as_one(tmp_path):
    motion = waving_motion(2 * PIECE_FRAMES + 5, walk_m=4.0)  # the camera follows
    results = []
    for count in (1, 2):
        out, shares = tmp_path / f"{count}.mp4", []
        job = RenderJob(
            *(motion, out), settings=settings(), still_frames=(0, 20, 36), num_processes=count
        )
        results.append(run_job(job, shares.append))
        np.testing.assert_allclose(shares, np.arange(1, 38) / 37)
        assert out.read_bytes() == (tmp_path / "1.mp4").read_bytes()
        np.testing.assert_array_equal(results[-1].stills, results[0].stills)


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


@pytest.mark.parametrize("end", ["cancel", "crash", "kill the leader"])
def test_processes_that_share_a_video_end_together(tmp_path, end):
    running = threading.Event()
    job = replace(long_job(tmp_path), num_processes=2)
    with suppress(KeyboardInterrupt), RenderPool() as pool:
        task = pool.submit(job, lambda share: running.set())
        assert running.wait(PATIENCE_S)
        (leader,) = children_of_this_process()
        painters = children_of(leader, b"renderer.video.parallel")
        assert len(painters) == 2
        if end == "cancel":
            raise KeyboardInterrupt
        os.kill(painters[0] if end == "crash" else leader, signal.SIGKILL)
    with pytest.raises(Cancelled if end == "cancel" else GLError):
        task.result(PATIENCE_S)
    deadline = time.monotonic() + 20
    while any(map(draws, painters)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(draws, painters))
    assert list(tmp_path.iterdir()) == []
    assert processes_that_mention(tmp_path) == []
