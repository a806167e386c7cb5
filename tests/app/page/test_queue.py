"""Whose turn it is, as programs and browsers meet it at Gradio's queue: one run at a time in order
of arrival, each told its place; who cancels or goes leaves it, and its run ends."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gradio as gr
import httpx
import pytest

from app.page.visitors.files import Jobs
from app.run.ask import Ear
from tests.app.page.test_runner import Runner
from tests.waiting import wait_for

SLOTS, PLACES = 1, 3


class Page:
    """Runs that last until they are let, or told to stop."""

    client: httpx.Client

    def __init__(self, jobs: Jobs) -> None:
        self.jobs = jobs
        self.begun: list[str] = []
        self.may_end = threading.Semaphore(0)
        with gr.Blocks() as blocks:
            status, message, name = gr.HTML(), gr.HTML(), gr.Textbox()
            runner = Runner(jobs, self.work, status, message)
            outputs = [status, message]
            run = runner.begins_on(gr.Button().click, [name], outputs=outputs, api_name="run")
            runner.ends_on(gr.Button(), run, outputs)
        blocks.queue(max_size=PLACES, default_concurrency_limit=SLOTS)
        self.blocks, self.fn = blocks, next(iter(blocks.fns))

    def work(self, ear: Ear) -> str:
        self.begun.append(self.jobs._jobs[-1].visitor)
        while not self.may_end.acquire(timeout=0.02):
            if ear.should_cancel():
                raise KeyError("it has ended in the middle")
        return "done"

    def ask(self, visitor: str) -> httpx.Response:
        asked = {"data": ["x"], "fn_index": self.fn, "session_hash": visitor}
        return self.client.post("/gradio_api/queue/join", json=asked)

    @contextmanager
    def heard(self, visitor: str) -> Iterator[Iterator[dict[str, Any]]]:
        """What a browser is told, for as long as it listens."""
        asked = {"session_hash": visitor}
        with self.client.stream("GET", "/gradio_api/queue/data", params=asked) as stream:
            yield (json.loads(line[5:]) for line in stream.iter_lines() if line[:5] == "data:")


@pytest.fixture
def page(tmp_path, monkeypatch) -> Iterator[Page]:
    monkeypatch.setenv("GRADIO_TEMP_DIR", str(tmp_path / "gradio"))
    page = Page(Jobs(tmp_path / "jobs"))
    page.blocks.launch(prevent_thread_lock=True, quiet=True, _frontend=False)
    with httpx.Client(base_url=page.blocks.local_url or "", timeout=60) as page.client:
        yield page
    page.jobs.cancel()
    page.blocks.close()


def first_of(page: Page, number: int) -> Callable[[], bool]:
    return lambda: len(page.begun) == number


def test_runs_go_one_at_a_time_in_order_and_each_is_told_its_place(page):
    assert page.ask("a").status_code == 200
    wait_for(first_of(page, 1))
    for visitor in "bcd":
        assert page.ask(visitor).status_code == 200
    full = page.ask("e")
    assert full.status_code == 503 and "full" in full.text
    with page.heard("c") as third, page.heard("d") as last:
        ranks = [next(last)["rank"]]
        for number in range(2, 5):
            page.may_end.release()
            wait_for(first_of(page, number))
            ranks.append(next(last).get("rank"))
        assert ranks[:3] == [2, 1, 0] and page.begun == list("abcd")
        assert [next(third).get("rank") for _ in range(3)] == [1, 0, None]
        page.may_end.release()
        assert next(each for each in last if each["msg"] == "process_completed")["success"]
    wait_for(lambda: not page.jobs.in_use())


def test_who_has_gone_leaves_the_place_and_ends_the_run(page):
    for visitor in "ab":
        page.ask(visitor)
    wait_for(first_of(page, 1))
    with page.heard("a") as one, page.heard("b") as other:
        next(one), next(other)
    page.ask("c")
    wait_for(first_of(page, 2))
    assert page.begun == ["a", "c"]
    wait_for(lambda: len(page.jobs._jobs) == 1)
    page.may_end.release()


def test_who_cancels_gives_the_place_to_the_next_at_once(page):
    events = {visitor: page.ask(visitor).json()["event_id"] for visitor in "abc"}
    wait_for(first_of(page, 1))
    for visitor in "ba":
        asked = {"session_hash": visitor, "fn_index": page.fn, "event_id": events[visitor]}
        assert page.client.post("/gradio_api/cancel", json=asked).status_code == 200
    wait_for(first_of(page, 2))
    assert page.begun == ["a", "c"]
    wait_for(lambda: len(page.jobs._jobs) == 1)
    page.may_end.release()
