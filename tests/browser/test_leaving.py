"""A tab that is closed ends its run; one that only loses its connection does not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from playwright.sync_api import BrowserContext, expect

from app.config import AppConfig
from app.page.visitors.turns import LimitedQueue
from app.run.callbacks import RunCallbacks
from app.run.requests.requests import AnyRun
from processes.job import Cancelled
from tests.browser.conftest import (
    AT_REST,
    Fake,
    forget_failed_fetches,
    opened,
    ready,
    served_blocks,
    staged,
    start,
)
from tests.waiting import wait_for

if TYPE_CHECKING:
    from gradio import Blocks

pytestmark = pytest.mark.browser

IDLE = "() => new Promise(requestIdleCallback)"
"""Resolves when the page's thread has nothing to do."""


class Runs:
    """Runs that wait for their figures, and how each has ended; sessions without a connection."""

    def __init__(self, fake: Fake) -> None:
        self._fake = fake
        self.num_begun = 0
        self.ends: list[str] = []
        self.lost: list[str] = []

    def do(self, request: AnyRun, callbacks: RunCallbacks) -> Any:
        self.num_begun += 1
        try:
            done = self._fake.generate(request, callbacks)
        except Cancelled:
            self.ends.append("cancelled")
            raise
        self.ends.append("finished")
        return done


@pytest.fixture
def runs(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> Runs:
    fake.figures.clear()
    runs = Runs(fake)
    clean = LimitedQueue.clean_events

    async def noted(turns: LimitedQueue, *, session_hash: str | None = None, **which: Any) -> None:
        await clean(turns, session_hash=session_hash, **which)
        if session_hash is not None:
            runs.lost.append(session_hash)

    monkeypatch.setattr(LimitedQueue, "clean_events", noted)
    return runs


@pytest.fixture
def blocks(runs: Runs, fake: Fake, weights: Path, tmp_path: Path) -> Iterator[Blocks]:
    config = AppConfig(port=0, weights=weights, temp_folder=tmp_path / "page")
    with served_blocks(config, **{**fake.does, "run_page_request": runs.do}) as blocks:
        yield blocks


def lose_connections(context: BrowserContext, blocks: Blocks) -> None:
    """Cut all connections of the page's server, when the browser can make no new one."""
    context.set_offline(True)
    for each in list(blocks.server.server_state.connections):
        each.loop.call_soon_threadsafe(each.transport.abort)


def test_a_tab_that_is_closed_ends_its_run_and_one_without_a_connection_does_not(
    visitor: Callable[..., BrowserContext], fake: Fake, runs: Runs, blocks: Blocks, speech: Path
) -> None:
    context, address = visitor(), blocks.local_url or ""
    turns = blocks._queue
    assert isinstance(turns, LimitedQueue)
    for number, leave in enumerate(("close", "reload"), start=1):
        page = opened(context, address)
        start(page, speech)
        wait_for(lambda number=number: runs.num_begun == number)  # the first screen has two bodies
        staged(page, 2)
        page.wait_for_function(AT_REST)
        page.evaluate(IDLE)  # a tab that is busy for half a second when it closes is killed unheard
        getattr(page, leave)()
        wait_for(lambda number=number: len(runs.ends) == number)
    assert runs.ends == ["cancelled"] * 2 and runs.num_begun == 2

    start(ready(page), speech)
    wait_for(lambda: runs.num_begun == 3)
    staged(page, 2)
    runs.lost.clear()
    lose_connections(context, blocks)
    wait_for(lambda: runs.lost)
    fake.figures.set()
    wait_for(lambda: len(runs.ends) == 3)
    assert runs.ends[-1] == "finished"
    wait_for(lambda: not turns._jobs.in_use())  # it is among the visitor's runs
    context.set_offline(False)
    page.close()
    page = opened(context, address)
    expect(page.locator("#runs summary")).to_contain_text("Your runs (1)")
    page.locator("#runs summary").click()
    page.locator("#runs li a").first.click()
    staged(page, 2)
    forget_failed_fetches()
