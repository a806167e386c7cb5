"""The same on a Dask cluster of this machine: a scheduler and workers that are killed."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from processes import pool
from processes.job import JobsError
from processes.pool import JobPool
from tests.helpers import ROOT
from tests.processes.made import done, fail, made_job, make_jobs
from tests.waiting import wait_for

distributed = pytest.importorskip(
    "distributed", reason="Dask is not installed (requirements-cluster.txt)"
)


@contextmanager
def dask(part: str, *arguments: str) -> Iterator[subprocess.Popen]:
    """A scheduler or a worker, as ``dask scheduler`` and ``dask worker`` start them."""
    command = [sys.executable, "-m", f"distributed.cli.dask_{part}", *arguments]
    child = subprocess.Popen(
        command, cwd=ROOT, stderr=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    try:
        yield child
    finally:
        child.terminate()
        child.wait()


@contextmanager
def scheduler(folder: Path) -> Iterator[tuple[subprocess.Popen, str]]:
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    local = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    with dask("scheduler", *local, "--scheduler-file", str(file)) as child:
        wait_for(file.is_file)
        yield child, str(file)


@contextmanager
def workers(file: str, count: int) -> Iterator[list[subprocess.Popen]]:
    own = ("--scheduler-file", file, "--nthreads", "1", "--no-nanny", "--no-dashboard")
    with ExitStack() as stack:
        yield [stack.enter_context(dask("worker", *own)) for _ in range(count)]


def test_a_cluster_does_each_job_once_and_tells_of_one_that_fails(tmp_path):
    jobs = [made_job(tmp_path, "bad", work=fail), *make_jobs(tmp_path, 4)]
    (tmp_path / "log").write_text("job2\n")
    told: list[str] = []
    here = {"n_workers": 1, "threads_per_worker": 2, "processes": False, "protocol": "tcp"}
    with distributed.LocalCluster(**here, dashboard_address=None) as local:
        failed = JobPool(scheduler=local.scheduler_address).run_all(jobs, told.append)
    assert list(failed) == ["bad"] and "bad cannot be done" in str(failed["bad"]), failed
    assert sorted(told) == ["job0", "job1", "job3"]
    assert sorted(done(tmp_path)) == sorted(["job2", *told])


@pytest.mark.slow
def test_a_killed_worker_costs_no_job_and_none_is_done_twice(tmp_path):
    told: list[str] = []
    with scheduler(tmp_path) as (_, file), workers(file, 2) as (struck, _):
        jobs = [*make_jobs(tmp_path, 6, are_held=True), made_job(tmp_path, "bad", work=fail)]

        def strike() -> None:
            wait_for(lambda: len(done(tmp_path)) >= 2)
            os.kill(struck.pid, signal.SIGKILL)
            (tmp_path / "go").touch()

        threading.Thread(target=strike, daemon=True).start()
        failed = JobPool(scheduler=file).run_all(jobs, told.append)
        assert struck.wait() == -signal.SIGKILL
    assert list(failed) == ["bad"] and "bad cannot be done" in str(failed["bad"]), failed
    assert sorted(told) == sorted(done(tmp_path)) == [f"job{n}" for n in range(6)]


@pytest.mark.slow
def test_after_a_kill_of_the_scheduler_a_sentence_says_so_and_the_same_call_goes_on(tmp_path):
    with scheduler(tmp_path) as (head, file), workers(file, 1):
        child = subprocess.Popen(
            [sys.executable, "-m", "tests.processes.made", str(tmp_path), file],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
        )
        wait_for(lambda: len(done(tmp_path)) >= 2)
        os.kill(head.pid, signal.SIGKILL)
        said = child.communicate(timeout=60)[1]
        (tmp_path / "go").touch()
    assert child.returncode == 1
    assert said.startswith("The Dask scheduler at ") and said.count("\n") == 1, said
    assert "is gone; start one again" in said
    before = done(tmp_path)
    assert 2 <= len(before) < 6
    with scheduler(tmp_path) as (_, file), workers(file, 1):
        assert JobPool(scheduler=file).run_all(make_jobs(tmp_path, 6)) == {}
    assert done(tmp_path)[: len(before)] == before
    assert sorted(done(tmp_path)) == [f"job{n}" for n in range(6)]


def test_without_a_scheduler_a_sentence_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "CONNECT_S", 1)
    with pytest.raises(JobsError, match=r"No Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        JobPool(scheduler="tcp://127.0.0.1:9").run_all(make_jobs(tmp_path, 1))
