"""Runs in processes of their own: limits, cancelling, and what is left after each."""

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from app.errors import CancelledRun, RunError
from app.page.queue.run_processes import FaultInRunProcess, Limits, RunProcesses
from app.run.diagnose import DiagnoseRequest
from app.run.requests.request import Artefact, Event, GenerateRequest, Progress
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
def hours(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    folder = tmp_path_factory.mktemp("hours")
    first = zeros(folder / "0.npz", LONGEST)
    others = [folder / f"{number}.npz" for number in range(1, 6)]
    for other in others:
        other.write_bytes(first.read_bytes())
    return (first, *others)


@pytest.fixture
def processes() -> Iterator[RunProcesses]:
    processes = RunProcesses(limits=Limits(seconds=300))
    yield processes
    processes.close()


def small(tmp_path: Path, name: str = "small") -> DiagnoseRequest:
    path = tmp_path / f"{name}.npz"
    save_motion(smooth_motion_example(60), path)
    return DiagnoseRequest((path,), tmp_path / f"{name}-results", has_pictures=False)


def look(processes: RunProcesses, end: Callable[[], None]) -> str:
    """A task that needs no library, with that in the middle of it."""
    return processes.do(
        "refuse", ("motion", ends.Ending(end), 1.0), lambda event: None, lambda: False
    )


def pid_of(processes: RunProcesses) -> int:
    (process,) = processes._all
    return process.child.pid


def test_a_process_is_kept_and_gives_what_the_run_gives(
    processes: RunProcesses, tmp_path: Path
) -> None:
    shares: list[float] = []
    diagnosis = processes.diagnose(small(tmp_path), shares.append)
    assert all(path.is_file() for path in diagnosis.files) and max(shares) == 1.0
    first = pid_of(processes)
    processes.diagnose(small(tmp_path, "again"), lambda share: None)
    assert pid_of(processes) == first


def test_a_killed_process_has_a_warm_successor_before_the_next_run(
    weights: Path, hours: tuple[Path, ...], tmp_path: Path
) -> None:
    processes = RunProcesses(warm=(weights, None))
    processes.start()
    first = pid_of(processes)
    asked = 0

    def on_share(share: float) -> None:
        nonlocal asked
        asked += 1
        if asked > 10:
            os.kill(first, signal.SIGSTOP)  # a process that hears of it in time is kept
            raise CancelledRun

    try:
        with pytest.raises(CancelledRun):
            processes.diagnose(DiagnoseRequest(hours, tmp_path / "out"), on_share)
        assert pid_of(processes) != first
        assert processes.diagnose(small(tmp_path), lambda share: None).files
    finally:
        processes.close()


def test_work_that_is_there_is_done_before_models_are_read(weights: Path, tmp_path: Path) -> None:
    never = tmp_path / "weights"
    shutil.copytree(weights, never)
    for path in never.glob("*.safetensors"):
        path.unlink()
        os.mkfifo(path)  # whoever reads it waits for ever
    processes = RunProcesses(limits=Limits(seconds=120.0), warm=(never, None))
    processes.start()
    try:
        assert processes.diagnose(small(tmp_path), lambda share: None).files
    finally:
        processes.close()


def test_six_hours_of_zeros_are_refused_by_their_frames(
    processes: RunProcesses, hours: tuple[Path, ...], tmp_path: Path
) -> None:
    request = DiagnoseRequest(hours, tmp_path / "out", max_frames=LONGEST, has_pictures=False)
    with pytest.raises(RunError, match="over 108000 frames together"):
        processes.diagnose(request, lambda share: None)


def test_cancel_is_heard_within_two_seconds_whatever_goes_on(
    processes: RunProcesses, hours: tuple[Path, ...], tmp_path: Path
) -> None:
    cancelled = threading.Event()
    pressed = 0.0

    def press() -> None:
        nonlocal pressed
        pressed = time.monotonic()
        cancelled.set()

    def on_share(share: float) -> None:
        if cancelled.is_set():
            raise CancelledRun

    processes.diagnose(small(tmp_path), lambda share: None)  # the libraries are read
    threading.Timer(4.0, press).start()
    with pytest.raises(CancelledRun):
        processes.diagnose(DiagnoseRequest(hours, tmp_path / "out"), on_share)
    assert time.monotonic() - pressed < 2.0
    assert processes.diagnose(small(tmp_path, "next"), lambda share: None).files


def test_memory_is_bounded_and_the_next_run_goes_well(
    hours: tuple[Path, ...], tmp_path: Path
) -> None:
    processes = RunProcesses(limits=Limits(memory_bytes=3 * 10**8, seconds=300))
    try:
        with pytest.raises(RunError, match="memory"):
            processes.diagnose(DiagnoseRequest(hours, tmp_path / "out"), lambda share: None)
        assert not (tmp_path / "out").exists()
        assert processes.diagnose(small(tmp_path), lambda share: None).files
    finally:
        processes.close()


@pytest.mark.parametrize("limits", [Limits(seconds=1.5), Limits(silent_s=1.5)])
def test_what_takes_too_long_is_ended(limits: Limits, tmp_path: Path) -> None:
    processes = RunProcesses(limits=limits)
    try:
        thread = threading.Timer(0.5, lambda: os.kill(pid_of(processes), signal.SIGSTOP))
        thread.start()
        start = time.monotonic()
        with pytest.raises(RunError, match=r"took longer|stopped getting on"):
            processes.diagnose(small(tmp_path), lambda share: None)
        assert time.monotonic() - start < 4
    finally:
        processes.close()


def test_a_process_that_is_killed_is_told_of_and_replaced(processes: RunProcesses) -> None:
    threading.Timer(0.5, lambda: os.kill(pid_of(processes), signal.SIGKILL)).start()
    with pytest.raises(
        RunError, match=r"by signal 9 \(SIGKILL\). Somebody or something else"
    ) as told:
        look(processes, ends.wait)
    assert "want of memory" not in str(told.value).replace("tells of no want of memory", "")
    assert look(processes, ends.carry_on) == ""


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (
            ends.segfault,
            ["by signal 11 (SIGSEGV)", "Segmentation fault", "fresh process", "report"],
        ),
        (ends.leave_with_3, ["with exit status 3", "the last words of it", "report"]),
        (ends.abort, ["by signal 6 (SIGABRT)", "report"]),
        (ends.terminate, ["by signal 15 (SIGTERM), which was sent to it", "start it again"]),
        (ends.kill, ["by signal 9 (SIGKILL)", "tells of no want of memory"]),
    ],
)
def test_a_process_that_dies_says_how(
    end: Callable[[], None], words: list[str], processes: RunProcesses
) -> None:
    """Each kills itself in the middle of its run."""
    with pytest.raises(RunError) as told:
        look(processes, end)
    sentence = str(told.value)
    assert all(word in sentence for word in words), sentence
    assert "for want of memory" not in sentence and "needed more memory" not in sentence
    assert sentence.isprintable()
    assert look(processes, ends.carry_on) == ""


@pytest.mark.parametrize("end", [ends.run_out_of_memory, ends.run_out_of_memory_in_c])
def test_memory_is_named_where_the_log_or_python_says_so(
    end: Callable[[], None], processes: RunProcesses
) -> None:
    with pytest.raises(RunError, match="memory"):
        look(processes, end)


def test_memory_is_named_where_the_kernel_has_ended_it(
    processes: RunProcesses, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The counter of a control group rises while the run goes on."""
    (tmp_path / "memory.events").write_text("oom 0\noom_kill 4\n")
    monkeypatch.setattr(ended, "_counters", lambda: iter([tmp_path / "memory.events"]))

    def strike() -> None:
        (tmp_path / "memory.events").write_text("oom 1\noom_kill 5\n")
        os.kill(pid_of(processes), signal.SIGKILL)

    threading.Timer(0.5, strike).start()
    with pytest.raises(RunError, match=r"want of memory, as the system says; .* 4\.0 GB"):
        look(processes, ends.wait)


def test_what_a_process_says_goes_on_to_the_log_of_the_page(
    processes: RunProcesses, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RunError):
        look(processes, ends.leave_with_3)
    assert "the last words of it" in capsys.readouterr().err


def test_sentences_and_faults_come_back_as_what_they_are(
    processes: RunProcesses, weights: Path, speech: Path, tmp_path: Path
) -> None:
    events: list[Event] = []
    request = GenerateRequest(speech, tmp_path / "out", weights, ("globaldiff/none",))
    with pytest.raises(RunError, match="globaldiff/none"):
        processes.generate(request, events.append, lambda: False)
    with pytest.raises(FaultInRunProcess, match="Traceback"):
        processes.do("generate", (None,), events.append, lambda: False)
    assert not events or all(isinstance(event, Progress) for event in events)


def test_a_file_that_is_told_of_is_there_however_late_it_is_looked_at(
    processes: RunProcesses, weights: Path, speech: Path, tmp_path: Path
) -> None:
    shares, files = 0, 0

    def on_event(event: Event) -> None:
        nonlocal shares, files
        if isinstance(event, Artefact):
            time.sleep(0.3)
            assert event.path.is_file()
            files += 1
        else:
            shares += 1

    request = GenerateRequest(speech, tmp_path / "out", weights, steps=1, has_video=False)
    done = processes.generate(request, on_event, lambda: False)
    assert done.files and shares and files


def test_a_run_that_has_stepped_aside_comes_last_and_its_process_is_not_kept(
    hours: tuple[Path, ...], tmp_path: Path
) -> None:
    processes = RunProcesses(limits=Limits(seconds=300), num_aside=1)
    long = DiagnoseRequest(hours[:1], tmp_path / "long", has_pictures=False)
    niceness: set[tuple[int, ...]] = set()
    over = threading.Event()

    def stop(share: float) -> None:
        if over.is_set():
            raise CancelledRun

    def work() -> None:
        with pytest.raises(CancelledRun):
            processes.diagnose(long, stop)

    def look(share: float) -> None:
        ids = [process.child.pid for process in processes._busy]
        niceness.add(tuple(os.getpriority(os.PRIO_PROCESS, number) for number in ids))

    try:
        thread = threading.Thread(target=work)
        thread.start()
        while not processes._busy:
            time.sleep(0.05)
        own = os.getpriority(os.PRIO_PROCESS, 0)
        for name in "ab":
            processes.diagnose(small(tmp_path, name), look)
        assert (19, own) in niceness and all(each[1:] in ((), (own,)) for each in niceness)
        over.set()
        thread.join(60)
        assert not thread.is_alive() and len(processes._all) == 1
        assert processes.diagnose(small(tmp_path, "next"), lambda share: None).files
        (kept,) = processes._all
        assert os.getpriority(os.PRIO_PROCESS, kept.child.pid) == own
    finally:
        over.set()
        processes.close()
