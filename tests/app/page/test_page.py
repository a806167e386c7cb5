"""The tabs of one page beside each other: the same visitor may have a run in each."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app.config import AppConfig
from app.page.page import build_app
from app.page.queue.jobs import Job, JobBook
from app.page.visitors.visitors import COOKIE
from tests.app import fakes

VISITOR = SimpleNamespace(session_hash="visitor", cookies={COOKIE: "cookie"})
TABS = {"generate": "cancel", "own-start": "own-cancel", "study-make": "study-cancel"}
"""Of each tab the button that starts a run and the one that stops it."""


class WatchedJobs(JobBook):
    """Keeps every job in sight of the test, in order."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.opened: list[Job] = []

    def open(self, *names: Any) -> Job:
        self.opened.append(super().open(*names))
        return self.opened[-1]


@pytest.fixture
def jobs(tmp_path: Path) -> WatchedJobs:
    return WatchedJobs(tmp_path / "jobs")


@pytest.fixture
def page(jobs: WatchedJobs, tmp_path: Path) -> gr.Blocks:
    does = {"generate": fakes.make_generate()}
    return build_app(fakes.made_services(tmp_path, does, config=AppConfig(), jobs=jobs))


def handler(page: gr.Blocks, button: str) -> Callable[..., Any]:
    """What a click on a button calls."""
    (found,) = (
        each.fn
        for each in page.fns.values()
        for target, event in each.targets
        if event == "click" and page.blocks[target].elem_id == button and each.fn is not None
    )
    return found


@pytest.fixture
def runs(page: gr.Blocks, speech: Path) -> list[Any]:
    """A run in each tab, which has begun and goes no further."""
    systems = list(fakes.CATALOGUE.systems)
    protocol = "Rank all systems on three questions"
    forms = (
        (str(speech), systems, "ann", 0, 1, "10", "euler", False, None, "right_middle", 0, None),
        (["/up/a.npz"], None, None, "right_middle", 0),
        ("A study", protocol, [str(speech)], systems, None, 1, 4, 0, ["front"], ""),
    )
    started = []
    for button, form in zip(TABS, forms, strict=True):
        started.append(handler(page, button)(VISITOR, *form))
        next(started[-1])
    return started


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize("tab", range(3))
def test_a_tabs_cancel_stops_its_own_run_alone(
    page: gr.Blocks, jobs: WatchedJobs, tab: int
) -> None:
    handler(page, list(TABS.values())[tab])(VISITOR)
    assert [job.is_cancelled() for job in jobs.opened] == [number == tab for number in range(3)]


@pytest.mark.usefixtures("runs")
def test_a_page_that_is_closed_stops_the_runs_of_all_tabs(
    page: gr.Blocks, jobs: WatchedJobs
) -> None:
    for each in page.fns.values():
        if any(event == "unload" for _, event in each.targets):
            each.fn(VISITOR)
    assert [job.is_cancelled() for job in jobs.opened] == [True] * 3
