"""What all tabs do alike from the turn of a run to its end, and what each run leaves."""

import os
import shutil
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app import text
from app.errors import Cancelled, RunError
from app.page.parts.markup import Updates
from app.page.tabs.runner import TabRunner, stream_updates
from app.page.visitors.job_folders import Job, Jobs, sweep
from app.page.visitors.quota import Quota
from app.run.callbacks import FolderUpdated, RunCallbacks, RunEvent, StageProgress
from tests.app import fakes
from tests.app.page.made import browser
from tests.app.requests import generate_request

VISITOR = browser("cookie")
Do = Callable[[RunCallbacks], str]


class Runner(TabRunner):
    """Does a run of the test's own."""

    tab = "study"

    def __init__(self, jobs: Jobs, do: Do, status: Any = "status", message: Any = "message"):
        worker = fakes.FakeWorker(does={"do": lambda _, *how: do(*how)})
        services: Any = SimpleNamespace(jobs=jobs, worker=worker)
        super().__init__(services, status)
        self.message = message
        self.begun: list[Any] = []
        self.has_ended = False

    def job_updates(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        if not values:
            raise RunError("The form is empty.")
        self.begun.append((job.cookie, values))

        def shares(events: list[RunEvent]) -> Updates:
            found = [event.fraction for event in events if isinstance(event, StageProgress)]
            return {self.status: found} if events else {}

        def do(*_: object) -> str:
            return ""

        try:
            yield {self.status: "blank"}
            yield {self.status: (yield from self.run_task(job, do, None, shares))}
        finally:
            self.has_ended = True

    def stopped_updates(self, status: str, message: str) -> Updates:
        return {self.status: status, self.message: message}


@pytest.fixture
def jobs(tmp_path: Path) -> Jobs:
    return Jobs(tmp_path / "jobs")


def half_done(callbacks: RunCallbacks) -> str:
    callbacks.on_event(StageProgress("numbers", 0.5))
    return "done"


def news(updates: Iterable[Updates]) -> list[Any]:
    """Of the status; a busy machine may have none for a while."""
    return [each["status"] for each in updates if each["status"] != gr.skip()]


def wait_to_stop(callbacks: RunCallbacks) -> str:
    moment = threading.Event()
    while not callbacks.should_cancel():
        moment.wait(0.01)
    raise Cancelled


def test_a_run_is_blank_then_tells_its_news_then_its_result(jobs):
    runner = Runner(jobs, half_done)
    assert news(runner.run(VISITOR, "a", 1)) == ["blank", [0.5], "done"]
    assert runner.begun == [("cookie", ("a", 1))] and runner.has_ended and not jobs.in_use()


def test_what_goes_wrong_is_told_in_a_sentence_and_ends_what_was_begun(jobs):
    def do(callbacks: RunCallbacks) -> str:
        raise RunError("It is <broken>.")

    runner = Runner(jobs, do)
    for values, updates, sentence in (
        ((), 1, "The form is empty."),  # and nothing is blanked
        ((1,), 2, "It is <broken>."),
    ):
        told: list[Updates] = []
        with pytest.raises(gr.Error) as raised:
            for each in runner.run(VISITOR, *values):
                told.append(each)
        assert str(raised.value.message) == sentence and len(news(told)) == updates
        assert (told[0]["status"] == "blank") == bool(values)
        assert text.STOPPED in told[-1]["status"]
        assert sentence.replace("<", "&lt;").replace(">", "&gt;") in told[-1]["message"]
    assert runner.has_ended and not jobs.in_use()


def test_cancel_is_no_error_and_clears_a_tab_only_whose_run_had_begun(jobs):
    runner = Runner(jobs, wait_to_stop)
    untouched = {"status": gr.skip()}
    assert runner.cancel(VISITOR) == untouched
    clicked = runner.run(VISITOR, 1)
    assert next(clicked) == {"status": "blank"}
    assert runner.cancel(browser("cookie", session="other")) == untouched
    assert next(clicked) == untouched, "the other's click was of another page"
    assert text.CANCELLED in runner.cancel(VISITOR)["status"]
    assert text.CANCELLED in list(clicked)[-1]["status"] and not jobs.in_use()
    clicked = runner.run(VISITOR, 1)
    next(clicked)
    next(clicked)
    clicked.close()  # what Gradio does, which may be before the button's own call
    assert runner.has_ended and not jobs.in_use()
    assert text.CANCELLED in runner.cancel(VISITOR)["status"]
    assert runner.cancel(VISITOR) == untouched


def test_news_come_in_order_then_the_result_and_files_outlive_the_run_that_stops_with_its_visitor(
    jobs, speech
):
    with jobs.open_job("one", "generate") as job:
        asked = generate_request(
            speech=speech,
            out=job.folder / "out",
            systems=fakes.CATALOGUE.systems,
            is_incremental=True,
        )

        def do(callbacks: RunCallbacks) -> str:
            fakes.make_generate()(asked, callbacks)
            return "done"

        events: list[RunEvent] = []
        following = stream_updates(do, job, lambda batch: {"news": events.extend(batch)}, {})
        with pytest.raises(StopIteration, match="done"):
            while True:
                next(following)
        assert FolderUpdated in {type(event) for event in events}
        last = {event.stage: event.fraction for event in events if isinstance(event, StageProgress)}
        assert set(last.values()) == {1.0} and not job.is_cancelled()
        shutil.rmtree(asked.output.out)
    assert job.is_cancelled(), "whatever still works for it stops"


def test_jobs_have_folders_of_their_own_and_are_stopped_by_tab_and_page(jobs):
    with (
        jobs.open_job("one", "generate") as first,
        jobs.open_job("one", "study") as second,
        jobs.open_job("two", "generate") as other,
    ):
        folders = {job.folder for job in (first, second, other)}
        assert len(folders) == 3 and set(jobs.in_use()) == folders
        assert all(folder.stat().st_mode & 0o777 == 0o700 for folder in folders)
        jobs.cancel("one", "generate")
        assert first.is_cancelled() and not second.is_cancelled() and not other.is_cancelled()
        jobs.cancel_all()
        assert second.is_cancelled() and other.is_cancelled()
    assert not jobs.in_use() and all(folder.is_dir() for folder in folders), "for the downloads"


def test_an_address_that_has_left_too_much_begins_no_run_and_behind_a_proxy_a_browser(tmp_path):
    def leave(callbacks: RunCallbacks) -> str:
        (jobs._jobs[-1].folder / "unpacked").write_bytes(bytes(2_000_000))
        return "done"

    def at(host: str, cookie: str = "") -> Any:
        visitor = browser(cookie)
        visitor.client = SimpleNamespace(host=host)
        return visitor

    jobs = Jobs(tmp_path / "jobs", Quota(3_000_000, 3600, ["10.0.0.0/8"]))
    runner = Runner(jobs, leave)
    for visitor in (at("192.0.2.1"), at("10.0.0.2", "one"), at("10.0.0.2")):
        for _ in range(2):
            assert news(runner.run(visitor, 1))[-1] == "done"
        with pytest.raises(gr.Error) as raised:
            list(runner.run(visitor, 1))
        assert "the limit is 0.003 GB" in str(raised.value.message)
        assert "60 minutes after" in str(raised.value.message)
    shutil.rmtree(jobs._root)
    assert news(runner.run(visitor, 1))[-1] == "done"
    assert news(runner.run(at("192.0.2.2"), 1))[-1] == "done"
    assert news(runner.run(at("10.0.0.2", "another"), 1))[-1] == "done"


def test_an_upload_stays_for_as_long_as_its_run_goes_on(jobs, tmp_path):
    upload = tmp_path / "gradio" / "aa" / "speech.wav"
    upload.parent.mkdir(parents=True)
    upload.write_bytes(b"sound")

    def aged() -> bool:
        os.utime(upload.parent, (0, 0))  # while others' runs go on
        sweep(tmp_path, 1000, jobs.in_use())
        return upload.exists()

    with jobs.open_job(
        "visitor", "generate", "", ["a form", 3, [str(upload)], "/etc/passwd"]
    ) as job:
        assert jobs.in_use() == [job.folder, upload.parent] and aged()
        os.utime(job.folder, (0, 0))  # when the run began
    sweep(tmp_path, 1000, jobs.in_use())
    assert job.folder.exists(), "results are kept from the end of the run on"
    assert upload.exists() and not aged()
