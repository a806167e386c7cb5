"""Whose turn it is, as programs and browsers meet it at Gradio's queue: one run at a time in order
of arrival, each told its place; who cancels or goes leaves it, and its run ends."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import gradio as gr
import httpx
import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from app.page.visitors.job_folders import Jobs
from app.page.visitors.turns import MAX_OF_ADDRESS, MAX_UNATTENDED_S, LimitedQueue
from app.page.visitors.visitors import CHECKS, COOKIE, leaving_route
from app.run.callbacks import RunCallbacks
from tests.app.page.test_runner import Runner
from tests.waiting import wait_for

SLOTS, PLACES = 1, 3


class Lasting(Runner):
    survives_disconnect = True


class Page:
    """Runs that last until they are let, or told to stop."""

    client: httpx.Client

    def __init__(self, jobs: Jobs, places: int = PLACES) -> None:
        self.jobs = jobs
        self.begun: list[str] = []
        self.done: list[str] = []
        self.ended: list[str] = []
        self.num_polls = 0
        self.may_end, self.may_check = threading.Semaphore(0), threading.Semaphore(0)
        with gr.Blocks() as blocks:
            status, message, name = gr.HTML(), gr.HTML(), gr.Textbox()
            runner = Lasting(jobs, self.work, status, message)
            outputs = [status, message]
            run = runner.start_on(gr.Button().click, [name], outputs=outputs, api_name="run")
            runner.cancel_on(gr.Button(), run, outputs)
            self.checked: list[str] = []
            checks = {"api_name": "check", "concurrency_id": CHECKS, "concurrency_limit": 1}
            gr.Button().click(self.check, [name], [], **checks)
        self.turns = blocks._queue = LimitedQueue(
            jobs,
            places,
            live_updates=True,
            concurrency_count=40,
            update_intervals=1,
            blocks=blocks,
            default_concurrency_limit=SLOTS,
        )
        self.blocks, (self.fn, *_, self.check_fn) = blocks, blocks.fns

    def work(self, callbacks: RunCallbacks) -> str:
        visitor = self.jobs._jobs[-1].page_session
        self.begun.append(visitor)
        try:
            while not self.may_end.acquire(timeout=0.02):
                self.num_polls += 1
                if callbacks.should_cancel():
                    raise KeyError("it has ended in the middle")
        finally:
            self.ended.append(visitor)
        self.done.append(visitor)
        return "done"

    def check(self, name: str) -> None:
        self.checked.append(name)
        assert self.may_check.acquire(timeout=60)

    def ask(
        self, visitor: str, address: str = "", fn: int | None = None, cookie: str = ""
    ) -> httpx.Response:
        """Join the queue, as a machine of some address that a proxy of this one tells."""
        asked = {"data": [visitor], "fn_index": fn or self.fn, "session_hash": visitor}
        told = {"X-Forwarded-For": address or f"10.0.0.{ord(visitor[0])}"}
        told |= {"Cookie": f"{COOKIE}={cookie}"} if cookie else {}
        return self.client.post("/gradio_api/queue/join", json=asked, headers=told)

    @contextmanager
    def asked(self, visitor: str, **how: Any) -> Iterator[Iterator[dict[str, Any]]]:
        """Join the queue and listen."""
        assert self.ask(visitor, **how).status_code == 200
        with self.heard(visitor) as told:
            yield told

    @contextmanager
    def heard(self, visitor: str) -> Iterator[Iterator[dict[str, Any]]]:
        """What a browser is told, for as long as it listens."""
        asked = {"session_hash": visitor}
        with self.client.stream("GET", "/gradio_api/queue/data", params=asked) as stream:
            yield (json.loads(line[5:]) for line in stream.iter_lines() if line[:5] == "data:")


@pytest.fixture
def page(tmp_path, monkeypatch) -> Iterator[Page]:
    monkeypatch.setenv("GRADIO_TEMP_DIR", str(tmp_path / "gradio"))
    monkeypatch.setenv("FORWARDED_ALLOW_IPS", "127.0.0.1")
    page = Page(Jobs(tmp_path / "jobs"))
    page.blocks.launch(prevent_thread_lock=True, quiet=True, _frontend=False)
    with httpx.Client(base_url=page.blocks.local_url or "", timeout=60) as page.client:
        yield page
    page.may_check.release(100)
    page.jobs.cancel_all()
    page.blocks.close()


def first_of(page: Page, number: int) -> Callable[[], bool]:
    return lambda: len(page.begun) == number


def test_runs_go_one_at_a_time_in_order_and_each_is_told_its_place(page):
    with ExitStack() as pages:
        pages.enter_context(page.asked("a"))
        wait_for(first_of(page, 1))
        _, third, last = (pages.enter_context(page.asked(visitor)) for visitor in "bcd")
        full = page.ask("e")
        assert full.status_code == 503 and f"{PLACES} runs are already waiting" in full.text
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


def test_who_has_gone_leaves_the_place_and_ends_a_run_that_could_not_be_opened_again(page):
    with page.asked("a") as one, page.asked("b") as other:
        wait_for(first_of(page, 1))
        assert next(one) and next(other)
    with page.asked("c"):
        wait_for(first_of(page, 2))
        assert page.begun == ["a", "c"]
        wait_for(lambda: page.ended == ["a"])  # else it could be the one that may end
        page.may_end.release()
        wait_for(lambda: page.done == ["c"])


def test_a_run_whose_page_has_lost_its_connection_goes_on_until_somebody_else_waits(page):
    def lose(visitor: str, number: int) -> None:
        with page.asked(visitor, cookie="a browser's"):
            wait_for(first_of(page, number))
        wait_for(lambda: visitor not in page.turns.pending_messages_per_session)

    lose("a", 1)
    before = page.num_polls  # a run that ends with its page has 9 more
    wait_for(lambda: page.num_polls > before + 25 or not page.jobs.in_use())
    page.may_end.release()
    wait_for(lambda: page.done == ["a"] and not page.jobs.in_use())
    lose("b", 2)
    assert page.jobs.survives_disconnect("b")
    with page.asked("c"):
        wait_for(lambda: len(page.begun) == 3 and page.ended == ["a", "b"])
        page.may_end.release()  # for c: b's run may still be ending when c's begins
        wait_for(lambda: page.done == ["a", "c"] and not page.jobs.in_use())
    assert page.begun == ["a", "b", "c"]


def test_a_page_that_is_closed_on_purpose_ends_its_runs_and_nobody_elses(page):
    route = TestClient(FastAPI(routes=[leaving_route(page.jobs)]))
    with page.asked("a", cookie="mine"):
        wait_for(first_of(page, 1))
    for visitor, cookie, is_left in (("b", "mine", 0), ("a", "theirs", 0), ("a", "mine", 1)):
        answer = route.post("/leave", content=visitor, headers={"Cookie": f"{COOKIE}={cookie}"})
        assert answer.status_code == 204 and page.jobs.survives_disconnect("a") != is_left
    wait_for(lambda: not page.jobs.in_use())
    assert page.done == []


def test_joins_for_which_nobody_listens_shut_nobody_out_and_are_dropped(page):
    for visitor in ("x1", "x2", "x3"):
        assert page.ask(visitor).status_code == 200
    assert page.ask("y").status_code == 503, "for a moment, in which they might be heard"
    for event in page.turns._waiting():
        event.enqueue_time -= MAX_UNATTENDED_S
    with page.asked("y"):
        wait_for(first_of(page, 1))
        assert page.begun == ["y"] and len(page.turns) == 0
        assert set(page.turns.pending_messages_per_session) == {"y"}
        page.may_end.release()
        wait_for(lambda: page.done == ["y"])


def test_few_wait_from_one_address(page):
    page.turns.max_queue_size = 32
    with page.asked("a"):
        wait_for(first_of(page, 1))
        for number in range(MAX_OF_ADDRESS):
            assert page.ask(f"x{number}").status_code == 200
        one_more = page.ask("x5")
        assert one_more.status_code == 400
        assert f"{MAX_OF_ADDRESS} requests from your IP address" in one_more.json()["detail"]
        assert page.ask("y").status_code == 200


def test_checks_of_one_address_hold_up_no_other_and_take_no_place_of_a_run(page):
    with ExitStack() as pages:
        for number in range(4):
            pages.enter_context(page.asked(f"a{number}", fn=page.check_fn))
        wait_for(lambda: page.checked == ["a0"])
        pages.enter_context(page.asked("b", fn=page.check_fn))
        pages.enter_context(page.asked("c"))
        wait_for(first_of(page, 1))
        page.may_check.release()
        wait_for(lambda: len(page.checked) == 2)
        assert page.checked == ["a0", "b"]
        page.may_end.release()


def test_who_cancels_gives_the_place_to_the_next_at_once(page):
    events: dict[str, str] = {}
    with ExitStack() as pages:
        for visitor in "abc":
            events[visitor] = page.ask(visitor).json()["event_id"]
            pages.enter_context(page.heard(visitor))
        wait_for(first_of(page, 1))
        for visitor in "ba":
            asked = {"session_hash": visitor, "fn_index": page.fn, "event_id": events[visitor]}
            assert page.client.post("/gradio_api/cancel", json=asked).status_code == 200
        wait_for(first_of(page, 2))
        assert page.begun == ["a", "c"]
        wait_for(lambda: len(page.jobs._jobs) == 1)
        page.may_end.release()
