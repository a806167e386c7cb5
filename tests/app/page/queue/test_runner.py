"""What all tabs do alike between a click and the end of a run, and how a run is followed."""

import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app import text
from app.errors import CancelledRun, RunError
from app.page.queue.in_turn import Updates, follow_run
from app.page.queue.jobs import Job, JobBook
from app.page.queue.runner import TabRunner
from app.run.requests.request import (
    Artefact,
    Event,
    GenerateRequest,
    Grown,
    OnEvent,
    Progress,
    ShouldCancel,
)
from tests.app import fakes
from tests.app.page.made import browser

VISITOR = browser("cookie")
Do = Callable[[OnEvent, ShouldCancel], str]


class Runner(TabRunner[str]):
    """Does a run of the test's own."""

    tab = "study"

    def __init__(self, jobs: JobBook, do: Do) -> None:
        super().__init__(jobs, status="status")  # type: ignore[arg-type]
        self.run_it = do
        self.begun: list[Any] = []
        self.has_ended = False

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[Any]:
        if not values:
            raise RunError("The form is empty.")
        self.begun.append((cookie, values))

        def shares(events: list[Event]) -> Updates:
            found = [event.fraction for event in events if isinstance(event, Progress)]
            return {"shares": found} if events else {}

        try:
            finished = {"finished": lambda result: {"result": result}}
            yield SimpleNamespace(run=self.run_it, progress=shares, **finished)
        finally:
            self.has_ended = True

    def blank(self) -> Updates:
        return {"blank": True}

    def stopped(self, status: str, message: str) -> Updates:
        return {"status": status, "message": message}


@pytest.fixture
def jobs(tmp_path: Path) -> JobBook:
    return JobBook(tmp_path)


def half_done(on_event: OnEvent, should_cancel: ShouldCancel) -> str:
    on_event(Progress("numbers", 0.5))
    return "done"


def test_a_run_is_blank_then_tells_its_news_then_its_result(jobs):
    runner = Runner(jobs, half_done)
    first, *between, last = list(runner.run(VISITOR, "a", 1))
    assert first == {"blank": True} and last == {"result": "done"}
    assert between == [{"shares": [0.5]}]
    assert runner.begun == [("cookie", ("a", 1))] and runner.has_ended and not jobs.in_use()


def test_what_goes_wrong_is_told_in_a_sentence_and_ends_what_was_begun(jobs):
    def do(on_event: OnEvent, should_cancel: ShouldCancel) -> str:
        raise RunError("It is <broken>.")

    runner = Runner(jobs, do)
    for values, updates, sentence in (
        ((), 1, "The form is empty."),  # and nothing is blanked
        ((1,), 3, "It is <broken>."),
    ):
        told: list[Updates] = []
        with pytest.raises(gr.Error) as raised:
            for each in runner.run(VISITOR, *values):
                told.append(each)
        assert str(raised.value.message) == sentence and len(told) <= updates
        assert ("blank" in told[0]) == bool(values)
        assert text.STOPPED in told[-1]["status"]
        assert sentence.replace("<", "&lt;").replace(">", "&gt;") in told[-1]["message"]
    assert runner.has_ended and not jobs.in_use()


def test_cancel_is_heard_at_once_and_is_no_error(jobs):
    has_stopped = threading.Event()

    def do(on_event: OnEvent, should_cancel: ShouldCancel) -> str:
        on_event(Progress("numbers", 0.5))
        while not should_cancel():
            has_stopped.wait(0.01)
        has_stopped.wait(60)  # a step that cannot be interrupted
        raise CancelledRun

    runner = Runner(jobs, do)
    told: list[Updates] = []
    for updates in runner.run(VISITOR, 1):
        told.append(updates)
        if "shares" in updates:
            runner.cancel(VISITOR)
        if text.STOPPING in str(updates):
            has_stopped.set()
    assert text.STOPPING in told[-2]["status"]
    assert text.CANCELLED in told[-1]["status"] and told[-1]["message"] == ""


def test_who_waits_is_told_how_many_are_before_and_can_stop_waiting(jobs):
    runner = Runner(jobs, half_done)
    with jobs.slot(jobs.open("another", "study")) as turn:
        list(turn)
        clicked = runner.run(VISITOR, 1)
        assert next(clicked) == {"blank": True}
        assert text.WAITING_ONE in next(clicked)["status"]
        third = Runner(jobs, half_done).run(browser("other", session="other"), 1)
        next(third)
        assert text.WAITING.format(ahead=2) in next(third)["status"]
        runner.cancel(VISITOR)
        assert text.CANCELLED in next(clicked)["status"]
        assert next(clicked, None) is None
    assert runner.has_ended and list(third)[-1] == {"result": "done"}


def test_news_come_in_order_then_the_result_and_files_outlive_the_run_that_stops_with_its_visitor(
    jobs, speech
):
    job, systems = jobs.open("one", "generate"), fakes.CATALOGUE.systems
    asked = GenerateRequest(speech, job.folder / "out", Path("/weights"), systems)
    file = job.folder / "a.mp4"

    def do(on_event: OnEvent, should_cancel: ShouldCancel) -> str:
        file.write_bytes(b"0")
        on_event(Artefact("video", "a", file))
        fakes.make_generate()(asked, on_event, should_cancel)
        return "done"

    *news, result = follow_run(do, job)
    assert result == "done"
    events = [event for batch in news for event in batch]
    (kept,) = [event.path for event in events if isinstance(event, Artefact)]
    file.unlink()
    assert kept.is_file() and Grown in {type(event) for event in events}
    last = {event.stage: event.fraction for event in events if isinstance(event, Progress)}
    assert set(last.values()) == {1.0} and not job.is_cancelled()
    shutil.rmtree(asked.out)
    following = follow_run(partial(fakes.make_generate(hold=threading.Event()), asked), job)
    next(following)
    following.close()  # what Gradio does when the connection ends
    assert job.is_cancelled()
