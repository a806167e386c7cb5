"""A player that was kept as one file, opened without any server."""

import re
from pathlib import Path

from playwright.sync_api import Browser, expect

from app.notebook import show
from app.run.many.board import Entry, Value, board_page
from model.speech.audio import Speech
from tests.browser.conftest import watched
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform


def test_it_plays_from_a_file_and_in_a_cell(browser: Browser, tmp_path: Path) -> None:
    motions = {"one": smooth_motion_example(60), "two": smooth_motion_example(60, seed=1)}
    player = show(motions, Speech(made_waveform(32_000), ""))
    cell = tmp_path / "cell.html"
    cell.write_text(f"<!doctype html><meta charset=utf-8>{player._repr_html_()}")
    for path, where in ((player.save(tmp_path / "run.html"), "body"), (cell, "iframe")):
        page = watched(browser.new_page())
        asked: list[str] = []
        page.on("request", lambda request, asked=asked: asked.append(request.url[:40]))
        page.goto(path.as_uri())
        seen = page.frame_locator("iframe") if where == "iframe" else page
        seen.locator(".stage[data-bodies='2']").wait_for()
        seen.get_by_role("button", name="Play", exact=True).click()
        root = seen.locator(".lockstep")
        expect(seen.locator("output.time")).to_have_text(re.compile(r"^0:0(0\.[3-9]|[12])"))
        assert root.evaluate("root => root.stage.pictures") > 2
        seen.get_by_role("button", name="Ghost", exact=True).click()
        assert not [url for url in asked if url.startswith("http")]
        page.close()


def test_a_leaderboard_sorts_by_the_distance_to_recorded(browser: Browser, tmp_path: Path) -> None:
    def entry(system: str, jerk: float) -> Entry:
        value = Value(jerk, jerk - 1, jerk + 1, "m/s³", 9)
        return Entry(system, "t", system, 9, "2026", "p", {"All joints: Mean jerk": value}, {})

    path = tmp_path / "board.html"
    numbers = {"a": 30.0, "b": 11.0, "c": 1.0, "reference": 10.0}
    path.write_text(board_page([entry(name, jerk) for name, jerk in numbers.items()]))
    page = watched(browser.new_page())
    page.goto(path.as_uri())
    names = page.locator("tbody th")
    head = page.get_by_role("button", name="All joints: Mean jerk")
    head.click()
    assert names.all_inner_texts() == ["recorded", "b", "c", "a"]
    head.click()
    assert names.all_inner_texts() == ["a", "b", "recorded", "c"]
    assert page.locator("td.best").inner_text().startswith("11")
    page.get_by_placeholder("systems named").fill("c")
    assert page.locator("tbody tr:visible").count() == 2  # the recorded one stays
    page.close()
