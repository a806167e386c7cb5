"""Each job once, whatever is killed, and what is told of a process that has ended."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from processes.exit_report import NUM_LINES, ExitReport, informative_log_lines
from processes.job import Cancelled, JobsError
from processes.pool import MAX_BREAKS, JobPool
from tests.helpers import ROOT
from tests.processes.made import (
    cancel,
    done,
    fail,
    kill,
    kill_worker_once,
    leave_python,
    made_job,
    make_jobs,
    run_out_of_memory,
    tell_and_wait,
)
from tests.waiting import wait_for

FRAMES = [f'  File "{name}.py", line 1 in {name}' for name in "abcdefghijkl"]
CRASH = "Fatal Python error: Aborted"
TWO = JobPool(2)
WHY = "terminate called after throwing an instance of 'std::bad_alloc'"


@pytest.mark.parametrize("pool", [JobPool(1), TWO])
def test_each_job_is_done_once_and_one_that_fails_holds_up_no_other(tmp_path, pool):
    jobs = [made_job(tmp_path, "bad", work=fail), *make_jobs(tmp_path, 5)]
    (tmp_path / "log").write_text("job3\n")
    told: list[str] = []
    for _ in range(2):
        failed = pool.run_all(jobs, told.append)
        assert list(failed) == ["bad"] and str(failed["bad"]) == "bad cannot be done"
        assert sorted(told) == ["job0", "job1", "job2", "job4"]
        assert sorted(done(tmp_path)) == sorted(["job3", *told])


@pytest.mark.parametrize("pool", [JobPool(1), TWO])
def test_a_cancelled_job_ends_all_and_no_other_is_begun(tmp_path, pool):
    jobs = [made_job(tmp_path, f"job{number}", work=cancel) for number in range(12)]
    with pytest.raises(Cancelled):
        pool.run_all(jobs)
    assert len(done(tmp_path)) <= (pool.processes or 0)


@pytest.mark.parametrize("pool", [JobPool(1), TWO])
def test_news_of_jobs_come_in_order_and_all_end_when_the_caller_cancels(tmp_path, pool):
    names = [f"job{number}" for number in range(pool.processes)]
    jobs = [
        replace(made_job(tmp_path, name, tell_and_wait), takes_callbacks=True) for name in names
    ]
    told: dict[str, list[int]] = {name: [] for name in names}
    with pytest.raises(Cancelled):
        pool.run_all(
            jobs,
            on_message=lambda name, news: told[name].append(news),
            should_cancel=lambda: all(len(news) == 3 for news in told.values()),
        )
    assert all(news == [0, 1, 2] for news in told.values())


def test_a_killed_worker_costs_no_job(tmp_path):
    jobs = [*make_jobs(tmp_path, 4), made_job(tmp_path, "struck", work=kill_worker_once)]
    told: list[str] = []
    assert TWO.run_all(jobs, told.append) == {}
    assert (tmp_path / "struck.killed").exists()
    assert sorted(told) == sorted({*done(tmp_path)}) == [*(f"job{n}" for n in range(4)), "struck"]
    assert len(done(tmp_path)) == 5


@pytest.mark.parametrize(
    ("work", "words"),
    [
        (kill, [f"ended {MAX_BREAKS} times", "by signal 9 (SIGKILL)", "no lack of memory"]),
        (run_out_of_memory, ["ran out of memory (according to its log); use fewer processes"]),
    ],
)
def test_a_worker_that_always_dies_ends_it_and_says_how(work, words, tmp_path):
    jobs = [made_job(tmp_path, name, work=work) for name in "ab"]
    with pytest.raises(JobsError) as told:
        TWO.run_all(jobs)
    sentence = str(told.value)
    assert all(word in sentence for word in words), sentence
    assert ("fewer processes" in sentence) == (work is run_out_of_memory)


def test_a_job_that_leaves_python_fails_alone(tmp_path):
    jobs = [made_job(tmp_path, "left", work=leave_python), *make_jobs(tmp_path, 2)]
    failed = TWO.run_all(jobs)
    assert list(failed) == ["left"] and "exit status 3" in str(failed["left"])
    assert sorted(done(tmp_path)) == ["job0", "job1"]


def test_after_a_kill_of_all_the_rest_is_done_and_nothing_twice(tmp_path):
    asked = [sys.executable, "-m", "tests.processes.made", str(tmp_path), "2"]
    child = subprocess.Popen(asked, cwd=ROOT)
    wait_for(lambda: len(done(tmp_path)) >= 2)
    workers = children_of(child.pid)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    wait_for(lambda: not any(map(is_at_work, workers)))
    before = done(tmp_path)
    assert 2 <= len(before) < 6
    (tmp_path / "go").touch()
    subprocess.run(asked, cwd=ROOT, check=True)
    assert done(tmp_path)[: len(before)] == before
    assert sorted(done(tmp_path)) == [f"job{n}" for n in range(6)]


def children_of(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_at_work(pid: int) -> bool:
    """Not so one that waits to be counted, which nobody may do."""
    line = Path(f"/proc/{pid}/cmdline")
    return line.exists() and line.read_bytes() != b""


def test_of_a_crash_what_was_said_before_and_where_it_was_are_told():
    log = ["one", "two", "three", WHY, "", CRASH, "", "Thread 0x1:", *FRAMES[:3]]
    log += ["Current thread 0x2:", *FRAMES[3:], "", "Extension modules: numpy (total: 1)"]
    assert informative_log_lines("\n".join(log)) == ("three", WHY, CRASH, *FRAMES[3:8])


def test_want_of_memory_is_found_among_the_frames_of_two_that_crash_at_once():
    log = [WHY, CRASH, "Current thread 0x1:", *FRAMES, CRASH, "Current thread 0x2:", *FRAMES]
    said = informative_log_lines("\n".join(log))
    assert said[0] == WHY and len(said) == NUM_LINES and CRASH in said
    assert ExitReport(-signal.SIGABRT, said).was_out_of_memory
    assert not ExitReport(-signal.SIGSEGV, said).was_out_of_memory


def test_without_a_crash_the_last_lines_are_told():
    assert informative_log_lines("\n".join(FRAMES)) == tuple(FRAMES[-NUM_LINES:])
