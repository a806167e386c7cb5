"""Motion that comes window by window, seen in a real Chromium."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from app import text
from tests.browser.conftest import FRAMES, STAGED, Windows, open_page, start

pytestmark = pytest.mark.browser

PLAYER = "document.querySelector('.lockstep').lockstep"
WAITS = f"() => {PLAYER}.isWaiting"


@pytest.fixture
def begun(browser: Browser, windowed_address: str, windows: Windows, speech: Path) -> Page:
    """Two systems of which the first window of 52 frames is there, and no more."""
    windows.let(1)
    windows.may_draw.clear()
    page = open_page(browser, windowed_address)
    start(page, speech)
    page.wait_for_function(STAGED, arg=2)
    return page


def frame(page: Page) -> int:
    return page.evaluate(f"{PLAYER}.frame")


def test_bodies_move_with_sound_at_once_and_wait_where_no_more_has_come(
    begun: Page, windows: Windows
) -> None:
    page = begun
    page.wait_for_function(f"() => {PLAYER}.frame > 5")
    page.wait_for_function(WAITS)
    assert 45 <= frame(page) < 52
    assert page.evaluate("document.querySelector('#player audio').paused")
    waiting = page.locator("#player .stage-view .said", has_text="Waiting for the next window")
    expect(waiting).to_be_visible()
    expect(page.locator("#bundle")).to_be_hidden()

    windows.let(2)
    page.wait_for_function(f"() => {PLAYER}.frame > 60 && {PLAYER}.isWaiting")
    assert 96 <= frame(page) < 104

    windows.let(8)
    page.wait_for_function(f"() => {PLAYER}.frame === {FRAMES - 1} && !{PLAYER}.isPlaying")
    expect(waiting).to_be_hidden()

    # Numbers do not wait for figures.
    expect(page.locator('#numbers tr[data-measure="Jerk"] td .raw').first).to_have_text("110")
    expect(page.locator("#verdict")).to_contain_text("110")
    expect(page.locator("#figures img")).to_have_count(0)
    expect(page.locator("#bundle")).to_be_hidden()
    windows.may_draw.set()
    page.locator("#bundle").wait_for()
    expect(page.locator("#figures img").first).to_be_visible()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.evaluate(f"{PLAYER}.seekFrame(3)")
    page.wait_for_function(f"() => {PLAYER}.frame === 3")
    assert not [url for url in asked if "/media/" in url], "all of it is there"
    page.context.close()


def test_a_run_that_is_cancelled_while_it_moves_leaves_nothing_and_the_next_one_moves(
    begun: Page, windows: Windows
) -> None:
    page = begun
    page.wait_for_function(WAITS)
    page.get_by_role("button", name=text.CANCEL).click()
    expect(page.locator("#status")).to_contain_text(text.CANCELLED)
    expect(page.locator("#player .stage")).to_be_hidden()
    page.wait_for_function(f"() => !{PLAYER}.isPlaying && !{PLAYER}.isWaiting")
    assert page.evaluate("!document.querySelector('#player audio').hasAttribute('src')")

    page.get_by_role("button", name=text.GENERATE).click()
    page.wait_for_function(STAGED, arg=2)
    page.wait_for_function(WAITS)
    assert 45 <= frame(page) < 52
    windows.let(8)
    windows.may_draw.set()
    page.locator("#bundle").wait_for()
    page.wait_for_function(f"() => {PLAYER}.frame === {FRAMES - 1} && !{PLAYER}.isPlaying")
    page.context.close()
