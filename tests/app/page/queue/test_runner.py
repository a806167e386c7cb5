"""What all tabs do alike between a click and the end of a run."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app import text
from app.errors import CancelledRun, RunError
from app.page.queue.in_turn import Updates
from app.page.queue.jobs import Job, JobBook
from app.page.queue.runner import TabRunner
from app.page.visitors.visitors import COOKIE
from app.run.requests.request import Event, OnEvent, Progress, ShouldCancel

VISITOR = SimpleNamespace(
    session_hash="visitor", cookies={COOKIE: "cookie"}, client=SimpleNamespace(host="127.0.0.1")
)
Do = Callable[[OnEvent, ShouldCancel], str]


class Work:
    """A run of the test's own."""

    def __init__(self, do: Do) -> None:
        self.run = do

    def progress(self, events: list[Event]) -> Updates:
        return {"shares": [e.fraction for e in events if isinstance(e, Progress)]} if events else {}

    def finished(self, result: str) -> Updates:
        return {"result": result}


class Runner(TabRunner[str]):
    tab = "study"

    def __init__(self, jobs: JobBook, do: Do) -> None:
        super().__init__(jobs, status="status")  # type: ignore[arg-type]
        self.do = do
        self.begun: list[Any] = []
        self.has_ended = False

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[Work]:
        if not values:
            raise RunError("The form is empty.")
        self.begun.append((cookie, values))
        try:
            yield Work(self.do)
        finally:
            self.has_ended = True

    def blank(self) -> Updates:
        return {"blank": True}

    def stopped(self, status: str, message: str) -> Updates:
        return {"status": status, "message": message}


def click(runner: Runner, *values: Any) -> Iterator[Updates]:
    return runner.run(VISITOR, *values)  # type: ignore[arg-type]


def cancel(runner: Runner) -> None:
    runner.cancel(VISITOR)  # type: ignore[arg-type]


def test_a_run_is_blank_then_tells_its_news_then_its_result(tmp_path: Path) -> None:
    def do(on_event: OnEvent, should_cancel: ShouldCancel) -> str:
        on_event(Progress("numbers", 0.5))
        return "done"

    jobs = JobBook(tmp_path)
    runner = Runner(jobs, do)
    first, *between, last = list(click(runner, "a", 1))
    assert first == {"blank": True} and last == {"result": "done"}
    assert between == [{"shares": [0.5]}]
    assert runner.begun == [("cookie", ("a", 1))] and runner.has_ended
    assert not jobs.cancel("visitor", "study")  # it has been closed


def test_a_form_that_cannot_be_done_is_told_and_nothing_is_blanked(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)
    clicked = click(Runner(jobs, lambda on_event, should_cancel: ""))
    told = next(clicked)
    assert text.STOPPED in told["status"] and "The form is empty." in told["message"]
    with pytest.raises(gr.Error, match="The form is empty"):
        next(clicked)
    assert not jobs.cancel("visitor", "study")


def test_a_failure_is_told_and_what_was_begun_is_ended(tmp_path: Path) -> None:
    def do(on_event: OnEvent, should_cancel: ShouldCancel) -> str:
        raise RunError("It is <broken>.")

    runner = Runner(JobBook(tmp_path), do)
    told: list[Updates] = []
    with pytest.raises(gr.Error, match="It is <broken>"):
        for updates in click(runner, 1):
            told.append(updates)
    assert "It is &lt;broken&gt;." in told[-1]["message"] and runner.has_ended


def test_cancel_is_heard_at_once_and_is_no_error(tmp_path: Path) -> None:
    has_stopped = threading.Event()

    def do(on_event: OnEvent, should_cancel: ShouldCancel) -> str:
        on_event(Progress("numbers", 0.5))
        while not should_cancel():
            pass
        has_stopped.wait(20)  # a step that cannot be interrupted
        raise CancelledRun

    runner = Runner(JobBook(tmp_path), do)
    told: list[Updates] = []
    for updates in click(runner, 1):
        told.append(updates)
        if "shares" in updates:
            cancel(runner)
        if text.STOPPING in str(updates):
            has_stopped.set()
    assert text.STOPPING in told[-2]["status"]
    assert text.CANCELLED in told[-1]["status"] and told[-1]["message"] == ""


def test_who_waits_is_told_and_can_stop_waiting(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)
    runner = Runner(jobs, lambda on_event, should_cancel: "")
    with jobs.slot(jobs.open("another", "study")) as turn:
        list(turn)
        clicked = click(runner, 1)
        assert next(clicked) == {"blank": True}
        assert text.WAITING_ONE in next(clicked)["status"]
        cancel(runner)
        assert text.CANCELLED in next(clicked)["status"]
        assert next(clicked, None) is None
    assert runner.has_ended


def test_a_run_that_is_put_back_begins_anew_and_comes_to_its_end(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)
    begun = threading.Event()
    folders: list[Path] = []

    def do(on_event: OnEvent, should_cancel: ShouldCancel) -> str:
        (job,) = jobs._jobs
        folders.append(job.folder)
        if len(folders) == 1:
            begun.set()
            on_event(Progress("numbers", 0.5))
            while not should_cancel():
                time.sleep(0.01)
            raise CancelledRun
        return "done"

    runner = Runner(jobs, do)
    told: list[Updates] = []
    for updates in click(runner, "form"):
        told.append(updates)
        if begun.is_set():
            begun.clear()
            jobs._jobs[0].is_put_back = True
    assert told[-1] == {"result": "done"} and {"blank": True} in told[1:]
    assert len(runner.begun) == 2 and not folders[0].exists() and not jobs._jobs
