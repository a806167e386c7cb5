"""What a reader aid and a keyboard find: axe-core over the page's tabs and the study's page."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

from app import text
from app.page.tabs import live, own_motion
from tests.app.study.made_study import make_study
from tests.browser.conftest import PATIENCE_MS, SCHEMES, Scheme, Stage, open_page, start

pytestmark = pytest.mark.browser

TABS = (text.MOTION_TAB, live.TAB, own_motion.TAB, text.LADDER_TAB, text.STUDY_TAB)
GRAVE = ("serious", "critical")


def findings(page: Page) -> list[str]:
    """Of grave ones each rule with the elements that break it."""
    found: dict[str, Any] = Axe().run(page).response
    return [
        f"{each['id']}: {node['html'][:160]} {node['failureSummary'][:200]}"
        for each in found["violations"]
        if each["impact"] in GRAVE
        for node in each["nodes"]
    ]


@pytest.fixture(scope="module")
def ended(browser: Browser, fake_address: str, stage: Stage, speech: Path):
    """A page with the results of a run."""
    stage.hold(12)
    page = open_page(browser, fake_address)
    start(page, speech)
    page.locator("#bundle").wait_for()
    page.locator("#player .lane canvas").first.wait_for()
    yield page
    page.context.close()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_no_tab_has_a_grave_finding(ended: Page, scheme: Scheme) -> None:
    ended.emulate_media(color_scheme=scheme)
    ended.evaluate("dark => document.body.classList.toggle('dark', dark)", scheme == "dark")
    found = {}
    for tab in TABS:
        ended.get_by_role("tab", name=tab, exact=True).click()
        ended.wait_for_timeout(300)
        found[tab] = findings(ended)
    assert found == {tab: [] for tab in TABS}


def test_every_page_of_a_study_has_no_grave_finding(browser: Browser, tmp_path: Path) -> None:
    study = make_study(tmp_path, ["localnet", "globalnet"], ["kitchen"], 'protocol = "pairwise"')
    page = browser.new_context().new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(f"{(study / 'participant_bundle').as_uri()}/index.html?p=0")
    found = [findings(page)]
    page.locator("#agree").check()
    page.get_by_role("button", name="Start", exact=True).click()
    page.locator(".card").first.wait_for()
    found.append(findings(page))
    page.context.close()
    assert found == [[], []]


def test_the_player_can_be_walked_through_by_keyboard(ended: Page) -> None:
    """Tab goes through every control once and on; each does its work from the keyboard."""
    ended.get_by_role("tab", name=text.MOTION_TAB, exact=True).click()
    bar = ended.locator("#player .controls")
    bar.get_by_role("button", name="Play", exact=True).focus()
    walked = []
    for _ in range(40):
        walked.append(
            ended.evaluate(
                "() => document.activeElement.getAttribute('aria-label')"
                " ?? document.activeElement.textContent"
            )
        )
        ended.keyboard.press("Tab")
        if not ended.evaluate("() => Boolean(document.activeElement.closest('#player .controls'))"):
            break
    wanted = ["Play", "One frame back", "One frame on", "Speed", "Loop", "Sound off"]
    wanted += ["Worst second", "Tremble, times as large", "Trail", "Jerk", "Close-up"]
    wanted += ["All", "Wipe", "Flicker", "Ghost", "More displays and views"]
    assert [name for name in walked if not name.startswith("Keys.")] == wanted

    press: Callable[[str], None] = ended.keyboard.press
    bar.get_by_role("button", name="One frame on").focus()
    press("Enter")  # what comes while it is watched plays by itself: this stops it
    press("Home")
    press("Enter")
    expect(bar.locator(".time")).to_have_attribute("title", "Frame 1")
    bar.get_by_role("button", name="Ghost", exact=True).focus()
    press("Enter")
    expect(ended.locator("#player .stage")).to_have_attribute("data-mode", "ghost")
    bar.get_by_role("button", name="All", exact=True).focus()
    press("Enter")
    expect(ended.locator("#player .stage")).to_have_attribute("data-mode", "grid")
