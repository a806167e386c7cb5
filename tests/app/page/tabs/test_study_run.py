"""The tab of the user study without a browser: what is left of runs that are stopped or refused."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app import text
from app.page.tabs.study_run import NO_COOKIE, StudyParts, StudyRunner
from app.page.visitors.visitors import COOKIE
from tests.app.fakes import made_services

VISITOR = SimpleNamespace(session_hash="visitor", cookies={COOKIE: "cookie"})


@pytest.fixture
def runner(tmp_path: Path) -> StudyRunner:
    with gr.Blocks():
        parts = StudyParts(
            gr.HTML(), gr.HTML(), gr.HTML(), gr.DownloadButton(), gr.DownloadButton()
        )
    return StudyRunner(made_services(tmp_path), parts)


def click(runner: StudyRunner, speech: Path, visitor: Any = VISITOR) -> Iterator[str]:
    """What the tab says, update by update."""
    protocol = "Rank all systems on three questions"
    systems = ["globaldiff/local", "globaldiff/full"]
    form = ("A study", protocol, [str(speech)], systems, None, 1, 4, 0, ["front"], "")
    for updates in runner.run(visitor, *form):
        (status,) = [value for part, value in updates.items() if part is runner._parts.status]
        yield status


def test_a_study_that_is_cancelled_says_so_and_leaves_nothing(
    runner: StudyRunner, speech: Path, tmp_path: Path
) -> None:
    clicked = click(runner, speech)
    assert text.STARTING in next(clicked)
    runner.cancel(VISITOR)  # type: ignore[arg-type]
    *_, last = clicked
    assert text.CANCELLED in last and "error" not in last
    assert list((tmp_path / "private").iterdir()) == []


def test_without_a_cookie_no_study_is_made(runner: StudyRunner, speech: Path) -> None:
    stranger = SimpleNamespace(session_hash="visitor", cookies={})
    clicked = click(runner, speech, stranger)
    assert NO_COOKIE.split(",")[0] in next(clicked)
    with pytest.raises(gr.Error, match="cookie"):
        next(clicked)


@pytest.mark.parametrize(
    ("changes", "words"), [({5: 500.0}, "`length_s`"), ({6: 1.5}, "got 1.5"), ({}, "")]
)
def test_the_plan_alone_is_checked_and_copies_no_upload(
    runner: StudyRunner, speech: Path, tmp_path: Path, changes: dict[int, float], words: str
) -> None:
    systems = ["globaldiff/local", "globaldiff/full"]
    form: list[Any] = ["A", "ranking", [str(speech)], systems, None, 2, 4, 0, ["front"], ""]
    for at, value in changes.items():
        form[at] = value
    if words:
        with pytest.raises(gr.Error, match=words):
            runner.write_plan(VISITOR, *form)  # type: ignore[arg-type]
    else:
        runner.write_plan(VISITOR, *form)  # type: ignore[arg-type]
    left = [path.name for path in (tmp_path / "jobs").rglob("*") if path.is_file()]
    assert left in (["plan.toml"], [])
