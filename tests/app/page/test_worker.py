"""Tasks in processes of their own: limits, cancelling, and what is left after each."""

import os
import resource
import shutil
import signal
from collections.abc import Iterator

import pytest

from app import text
from app.errors import Cancelled, RunError, WorkerError, message_for_user, visitor_message
from app.page.worker import TaskLimits, Worker
from app.run.callbacks import FolderUpdated, RunCallbacks, RunEvent, StageProgress
from processes import exit_report
from tests.app.page import ends
from tests.processes.made import kill, run_out_of_memory


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    """One process for all tests that need not end it; whoever ends it leaves another."""
    worker = Worker(limits=TaskLimits(run_s=100))
    yield worker
    worker.close()


def pid_of(worker: Worker) -> int:
    assert worker._child is not None
    return worker._child.pid


def test_a_process_is_kept_and_gives_what_tasks_give_their_files_sentences_and_faults(
    worker, tmp_path
):
    events: list[RunEvent] = []
    assert worker.do(ends.leave, tmp_path / "left", RunCallbacks(events.append)).is_file()
    assert events == [StageProgress("numbers", 0.5), FolderUpdated(tmp_path)]
    first = pid_of(worker)
    with pytest.raises(RunError, match=r"^It is no <good>\.$"):
        worker.do(ends.say_no, "")
    with pytest.raises(WorkerError, match="Traceback") as fault:
        worker.do(ends.fail, "")
    assert worker.do(ends.carry_on, "said") == "said" and pid_of(worker) == first
    assert message_for_user(fault.value) is None


def test_a_process_that_has_grown_is_replaced_after_a_task_that_failed_too(worker, monkeypatch):
    worker.do(ends.carry_on, "")
    first = pid_of(worker)
    monkeypatch.setattr("app.page.worker.GROWN_BYTES", 2 * 10**7)
    with pytest.raises(RunError, match="has grown"):
        worker.do(ends.grow_and_say_no, "")
    assert pid_of(worker) != first


def test_a_full_disk_is_told_to_visitors_as_such_and_to_the_command_line_with_its_folder(
    worker, tmp_path
):
    for task, words in (
        (ends.find_no_room, "at /results is full"),
        (ends.require_room, f"at {tmp_path} has"),
    ):
        with pytest.raises(RunError, match=words) as full:
            worker.do(task, tmp_path)
        assert visitor_message(full.value) == text.DISK_FULL


def test_a_visitor_is_told_a_number_of_a_fault_and_the_log_where_it_was(worker, caplog):
    with pytest.raises(WorkerError) as fault:
        worker.do(ends.fail, "")
    sentence = visitor_message(fault.value)
    assert "Traceback" not in sentence and "somebody" not in sentence and "\n" not in sentence
    (logged,) = caplog.messages
    assert logged.split()[-1] in sentence
    assert "OverflowError" in caplog.text and "in fail" in caplog.text


def test_cancel_ends_a_process_that_does_not_hear_it_and_a_successor_is_there_at_once(
    worker, monkeypatch
):
    monkeypatch.setattr("app.page.worker.GRACE_S", 0.5)
    worker.do(ends.carry_on, "")
    first, asked = pid_of(worker), iter([False] * 3)
    with pytest.raises(Cancelled):
        worker.do(ends.wait, "", RunCallbacks(should_cancel=lambda: next(asked, True)))
    assert pid_of(worker) != first and worker.do(ends.carry_on, "said") == "said"
    with pytest.raises(Cancelled):
        worker.do(ends.carry_on, "", RunCallbacks(should_cancel=lambda: True))


def test_a_cancel_that_comes_with_the_work_is_heard(worker, monkeypatch):
    monkeypatch.setattr("app.page.worker.GRACE_S", 60.0)  # however busy the machine
    worker.do(ends.carry_on, "")
    first = pid_of(worker)
    for _ in range(20):
        asked = iter([False])
        worker.do(
            ends.wait_for_stop,
            "",
            RunCallbacks(should_cancel=lambda asked=asked: next(asked, True)),
        )
    assert pid_of(worker) == first


def test_only_the_process_that_is_to_be_nice_is():
    polite = Worker(niceness=19)
    try:
        assert polite.do(ends.niceness, "") == 19
        assert os.getpriority(os.PRIO_PROCESS, 0) < 19
        pid = pid_of(polite)
        assert os.getpgid(pid) == pid and os.getsid(pid) == os.getsid(0), "or it has a like share"
    finally:
        polite.close()


def test_a_hard_limit_of_memory_is_kept_to():
    """As of a cluster's job or a container, where only the system's owner may raise it."""
    worker, hard = Worker(), 2 * 10**9
    try:
        worker.start()
        resource.prlimit(pid_of(worker), resource.RLIMIT_DATA, (hard, hard))
        for _ in range(2):
            assert worker.do(ends.data_limits, "") == (hard, hard)
    finally:
        worker.close()


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (TaskLimits(run_s=0.5), "exceeded the limit of 0 minutes"),
        (TaskLimits(no_progress_s=0.5), "made no progress for 0 s"),
    ],
)
def test_what_takes_too_long_is_ended(limits, words):
    worker = Worker(limits=limits)
    try:
        with pytest.raises(RunError, match=words):
            worker.do(ends.wait, "")
    finally:
        worker.close()


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (ends.segfault, ["signal 11 (SIGSEGV)", "Segmentation fault", "new process", "report"]),
        (ends.leave_with_3, ["with exit status 3", "the last words of it", "report"]),
        (
            ends.terminate,
            ["by signal 15 (SIGTERM), which another program sent", "start the run again"],
        ),
        (kill, ["by signal 9 (SIGKILL)", "reports no lack of memory"]),
        (run_out_of_memory, ["ran out of memory (according to its log)", "are limited to 4.0 GB"]),
        (ends.take_five_gigabytes, ["ran out of memory"]),
    ],
)
def test_a_process_that_dies_says_how_and_the_next_task_goes_well(end, words, worker, capsys):
    """Each ends itself in the middle of its run, but the last, which meets its limit."""
    with pytest.raises(RunError) as told:
        worker.do(end, "")
    sentence = str(told.value)
    assert all(word in sentence for word in words) and sentence.isprintable(), sentence
    wants_memory = "ran out of memory" in sentence
    assert wants_memory == (end in (run_out_of_memory, ends.take_five_gigabytes))
    if end is ends.leave_with_3:
        assert "the last words of it" in capsys.readouterr().err, "what it says goes to the log"
    assert worker.do(ends.carry_on, "said") == "said"


def test_memory_is_named_where_the_kernel_has_ended_it(worker, tmp_path, monkeypatch):
    """The counter of a control group rises while the run goes on."""
    (tmp_path / "memory.events").write_text("oom 0\noom_kill 4\n")
    monkeypatch.setattr(exit_report, "_counters", lambda: iter([tmp_path / "memory.events"]))

    def strike() -> bool:
        if worker._turn.locked():
            (tmp_path / "memory.events").write_text("oom 1\noom_kill 5\n")
            os.kill(pid_of(worker), signal.SIGKILL)
        return False

    with pytest.raises(RunError, match=r"out of memory \(according to the system\); .* 4\.0 GB"):
        worker.do(ends.wait, "", RunCallbacks(should_cancel=strike))


@pytest.mark.slow
def test_a_successor_is_warm_and_work_that_is_there_is_done_before_models_are_read(
    weights, tmp_path
):
    never = tmp_path / "weights"
    shutil.copytree(weights, never)
    for path in never.glob("*.safetensors"):
        path.unlink()
        os.mkfifo(path)  # whoever reads it waits for ever
    worker = Worker(limits=TaskLimits(run_s=100.0), warm=(never, None))
    worker.start()
    try:
        assert worker.do(ends.carry_on, "said") == "said"
    finally:
        worker.close()
