"""The tabs of one page beside each other: the same visitor may have a run in each."""

from collections.abc import Callable
from typing import Any

import gradio as gr

from app.config import AppConfig
from app.page.page import build_app
from app.page.visitors.job_folders import Jobs
from tests.app import fakes
from tests.app.page.made import browser

VISITOR = browser("cookie")
TABS = {"generate": "cancel", "own-start": "own-cancel", "study-make": "study-cancel"}
"""Of each tab the button that starts a run and the one that stops it."""


def handler(page: gr.Blocks, button: str) -> Callable[..., Any]:
    """What a click on a button calls last."""
    *_, found = (
        each.fn
        for each in page.fns.values()
        for target, event in each.targets
        if event == "click" and page.blocks[target].elem_id == button and each.fn is not None
    )
    return found


def test_a_tabs_cancel_stops_its_own_run_alone(speech, tmp_path):
    does = {"run_page_request": fakes.make_generate()}
    jobs = Jobs(tmp_path / "jobs")
    page = build_app(fakes.made_services(tmp_path, does, config=AppConfig(), jobs=jobs))
    systems = list(fakes.CATALOGUE.systems)
    protocol = "ranking"
    forms = (
        (str(speech), systems, "ann", 0, 1, "10", "euler", False, None, "right_middle", 0, None),
        (["/up/a.npz"], None, "right_middle", 0),
        ("A study", protocol, [str(speech)], systems, None, [], 1, 4, 0, ["front"], ""),
    )
    started = [
        handler(page, button)(VISITOR, *form) for button, form in zip(TABS, forms, strict=True)
    ]
    for run in started:
        next(run)
    for number, cancel in enumerate(TABS.values()):
        handler(page, cancel)(VISITOR)
        assert [job.is_cancelled() for job in jobs._jobs] == [k <= number for k in range(3)]
