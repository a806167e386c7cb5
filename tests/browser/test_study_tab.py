"""A study planned and made on the page: two downloads, one of them for its maker alone."""

import json
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from app import text
from app.page.tabs.study_run import PREVIEW
from app.study.leaks import check_study
from tests.browser.conftest import PATIENCE_MS, in_every_look, open_page
from tests.browser.test_study import agree, answer_pairs, practise, saved_answers

pytestmark = [pytest.mark.browser, pytest.mark.gl]


def download(page: Page, selector: str, out: Path) -> Path:
    with page.expect_download(timeout=PATIENCE_MS) as started:
        page.locator(selector).click()
    path = out / started.value.suggested_filename
    started.value.save_as(path)
    return path


@pytest.mark.parametrize("width", [1280, 390])
def test_the_tab_is_no_wider_than_the_window(visit: Callable[..., Page], width: int) -> None:
    page = visit(width=width, motion="reduce")
    page.get_by_role("tab", name=text.STUDY_TAB).click()
    expect(page.locator("#study-make")).to_be_visible()
    expect(page.get_by_text("Drop in what participants sent or saved")).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_a_study_is_made_on_the_page(
    visit: Callable[..., Page], wav: Callable[[float], Path], tmp_path: Path
) -> None:
    page = visit(motion="reduce")
    page.get_by_role("tab", name=text.STUDY_TAB).click()
    page.set_input_files("#study-speech input[type=file]", [str(wav(0.6)), str(wav(0.7))])
    expect(page.locator("#study-speech")).to_contain_text("speech-0.7")
    page.get_by_label("Seconds a video").fill("0.5")
    page.get_by_label("Participants", exact=True).fill("3")
    page.locator("#study-make").click()
    page.locator("#study-researcher button").wait_for(timeout=3 * PATIENCE_MS)

    plan = tomllib.loads(download(page, "#study-plan", tmp_path).read_text())
    assert (plan["participants"], plan["length_s"]) == (3, 0.5)
    study = tmp_path / "study"
    for selector in ("#study-participants", "#study-researcher button"):
        with zipfile.ZipFile(download(page, selector, tmp_path)) as archive:
            assert {info.date_time for info in archive.infolist()} == {(2000, 1, 1, 0, 0, 0)}
            archive.extractall(study)
    # Unpacking gives the files new times; everything else is as the leak test wants it.
    leaks = [leak for leak in check_study(study) if not leak.startswith("time stamp")]
    assert leaks == []
    key = json.loads((study / "researcher_only" / "key.json").read_text())
    assert sorted(key["lists"]) == ["0", "1", "2"]

    # From the preview to the report: one participant, who takes whatever stands on the left.
    with page.expect_popup() as opened:
        page.get_by_role("link", name=PREVIEW).click()
    preview = opened.value
    agree(preview)
    practise(preview, skipped_ms=0)
    for height in in_every_look(preview):
        box = preview.locator("#next").bounding_box()
        assert box is not None and box["y"] + box["height"] <= height, "Next is below the fold"
    answer_pairs(preview)
    answers = saved_answers(preview, tmp_path)
    assert answers.name.startswith("preview-")
    page.bring_to_front()  # pages behind others are drawn once a second
    page.set_input_files("#analysis-answers input[type=file]", str(answers))
    page.set_input_files(
        "#analysis-key input[type=file]", str(study / "researcher_only" / "key.json")
    )
    expect(page.locator("#analysis-key")).to_contain_text("key")
    expect(page.locator("#analysis-answers")).to_contain_text("preview-")
    page.locator("#analysis-start").click()
    report = page.frame_locator("#analysis-report iframe")
    expect(report.locator("body")).to_contain_text(
        "How people move when they talk", timeout=2 * PATIENCE_MS
    )
    expect(page.locator("#analysis-files")).to_contain_text("results")
    for height in in_every_look(page):
        key = page.locator("#study-researcher button")
        key.scroll_into_view_if_needed()
        box = key.bounding_box()
        assert box is not None and box["y"] + box["height"] <= height

    page.locator("#study-researcher button").click()
    expect(page.get_by_text("There is nothing to fetch here")).to_be_visible()


def test_a_study_that_is_ready_is_filled_in_by_the_click_itself(
    browser: Browser, planned_address: str, tmp_path: Path
) -> None:
    page = open_page(browser, planned_address, motion="reduce")
    page.get_by_role("tab", name=text.STUDY_TAB).click()
    page.route("**/queue/join*", lambda route: None)  # a server too busy to answer
    page.get_by_role("button", name="Do words matter?").click()
    expect(page.get_by_label("Rank all systems on three questions")).to_be_checked()
    expect(page.get_by_label("on wrong words")).to_be_checked()
    expect(page.get_by_label("half as many")).not_to_be_checked()
    page.unroute("**/queue/join*")
    page.get_by_role("button", name="How large?").click()
    expect(page.get_by_label("Rate all systems with sliders")).to_be_checked()
    for name, is_checked in (("smaller", True), ("larger", True), ("on wrong words", False)):
        expect(page.get_by_label(name, exact=True)).to_be_checked(checked=is_checked)
    expect(page.locator("#study-speech")).to_contain_text("three_reasons")
    page.locator("#study-write").click()
    plan = tomllib.loads(download(page, "#study-plan", tmp_path).read_text())
    assert plan["protocol"] == "rating"
    assert [each["name"].split()[-1] for each in plan["systems"]] == [
        "workbench/planned",
        "smaller",
        "larger",
    ]
    page.context.close()


def test_without_speech_the_tab_says_so(visit: Callable[..., Page]) -> None:
    page = visit(motion="reduce")
    page.get_by_role("tab", name=text.STUDY_TAB).click()
    page.locator("#study-make").click()
    expect(page.locator("#study-status")).to_contain_text(
        "There is no speech yet", timeout=PATIENCE_MS
    )
