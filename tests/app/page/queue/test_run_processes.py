"""Runs in processes of their own: limits, cancelling, and what is left after each."""

import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from app.errors import CancelledRun, RunError
from app.page.queue.run_processes import FaultInRunProcess, Limits, RunProcesses
from app.run.diagnose import DiagnoseRequest
from app.run.output.run_folder import read_run
from app.run.requests.request import Event, GenerateRequest, Grown, Progress
from model.motion.motion import save_motion
from processes import ended
from tests.app.page.queue import ends
from tests.helpers import smooth_motion_example

LONGEST = 108_000


def zeros(path: Path, frames: int) -> Path:
    """An hour of nothing, in 100 kB."""
    np.savez_compressed(
        path,
        poses=np.zeros((frames, 165), np.float32),
        trans=np.zeros((frames, 3), np.float32),
        expressions=np.zeros((frames, 100), np.float32),
        betas=np.zeros(300, np.float32),
        mocap_frame_rate=30,
    )
    return path


@pytest.fixture(scope="module")
def processes() -> Iterator[RunProcesses]:
    """One process for all tests that need not end it; whoever ends it leaves another."""
    processes = RunProcesses(limits=Limits(seconds=100))
    yield processes
    processes.close()


def small(tmp_path: Path, name: str = "small", **more: object) -> DiagnoseRequest:
    path = tmp_path / f"{name}.npz"
    save_motion(smooth_motion_example(60), path)
    return DiagnoseRequest((path,), tmp_path / f"{name}-results", has_pictures=False, **more)


def look(
    processes: RunProcesses,
    end: Callable[[], None] = ends.carry_on,
    should_cancel: Callable[[], bool] = lambda: False,
) -> str:
    """A task that needs no library, with that in the middle of it."""
    arguments = ("motion", ends.Ending(end), 1.0)
    return processes.do("refuse", arguments, lambda event: None, should_cancel)


def pid_of(processes: RunProcesses) -> int:
    (process,) = processes._all
    return process.child.pid


def test_a_process_is_kept_and_gives_what_runs_give_their_files_sentences_and_faults(
    processes, weights, speech, tmp_path
):
    shares: list[float] = []
    asked_own = small(tmp_path)
    processes.diagnose(asked_own, shares.append)
    assert read_run(asked_own.out).state == "done"
    assert max(shares) == 1.0
    first = pid_of(processes)
    events: list[Event] = []
    asked = GenerateRequest(
        speech, tmp_path / "out", weights, steps=1, has_video=False, has_figures=False
    )
    processes.generate(asked, events.append, lambda: False)
    done = read_run(asked.out)
    assert all((asked.out / name).is_file() for name in done.named)
    assert {type(event) for event in events} == {Progress, Grown}
    unknown = GenerateRequest(speech, tmp_path / "out", weights, ("globaldiff/none",))
    with pytest.raises(RunError, match="globaldiff/none"):
        processes.generate(unknown, events.append, lambda: False)
    two = small(tmp_path, "two").motions * 2
    long = DiagnoseRequest(two, tmp_path / "long", names=("a", "b"), max_frames=119)
    with pytest.raises(RunError, match="over 119 frames together"):
        processes.diagnose(long, shares.append)
    with pytest.raises(FaultInRunProcess, match="Traceback"):
        processes.do("generate", (None,), events.append, lambda: False)
    assert pid_of(processes) == first


def test_cancel_ends_a_process_that_does_not_hear_it_and_a_successor_is_there_at_once(processes):
    look(processes)
    first, asked = pid_of(processes), iter([False, False])
    with pytest.raises(CancelledRun):
        look(processes, ends.wait, lambda: next(asked, True))
    assert pid_of(processes) != first and look(processes) == ""
    with pytest.raises(CancelledRun):
        look(processes, should_cancel=lambda: True)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (Limits(seconds=0.5), "took longer than the 0 minutes"),
        (Limits(silent_s=0.5), "stopped getting on and was ended after 0 s"),
    ],
)
def test_what_takes_too_long_is_ended(limits, words):
    processes = RunProcesses(limits=limits)
    try:
        with pytest.raises(RunError, match=words):
            look(processes, ends.wait)
    finally:
        processes.close()


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (ends.segfault, ["signal 11 (SIGSEGV)", "Segmentation fault", "fresh process", "report"]),
        (ends.leave_with_3, ["with exit status 3", "the last words of it", "report"]),
        (ends.terminate, ["by signal 15 (SIGTERM), which was sent to it", "start it again"]),
        (ends.kill, ["by signal 9 (SIGKILL)", "tells of no want of memory"]),
        (ends.run_out_of_memory_in_c, ["for want of memory, as its log says", "may take 4.0 GB"]),
        (ends.take_five_gigabytes, ["ran out of memory"]),
    ],
)
def test_a_process_that_dies_says_how_and_the_next_run_goes_well(end, words, processes, capsys):
    """Each ends itself in the middle of its run, but the last, which meets its limit."""
    with pytest.raises(RunError) as told:
        look(processes, end)
    sentence = str(told.value)
    assert all(word in sentence for word in words) and sentence.isprintable(), sentence
    wants_memory = "for want of memory" in sentence or "ran out of memory" in sentence
    assert wants_memory == (end in (ends.run_out_of_memory_in_c, ends.take_five_gigabytes))
    if end is ends.leave_with_3:
        assert "the last words of it" in capsys.readouterr().err, "what it says goes to the log"
    assert look(processes) == ""


def test_memory_is_named_where_the_kernel_has_ended_it(processes, tmp_path, monkeypatch):
    """The counter of a control group rises while the run goes on."""
    (tmp_path / "memory.events").write_text("oom 0\noom_kill 4\n")
    monkeypatch.setattr(ended, "_counters", lambda: iter([tmp_path / "memory.events"]))

    def strike() -> bool:
        if processes._busy:
            (tmp_path / "memory.events").write_text("oom 1\noom_kill 5\n")
            os.kill(pid_of(processes), signal.SIGKILL)
        return False

    with pytest.raises(RunError, match=r"want of memory, as the system says; .* 4\.0 GB"):
        look(processes, ends.wait, strike)


@pytest.mark.slow
def test_a_successor_is_warm_and_work_that_is_there_is_done_before_models_are_read(
    weights, tmp_path
):
    never = tmp_path / "weights"
    shutil.copytree(weights, never)
    for path in never.glob("*.safetensors"):
        path.unlink()
        os.mkfifo(path)  # whoever reads it waits for ever
    processes = RunProcesses(limits=Limits(seconds=100.0), warm=(never, None))
    processes.start()
    try:
        assert processes.diagnose(small(tmp_path), lambda share: None).files
    finally:
        processes.close()
